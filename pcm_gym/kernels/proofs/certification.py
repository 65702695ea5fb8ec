"""A proof that a set of equilibria of a two-legged mechanism is complete, at given inputs or at a given pose.

The loads of both rods are searched by branch and bound with the rigorous models of `rod_cells`. A pair of cells, one of
each rod, is excluded where the affine models of what the legs add to the equations, combined by any numbers, cannot sum
to zero; the combinations are those of the system's approximate inverse, and a bad inverse only proves less. Pairs that
lie in a box with one equilibrium (see `krawczyk`) are done. The rest is narrowed and split, and equilibria that turn up
are proved and added. What is still open at the smallest cells is undecided: a fold, or something like it.
"""

import math
from typing import NamedTuple

import numpy as np

from pcm_gym.arrays import Array, Integers
from pcm_gym.kernels.enumeration.cells import node_offset, reaching_input
from pcm_gym.kernels.enumeration.found import POLISH_RULES
from pcm_gym.kernels.numerics.compilation import kernel
from pcm_gym.kernels.numerics.linear import eliminate
from pcm_gym.kernels.proofs.krawczyk import (
    POLAR,
    Krawczyk,
    Proved,
    correct,
    is_proved,
    make_krawczyk,
    natural_width,
    prove,
)
from pcm_gym.kernels.proofs.rod_cells import (
    ACROSS,
    ALONG,
    B_HALF,
    BAND_LEVEL,
    CENTER,
    PLACED,
    REMAINDER,
    RHO,
    RHO_HALF,
    ROWS,
    SLACK,
    SPREAD,
    B,
    Frames,
    UnitCells,
    set_contribution,
    set_unit_models,
)
from pcm_gym.kernels.rods.rod import rod
from pcm_gym.kernels.statics.closure import (
    BASE_X,
    BASE_Y,
    CLAMP_ANGLE,
    LENGTH,
    TIP_X,
    TURN,
    evaluate_rods,
    make_workspace,
    set_inputs,
)
from pcm_gym.kernels.statics.newton import CONVERGED, solve_forward_locally, solve_inverse_locally

# A pair of cells is split until its loads are known so well, relative to `natural_width`.
_LEAST_CELL = 1e-7
# A pair is narrowed instead of split where less than this part of one of its widths is left.
_NARROWED = 0.6
# Where less than this part of all its widths is left, an equilibrium is looked for in it.
_CLEAR = 0.4
_DEPTH = 200


class Undecided(NamedTuple):
    """Pairs of cells, no longer split, that may hold an equilibrium outside the proved boxes."""

    cells: Array  # (m, 2, 4)
    total: Integers  # (1,): how many there are
    examined: Integers  # (1,): pairs of cells that were looked at


def make_undecided(capacity: int) -> Undecided:
    """Return room for so many pairs."""
    return Undecided(np.zeros((capacity, 2, 4)), np.zeros(1, dtype=np.int64), np.zeros(1, dtype=np.int64))


@kernel
def prove_all(frames: Frames, starts: Array, proved: Proved) -> int:
    """Prove the equilibria near the polar loads `starts` (m, 4), one by one; return how many could be proved."""
    work = make_krawczyk()
    count = 0
    for n in range(starts.shape[0]):
        z = starts[n].copy()
        if not correct(frames, z, work):
            z[:] = starts[n]
        count += prove(frames, z, proved, work)
    return count


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


@kernel
def find_open_pairs(tables: tuple[UnitCells, UnitCells], frames: Frames, proved: Proved, pairs: Integers) -> int:
    """Find the pairs of leaves that may hold an equilibrium outside the proved boxes; return how many there are.

    `tables` are those of both legs, with the same cells. The pairs are put into `pairs` (m, 2); if there are more than
    fit, only one more than fit is counted.
    """
    cells = tables[0]
    nodes, levels = cells.boxes.shape[0], cells.levels
    parts = np.empty((2, nodes, ROWS, 5))
    for leg in range(2):
        for node in range(nodes):
            set_contribution(frames, leg, tables[leg].models[node], parts[leg, node])
    work = make_krawczyk()
    stack = np.empty((16 * (levels + 2), 3), dtype=np.int64)
    top = 0
    for start in range(4):
        stack[top, 0], stack[top, 1], stack[top, 2] = start & 1, start >> 1, 0
        top += 1
    count = 0
    while top > 0:
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
            if count == pairs.shape[0]:
                return count + 1
            pairs[count, 0], pairs[count, 1] = node_1, node_2
            count += 1
            continue
        for child in range(4):
            stack[top, 0], stack[top, 1] = first, second
            stack[top, depth % 2] = 4 * stack[top, depth % 2] + child
            stack[top, 2] = depth + 1
            top += 1
    return count


