"""A proof that a set of equilibria of a two-legged mechanism is complete, at given inputs or at a given pose.

The loads of both rods are searched by branch and bound with the rigorous models of `rod_cells`. A pair of cells, one of
each rod, is excluded where the affine models of what the legs add to the equations, combined by any numbers, cannot sum
to zero; the combinations are those of the system's approximate inverse, and a bad inverse only proves less. Pairs that
lie in a box with one equilibrium (see `krawczyk`) are done. The rest is narrowed and split, and equilibria that turn up
are proved and added. What is still open at the smallest cells is undecided: a fold, or something like it.
"""

from typing import NamedTuple

import numpy as np

from pcm_gym.arrays import Array, Integers
from pcm_gym.kernels.enumeration.cells import node_offset
from pcm_gym.kernels.numerics.compilation import kernel
from pcm_gym.kernels.numerics.linear import eliminate
from pcm_gym.kernels.numerics.slices import slices
from pcm_gym.kernels.proofs.krawczyk import Krawczyk, Proved, correct, is_proved, make_krawczyk, natural_width, prove
from pcm_gym.kernels.proofs.rod_cells import (
    ACROSS,
    ALONG,
    BAND_LEVEL,
    CENTER,
    REMAINDER,
    RHO,
    ROWS,
    SLACK,
    SPREAD,
    B,
    Frames,
    UnitCells,
    set_contribution,
    set_unit_models,
)

# A pair of cells is split until its loads are known so well, relative to `natural_width`.
_LEAST_CELL = 1e-7
# A pair is narrowed instead of split where less than this part of one of its widths is left.
_NARROWED = 0.6
# Where less than this part of all its widths is left, an equilibrium is looked for in it.
_CLEAR = 0.4
_DEPTH = 200

# Pairs of nodes that are looked at in one call of compiled code, parts of leaves, and equilibria.
_PAIRS_AT_ONCE, _PARTS_AT_ONCE, _PROVED_AT_ONCE = 1 << 18, 1 << 13, 32
# How the examination of pairs stands.
RESOLVED, GOES_ON, GIVEN_UP = range(3)


class Undecided(NamedTuple):
    """Pairs of cells, no longer split, that may hold an equilibrium outside the proved boxes."""

    cells: Array  # (m, 2, 4)
    total: Integers  # (1,): how many there are
    examined: Integers  # (1,): pairs of cells that were looked at


def make_undecided(capacity: int) -> Undecided:
    """Return room for so many pairs."""
    return Undecided(np.zeros((capacity, 2, 4)), np.zeros(1, dtype=np.int64), np.zeros(1, dtype=np.int64))


def prove_all(frames: Frames, starts: Array, proved: Proved) -> None:
    """Prove the equilibria near the polar loads `starts` (m, 4), one by one, as far as that can be done."""
    for first, last in slices(len(starts), _PROVED_AT_ONCE):
        _prove_some(frames, starts[first:last], proved)


@kernel
def _prove_some(frames: Frames, starts: Array, proved: Proved) -> None:
    work = make_krawczyk()
    for n in range(starts.shape[0]):
        z = starts[n].copy()
        if not correct(frames, z, work):
            z[:] = starts[n]
        prove(frames, z, proved, work)


@kernel
def _may_touch(first: Array, second: Array) -> bool:
    """Return whether the bounds of two contributions (4, 5) allow all sums to vanish."""
    for row in range(ROWS):
        if abs(first[row, CENTER] + second[row, CENTER]) > first[row, SPREAD] + second[row, SPREAD]:
            return False
    return True


@kernel
def _narrow(first: Array, second: Array, work: Krawczyk) -> bool:
    """Return whether the affine models of two contributions allow all sums to vanish; `work.span` is where.

    The rows are combined by an approximate inverse of the system; any combination gives a necessary condition.
    """
    table, span = work.inverse, work.span
    for row in range(ROWS):
        table[row, 0], table[row, 1] = first[row, ALONG], first[row, ACROSS]
        table[row, 2], table[row, 3] = second[row, ALONG], second[row, ACROSS]
        for k in range(ROWS):
            table[row, ROWS + k] = 1.0 if k == row else 0.0
    span[:, 0], span[:, 1] = -1.0, 1.0
    if not eliminate(table, ROWS, 2 * ROWS):
        return True
    for k in range(ROWS):
        slopes = table[k]  # their half of the table is free now
        slopes[:ROWS] = 0.0
        value = reach = rounding = 0.0
        for row in range(ROWS):
            factor, a, b = table[k, ROWS + row], first[row], second[row]
            value += factor * (a[CENTER] + b[CENTER])
            slopes[0] += factor * a[ALONG]
            slopes[1] += factor * a[ACROSS]
            slopes[2] += factor * b[ALONG]
            slopes[3] += factor * b[ACROSS]
            reach += abs(factor) * (a[REMAINDER] + b[REMAINDER])
            rounding += abs(factor) * (a[SPREAD] + b[SPREAD] + abs(a[CENTER]) + abs(b[CENTER]))
        slopes[k] -= 1.0
        for j in range(ROWS):
            reach += abs(slopes[j])
        reach = (reach + SLACK * (1.0 + rounding)) * (1.0 + SLACK)
        if abs(value) > 1.0 + reach:
            return False
        # where the inverse is too bad to say anything, nan included, the bounds stay
        if -value - reach > -1.0:
            span[k, 0] = -value - reach
        if -value + reach < 1.0:
            span[k, 1] = -value + reach
    return True