@kernel
def resolve(cells: UnitCells, frames: Frames, pairs: Integers, most: int, proved: Proved, undecided: Undecided) -> bool:
    """Examine pairs of leaves until all parts are excluded, proved, or too small; False where a limit was met first.

    What was not examined then is put into `undecided` as one pair that holds it all.
    """
    work = make_krawczyk()
    stack = np.empty((_DEPTH, 2, 4))
    for n in range(pairs.shape[0]):
        for leg in range(2):
            stack[0, leg] = cells.boxes[pairs[n, leg]]
        top = 1
        while top > 0:
            is_full = undecided.total[0] + 1 >= undecided.cells.shape[0]
            if undecided.examined[0] >= most or is_full or top + 2 > _DEPTH:
                _give_up(cells, pairs[n + 1 :], stack[:top], undecided)
                return False
            undecided.examined[0] += 1
            top += _examine(frames, stack, top - 1, proved, undecided, work)
    return True


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


@kernel
def bound_state_errors(frames: Frames, proved: Proved, numbers: Integers, states: Array, errors: Array) -> None:
    """Bound how far states (m, 6) are from the equilibria in the boxes with these numbers, at given inputs.

    In `errors` (m,): the largest difference of a component, relative to 1 + its size.
    """
    work = make_krawczyk()
    for m in range(numbers.shape[0]):
        errors[m] = _bound_load_errors(proved, numbers[m], states[m], work.box)
        _enclose_loads(proved, numbers[m], 0, work.box)
        set_unit_models(work.box, PLACED, work.models)
        set_contribution(frames, 0, work.models, work.parts[0])
        for d in range(2):  # the tip of the first leg
            tip = work.parts[0, 2 + d]
            errors[m] = max(errors[m], _relative_error(states[m, 4 + d], tip[CENTER], tip[SPREAD]))


@kernel
def bound_inverse_errors(
    legs: Array, pose: Array, proved: Proved, numbers: Integers, states: Array, inputs: Array, errors: Array
) -> None:
    """Do what `bound_state_errors` does for states and inputs (m, 2) at a given pose; angles up to full turns."""
    work = make_krawczyk()
    for m in range(numbers.shape[0]):
        errors[m] = _bound_load_errors(proved, numbers[m], states[m], work.box)
        for d in range(2):
            errors[m] = max(errors[m], _relative_error(states[m, 4 + d], pose[d], 0.0))
        for leg in range(2):
            _enclose_loads(proved, numbers[m], leg, work.box)
            set_unit_models(work.box, PLACED, work.models)
            x, x_reach = _center_and_spread(work.models[2])
            y, y_reach = _center_and_spread(work.models[3])
            own, reach, value = reaching_input(legs, leg, pose[0], pose[1], x, y), x_reach + y_reach, inputs[m, leg]
            if legs[leg, TURN] != 0.0:
                size = math.hypot(x, y)
                reach = math.asin(reach / size) if reach < size else math.inf
                value -= 2.0 * math.pi * math.floor((value - own) / (2.0 * math.pi) + 0.5)
            else:
                reach *= legs[leg, LENGTH]
            data = abs(legs[leg, CLAMP_ANGLE]) + abs(legs[leg, BASE_X]) + abs(legs[leg, BASE_Y]) + legs[leg, LENGTH]
            reach += 10.0 * SLACK * (1.0 + data + abs(pose[0]) + abs(pose[1]) + abs(value))
            errors[m] = max(errors[m], _relative_error(value, own, reach))