class OpenPairs(NamedTuple):
    """The search for pairs of leaves that may hold an equilibrium."""

    parts: Array  # (2, nodes, 4, 5): what each leg adds to the equations over each node
    stack: Integers  # (m, 3): pairs of nodes, by their numbers in their levels, and the depth
    pairs: Integers  # (n, 2): those found
    counts: Integers  # (2,): how many are on the stack, and how many have been found


def make_open_pairs(cells: UnitCells, most: int) -> OpenPairs:
    """Return room for so many pairs, with the roots on the stack."""
    stack = np.zeros((16 * (cells.levels + 2), 3), dtype=np.int64)
    stack[:4, :2] = (0, 0), (1, 0), (0, 1), (1, 1)
    parts = np.empty((2, len(cells.boxes), ROWS, 5))
    return OpenPairs(parts, stack, np.empty((most, 2), dtype=np.int64), np.array([4, 0]))


@kernel
def set_parts(cells: UnitCells, frames: Frames, leg: int, search: OpenPairs) -> None:
    """Fill in what a leg adds to the equations over each node."""
    for node in range(cells.boxes.shape[0]):
        set_contribution(frames, leg, cells.models[node], search.parts[leg, node])


@kernel
def find_open_pairs(cells: UnitCells, proved: Proved, search: OpenPairs) -> bool:
    """Find pairs of leaves that may hold an equilibrium outside the proved boxes; return whether more are to come.

    A call does a slice of the work, and less where there is no more room.
    """
    parts, stack, pairs, levels = search.parts, search.stack, search.pairs, cells.levels
    work = make_krawczyk()
    top, count = search.counts[0], search.counts[1]
    for _ in range(_PAIRS_AT_ONCE):
        if top == 0 or count == pairs.shape[0]:
            break
        top -= 1
        first, second, depth = stack[top, 0], stack[top, 1], stack[top, 2]
        level_1, level_2 = (depth + 1) // 2, depth // 2
        node_1, node_2 = first + node_offset(level_1), second + node_offset(level_2)
        if not _may_touch(parts[0, node_1], parts[1, node_2]):
            continue
        if level_2 >= BAND_LEVEL:
            if is_proved(proved, cells.boxes[node_1], cells.boxes[node_2]):
                continue
            if not _narrow(parts[0, node_1], parts[1, node_2], work):
                continue
        if level_2 == levels:
            pairs[count, 0], pairs[count, 1] = node_1, node_2
            count += 1
            continue
        for child in range(4):
            stack[top, 0], stack[top, 1] = first, second
            stack[top, depth % 2] = 4 * stack[top, depth % 2] + child
            stack[top, 2] = depth + 1
            top += 1
    search.counts[0], search.counts[1] = top, count
    return bool(top > 0)


class Resolution(NamedTuple):
    """The examination of pairs of leaves."""

    pairs: Integers  # (n, 2)
    stack: Array  # (depth, 2, 4): parts of the present pair that are open
    counts: Integers  # (2,): the number of the next pair, and how many parts of the present one are open


def make_resolution(pairs: Integers) -> Resolution:
    """Return the examination of these pairs, at its beginning."""
    return Resolution(pairs, np.empty((_DEPTH, 2, 4)), np.zeros(2, dtype=np.int64))


@kernel
def resolve(
    cells: UnitCells, frames: Frames, search: Resolution, most: int, proved: Proved, undecided: Undecided
) -> int:
    """Examine pairs of leaves until all parts are excluded, proved, or too small; return how that stands.

    A call does a slice of the work. Where a limit is met first, what was not examined is put into `undecided` as one
    pair that holds it all.
    """
    work, stack, pairs = make_krawczyk(), search.stack, search.pairs
    n, top = search.counts[0], search.counts[1]
    for _ in range(_PARTS_AT_ONCE):
        if top == 0:
            if n == pairs.shape[0]:
                return RESOLVED
            for leg in range(2):
                stack[0, leg] = cells.boxes[pairs[n, leg]]
            n, top = n + 1, 1
        is_full = undecided.total[0] + 1 >= undecided.cells.shape[0]
        if undecided.examined[0] >= most or is_full or top + 2 > _DEPTH:
            _give_up(cells, pairs[n:], stack[:top], undecided)
            return GIVEN_UP
        undecided.examined[0] += 1
        top += _examine(frames, stack, top - 1, proved, undecided, work)
    search.counts[0], search.counts[1] = n, top
    return GOES_ON