@kernel
def _center_and_spread(model: Array) -> tuple[float, float]:
    return model[CENTER], abs(model[ALONG]) + abs(model[ACROSS]) + model[REMAINDER]


@kernel
def _relative_error(value: float, own: float, reach: float) -> float:
    """Bound how far a value is from one that is within `reach` of `own`, relative to 1 + its size; inf for nan."""
    error = (abs(value - own) + reach) / (1.0 + abs(value)) * (1.0 + SLACK)
    return error if error >= 0.0 else math.inf


@kernel
def _bound_load_errors(proved: Proved, n: int, state: Array, box: Array) -> float:
    """Bound how far the loads of a state are from those of a proved equilibrium, relative to 1 + their size."""
    largest = 0.0
    for leg in range(2):
        _enclose_loads(proved, n, leg, box)
        load = box[RHO] * box[RHO]
        reach = (2.0 * box[RHO] + box[RHO_HALF]) * box[RHO_HALF]
        reach = (reach + (load + reach) * box[B_HALF]) * (1.0 + SLACK) + SLACK * load
        largest = max(largest, _relative_error(state[2 * leg], load * math.cos(box[B]), reach))
        largest = max(largest, _relative_error(state[2 * leg + 1], -load * math.sin(box[B]), reach))
    return largest


@kernel
def _enclose_loads(proved: Proved, n: int, leg: int, box: Array) -> None:
    """Fill in a box of polar loads in which a rod's load is at a proved equilibrium."""
    first, second = 2 * leg, 2 * leg + 1
    center, error = proved.center[n], proved.error[n]
    box[RHO], box[RHO_HALF], box[B], box[B_HALF] = center[first], error[first], center[second], error[second]
    if proved.charts[n, leg] == POLAR:
        return
    load, reach = math.hypot(center[first], center[second]), math.hypot(error[first], error[second])
    rho = math.sqrt(load)
    box[RHO], box[B] = rho, math.atan2(-center[second], center[first])
    box[RHO_HALF] = max(math.sqrt(load + reach) - rho, rho - math.sqrt(max(load - reach, 0.0))) + SLACK * (1.0 + rho)
    box[B_HALF] = math.pi if reach >= load else math.asin(reach / load) + SLACK


@kernel
def set_state(legs: Array, inputs: Array, load: Array, z: Array, x: Array) -> bool:
    """Put the equilibrium near the polar loads z into the state x (6,); return whether Newton's method converged."""
    work = make_workspace(2, 6)
    _set_loads(z, x)
    set_inputs(legs, inputs, work)
    x[4:] = 0.0
    evaluate_rods(legs, x, work)
    for d in range(2):  # between the tips of the two rods
        x[4 + d] = 0.5 * (work.clamps[0, d] + work.rods[0, TIP_X + d] + work.clamps[1, d] + work.rods[1, TIP_X + d])
    return solve_forward_locally(legs, inputs, load, x, POLISH_RULES, work) == CONVERGED


@kernel
def set_inverse_state(legs: Array, pose: Array, load: Array, z: Array, x: Array, inputs: Array) -> bool:
    """Put the equilibrium at a pose near the polar loads z into the state x (6,) and the inputs (2,); as `set_state`.

    Angles are brought into (-pi, pi].
    """
    _set_loads(z, x)
    x[4:] = pose
    for leg in range(2):
        point = rod(x[2 * leg], x[2 * leg + 1])
        inputs[leg] = reaching_input(legs, leg, pose[0], pose[1], point.tip_x, point.tip_y)
    is_found = solve_inverse_locally(legs, inputs, load, x, POLISH_RULES, make_workspace(2, 6)) == CONVERGED
    for leg in range(2):
        if legs[leg, TURN] != 0.0:
            inputs[leg] += 2.0 * math.pi * math.floor(0.5 - inputs[leg] / (2.0 * math.pi))
    return is_found


@kernel
def _set_loads(z: Array, x: Array) -> None:
    for leg in range(2):
        rho, b = z[2 * leg], z[2 * leg + 1]
        x[2 * leg], x[2 * leg + 1] = rho * rho * math.cos(b), -rho * rho * math.sin(b)