@kernel
def _examine(frames: Frames, stack: Array, top: int, proved: Proved, undecided: Undecided, work: Krawczyk) -> int:
    """Examine the pair stack[top]; leave in its place what is still open of it, and return the stack's growth."""
    pair = stack[top]
    if is_proved(proved, pair[0], pair[1]):
        return -1
    for leg in range(2):
        set_unit_models(pair[leg], frames.kinds[leg], work.models)
        set_contribution(frames, leg, work.models, work.parts[leg])
    if not _may_touch(work.parts[0], work.parts[1]) or not _narrow(work.parts[0], work.parts[1], work):
        return -1
    widest = _widest(pair)
    if _relative_width(pair, widest) < _LEAST_CELL:
        undecided.cells[undecided.total[0]] = pair
        undecided.total[0] += 1
        return -1
    least, largest = _narrow_pair(pair, work.span)
    if largest < _CLEAR:
        _look_for_equilibrium(frames, pair, proved, work)
    if least < _NARROWED:
        return 0
    _split(stack, top, widest)
    return 1


@kernel
def _split(stack: Array, top: int, widest: int) -> None:
    """Halve the pair stack[top] along one of its four loads, into stack[top] and stack[top + 1]."""
    leg, k = widest // 2, 2 * (widest % 2)
    stack[top + 1] = stack[top]
    half = 0.5 * stack[top, leg, k + 1]
    for child in range(2):
        box = stack[top + child, leg]
        box[k] += half if child == 0 else -half
        box[k + 1] = half * (1.0 + SLACK) + SLACK * abs(box[k])


@kernel
def _give_up(cells: UnitCells, pairs: Integers, open_pairs: Array, undecided: Undecided) -> None:
    """Add to `undecided` one pair that holds all these, of leaves and of other cells."""
    hull = undecided.cells[undecided.total[0]]
    hull[:] = open_pairs[0]
    for n in range(1, open_pairs.shape[0]):
        for leg in range(2):
            _enlarge(hull[leg], open_pairs[n, leg])
    for n in range(pairs.shape[0]):
        for leg in range(2):
            _enlarge(hull[leg], cells.boxes[pairs[n, leg]])
    undecided.total[0] += 1


@kernel
def _enlarge(box: Array, other: Array) -> None:
    for k in range(0, 4, 2):
        low = min(box[k] - box[k + 1], other[k] - other[k + 1])
        high = max(box[k] + box[k + 1], other[k] + other[k + 1])
        box[k] = 0.5 * (low + high)
        box[k + 1] = 0.5 * (high - low) * (1.0 + SLACK) + SLACK * abs(box[k])


@kernel
def _relative_width(pair: Array, k: int) -> float:
    """Return the half width of the k-th of the four loads over its natural one."""
    box = pair[k // 2]
    return float(box[2 * (k % 2) + 1] / natural_width(box[RHO], box[B], k))


@kernel
def _widest(pair: Array) -> int:
    widest = 0
    for k in range(1, ROWS):
        if _relative_width(pair, k) > _relative_width(pair, widest):
            widest = k
    return widest


@kernel
def _narrow_pair(pair: Array, span: Array) -> tuple[float, float]:
    """Cut a pair to the bounds of its local coordinates; return the least and the largest part that is left of one."""
    least, largest = 1.0, 0.0
    for k in range(ROWS):
        box, column = pair[k // 2], 2 * (k % 2)
        width, part = box[column + 1], 0.5 * (span[k, 1] - span[k, 0])
        if part < 1.0:
            box[column] += 0.5 * (span[k, 0] + span[k, 1]) * width
            box[column + 1] = part * width * (1.0 + SLACK) + SLACK * (abs(box[column]) + width)
        left = box[column + 1] / width
        least, largest = min(least, left), max(largest, left)
    return least, largest


@kernel
def _look_for_equilibrium(frames: Frames, pair: Array, proved: Proved, work: Krawczyk) -> None:
    z = np.empty(ROWS)
    for leg in range(2):
        z[2 * leg], z[2 * leg + 1] = max(pair[leg, RHO], 0.0), pair[leg, B]
    if correct(frames, z, work):
        prove(frames, z, proved, work)
