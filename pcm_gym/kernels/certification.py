"""A proof that a set of equilibria of a two-legged mechanism is complete, at given inputs.

The loads of both rods, in the polar chart (rho, b), are searched by branch and bound with the rigorous models of
`rod_enclosure`. What a pair of cells, one of each rod, can contribute to the four equations (balance of forces, tips
that meet) is an affine model with a remainder. A pair is excluded where the models, combined by any four numbers per
equation, cannot sum to zero; the combinations are those of the system's approximate inverse, and a bad inverse only
proves less. Around each equilibrium a test of Krawczyk's proves a box in which there is that one and no other; pairs of
cells inside are done. The rest is narrowed and split; what stays undecided at the smallest cells is reported.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pcm_gym.kernels.cells import cell_of_leaf, grid_angle, node_offset
from pcm_gym.kernels.closure import AXIS_X, AXIS_Y, BASE_X, BASE_Y, CLAMP_ANGLE, LENGTH, STIFFNESS, TURN
from pcm_gym.kernels.compilation import kernel
from pcm_gym.kernels.linear import eliminate
from pcm_gym.kernels.rod_enclosure import RodEnclosure, enclose_rod, enclose_rod_derivatives
from pcm_gym.kernels.taylor_models import Model, affine, bounds

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

# A cell is a box of loads: centre and half width of rho and of b.
RHO, RHO_HALF, B, B_HALF = range(4)
# Affine model of a quantity over a cell, and how far the quantity may be from the centre.
CENTER, ALONG, ACROSS, REMAINDER, SPREAD = range(5)
# The four quantities: of the unit rod the force and the tip, of a leg what it adds to the equations.
_ROWS = 4
# Rows of loads at the top of which the division of b changes: 2^4 of them.
_BAND_LEVEL = 4
# Covers the rounding errors of what is computed from a model outside of the Taylor arithmetic, and those of the
# mechanism's data, relative to the absolute values that go into it.
_SLACK = 1e-14


_NEWTON_STEPS = 12
# Sizes of boxes tried around an equilibrium, each smaller than the one before.
_RADII, _SHRINK = 60, 0.7
_LARGEST_RADIUS = 0.5
# A pair of cells is split until its loads are known so well, relative to `_natural_radius`.
_LEAST_CELL = 1e-7
# A pair is narrowed instead of split where that takes away more than this part of one of its widths.
_NARROWED = 0.6
# Where the models' remainders leave less than this part of a pair open, an equilibrium is looked for in it.
_CLEAR = 0.4
_DEPTH = 200


class UnitCells(NamedTuple):
    """Rigorous models of the unit rod over a tree of cells, for all mechanisms."""

    levels: int
    rho_max: float
    boxes: Array  # (nodes, 4)
    models: Array  # (nodes, 4, 4): [force_x, force_y, tip_x, tip_y; centre, along, across, remainder]


@kernel
def _set_affine(model: Model, out: Array) -> None:
    out[CENTER], out[ALONG], out[ACROSS], out[REMAINDER] = affine(model)
    if not math.isfinite(out[REMAINDER] + out[CENTER] + out[ALONG] + out[ACROSS]):
        out[:] = 0.0
        out[REMAINDER] = math.inf


@kernel
def _set_unit_models(box: Array, out: Array) -> None:
    rod = enclose_rod(box[RHO], box[RHO_HALF], box[B], box[B_HALF])
    _set_affine(rod.force_x, out[0])
    _set_affine(rod.force_y, out[1])
    _set_affine(rod.tip_x, out[2])
    _set_affine(rod.tip_y, out[3])


@kernel
def _set_interval(low: float, high: float, out: Array) -> None:
    """Put centre and half width of an interval into `out` (2,), outward."""
    out[0] = 0.5 * (low + high)
    out[1] = max(high - out[0], out[0] - low) * (1.0 + _SLACK)


@kernel
def make_unit_cells(levels: int, rho_max: float) -> UnitCells:
    """Return the unit rod's models for rho in [0, rho_max] and every b.

    The division of b is graded for the middle of each band of rho, so that cells are boxes; a node above the bands
    holds cells that are not aligned, and has only bounds.
    """
    count, bands = 2**levels, 2**_BAND_LEVEL
    grid = np.empty((bands, count + 1))
    for band in range(bands):
        for j in range(count + 1):
            grid[band, j] = grid_angle(rho_max * (band + 0.5) / bands, j / count)
        grid[band, count] = 3.1415926535897936  # the next number above pi
    nodes = node_offset(levels + 1)
    cells = UnitCells(levels, rho_max, np.empty((nodes, 4)), np.empty((nodes, _ROWS, 4)))
    start = node_offset(levels)
    for leaf in range(2 * 4**levels):
        side, i, j = cell_of_leaf(leaf, levels)
        box, band = cells.boxes[start + leaf], i * bands // count
        _set_interval(rho_max * (i / count), rho_max * ((i + 1) / count), box[RHO : RHO + 2])
        _set_interval(grid[band, j], grid[band, j + 1], box[B : B + 2])
        if side == 1:
            box[B] = -box[B]
        _set_unit_models(box, cells.models[start + leaf])
    for level in range(levels - 1, -1, -1):
        for node in range(2 * 4**level):
            _set_node(cells, node_offset(level) + node, node_offset(level + 1) + 4 * node, level >= _BAND_LEVEL)
    return cells


@kernel
def _set_node(cells: UnitCells, node: int, first_child: int, is_box: bool) -> None:
    """Enclose the children's boxes and models in the node's."""
    box, children = cells.boxes[node], cells.boxes[first_child : first_child + 4]
    for k in (RHO, B):
        low = high = children[0, k]
        for child in range(4):
            low = min(low, children[child, k] - children[child, k + 1])
            high = max(high, children[child, k] + children[child, k + 1])
        _set_interval(low, high, box[k : k + 2])
    for row in range(_ROWS):
        out, models = cells.models[node, row], cells.models[first_child : first_child + 4, row]
        out[:] = 0.0
        if is_box:
            for child in range(4):
                out[ALONG] += 0.25 * models[child, ALONG] * box[RHO_HALF] / children[child, RHO_HALF]
                out[ACROSS] += 0.25 * models[child, ACROSS] * box[B_HALF] / children[child, B_HALF]
        low, high = math.inf, -math.inf
        for child in range(4):
            s = (children[child, RHO] - box[RHO]) / box[RHO_HALF]
            t = (children[child, B] - box[B]) / box[B_HALF]
            gap = models[child, CENTER] - s * out[ALONG] - t * out[ACROSS]
            reach = (
                abs(models[child, ALONG] - out[ALONG] * children[child, RHO_HALF] / box[RHO_HALF])
                + abs(models[child, ACROSS] - out[ACROSS] * children[child, B_HALF] / box[B_HALF])
                + models[child, REMAINDER]
                + _SLACK * (abs(models[child, CENTER]) + abs(out[ALONG]) + abs(out[ACROSS]))
            )
            low, high = min(low, gap - reach), max(high, gap + reach)
        if not high - low < math.inf:
            out[:] = 0.0
            out[REMAINDER] = math.inf
            continue
        out[CENTER] = 0.5 * (low + high)
        out[REMAINDER] = max(high - out[CENTER], out[CENTER] - low) + _SLACK * abs(out[CENTER])


class Frames(NamedTuple):
    """How the quantities of the unit rods enter the equations, (2, ...) by leg."""

    turn: Array  # (2, 2): cosine and sine of the clamp's angle
    factors: Array  # (2, 4): of each row
    offsets: Array  # (2, 4): added to each row
    slacks: Array  # (2, 4): bound on the error of the offset
    relative_slack: Array  # (1,): of what is turned and scaled


@kernel
def make_frames(legs: Array, inputs: Array, load: Array) -> Frames:
    """Return the frames for a mechanism of two legs: force of both less the load, tip of the first less the second."""
    frames = Frames(np.empty((2, 2)), np.empty((2, 4)), np.empty((2, 4)), np.empty((2, 4)), np.array([_SLACK]))
    for leg in range(2):
        turned = legs[leg, TURN] * inputs[leg]
        angle = legs[leg, CLAMP_ANGLE] + turned
        frames.turn[leg, 0], frames.turn[leg, 1] = math.cos(angle), math.sin(angle)
        # the angle's own rounding turns everything
        frames.relative_slack[0] += _SLACK * (abs(legs[leg, CLAMP_ANGLE]) + abs(turned))
        length, sign = legs[leg, LENGTH], 1.0 - 2.0 * leg
        force = legs[leg, STIFFNESS] / (length * length)
        for k, base, axis in ((0, BASE_X, AXIS_X), (1, BASE_Y, AXIS_Y)):
            frames.factors[leg, k], frames.factors[leg, 2 + k] = force, sign * length
            frames.offsets[leg, k] = -load[k] if leg == 0 else 0.0
            frames.slacks[leg, k] = _SLACK * abs(frames.offsets[leg, k])
            slide = legs[leg, axis] * inputs[leg]
            frames.offsets[leg, 2 + k] = sign * (legs[leg, base] + slide)
            frames.slacks[leg, 2 + k] = _SLACK * (abs(legs[leg, base]) + abs(inputs[leg]))
    return frames


@kernel
def _set_contribution(frames: Frames, leg: int, models: Array, out: Array) -> None:
    """Fill `out` (4, 5) with what a leg adds to the equations, from the unit rod's models (4, 4)."""
    c, s = frames.turn[leg, 0], frames.turn[leg, 1]
    for pair in range(0, _ROWS, 2):
        x, y = models[pair], models[pair + 1]
        size = 0.0
        for column in range(4):
            size += abs(x[column]) + abs(y[column])
        for row in range(pair, pair + 2):
            along_x, along_y = (c, -s) if row == pair else (s, c)
            factor, target = frames.factors[leg, row], out[row]
            target[CENTER] = frames.offsets[leg, row] + factor * (along_x * x[CENTER] + along_y * y[CENTER])
            target[ALONG] = factor * (along_x * x[ALONG] + along_y * y[ALONG])
            target[ACROSS] = factor * (along_x * x[ACROSS] + along_y * y[ACROSS])
            remainder = abs(along_x) * x[REMAINDER] + abs(along_y) * y[REMAINDER]
            rounding = frames.relative_slack[0] * abs(factor) * size + frames.slacks[leg, row]
            target[REMAINDER] = (abs(factor) * remainder + rounding) * (1.0 + _SLACK)
            spread = abs(target[ALONG]) + abs(target[ACROSS]) + target[REMAINDER]
            target[SPREAD] = spread * (1.0 + _SLACK) + _SLACK * abs(target[CENTER])


@kernel
def _may_touch(first: Array, second: Array) -> bool:
    """Return whether the bounds of two contributions (4, 5) allow all sums to vanish."""
    for row in range(_ROWS):
        if abs(first[row, CENTER] + second[row, CENTER]) > first[row, SPREAD] + second[row, SPREAD]:
            return False
    return True


@kernel
def _narrow(first: Array, second: Array, test: Array, span: Array) -> bool:
    """Return whether the affine models of two contributions allow all sums to vanish; `span` (4, 2) is where.

    The rows are combined by an approximate inverse of the system; any combination gives a necessary condition. `span`
    holds the bounds of the four local coordinates, within [-1, 1].
    """
    for row in range(_ROWS):
        test[row, 0], test[row, 1] = first[row, ALONG], first[row, ACROSS]
        test[row, 2], test[row, 3] = second[row, ALONG], second[row, ACROSS]
        for k in range(_ROWS):
            test[row, _ROWS + k] = 1.0 if k == row else 0.0
    span[:, 0], span[:, 1] = -1.0, 1.0
    if not eliminate(test, _ROWS, 2 * _ROWS):
        return True
    for k in range(_ROWS):
        value = reach = rounding = by_0 = by_1 = by_2 = by_3 = 0.0
        for row in range(_ROWS):
            factor, a, b = test[k, _ROWS + row], first[row], second[row]
            value += factor * (a[CENTER] + b[CENTER])
            by_0 += factor * a[ALONG]
            by_1 += factor * a[ACROSS]
            by_2 += factor * b[ALONG]
            by_3 += factor * b[ACROSS]
            reach += abs(factor) * (a[REMAINDER] + b[REMAINDER])
            rounding += abs(factor) * (a[SPREAD] + b[SPREAD] + abs(a[CENTER]) + abs(b[CENTER]))
        reach += _SLACK * rounding
        others = abs(by_0) + abs(by_1) + abs(by_2) + abs(by_3)
        own = by_0 if k == 0 else (by_1 if k == 1 else (by_2 if k == 2 else by_3))
        reach += others - abs(own) + abs(own - 1.0)
        reach *= 1.0 + _SLACK
        if abs(value) > 1.0 + reach:
            return False
        # where the inverse is too bad to say anything, nan included, the bounds stay
        if -value - reach > -1.0:
            span[k, 0] = -value - reach
        if -value + reach < 1.0:
            span[k, 1] = -value + reach
    return True


class Proved(NamedTuple):
    """Boxes of loads (rho, b of the first rod, rho, b of the second) with exactly one equilibrium each."""

    center: Array  # (m, 4): the approximate equilibrium
    radius: Array  # (m, 4): of the box
    error: Array  # (m, 4): the equilibrium is so near to the centre
    count: Integers  # (1,)


@kernel
def _set_derivatives(frames: Frames, leg: int, box: Array, middle: Array, half_width: Array) -> None:
    """Fill the columns of a leg in the enclosure middle +- half_width of the Jacobian (4, 4) over a box of its loads."""
    by_rho, by_b = enclose_rod_derivatives(box[RHO], box[RHO_HALF], box[B], box[B_HALF])
    _set_column(frames, leg, by_rho, middle[:, 2 * leg], half_width[:, 2 * leg])
    _set_column(frames, leg, by_b, middle[:, 2 * leg + 1], half_width[:, 2 * leg + 1])


@kernel
def _set_column(frames: Frames, leg: int, change: RodEnclosure, middle: Array, half_width: Array) -> None:
    c, s = frames.turn[leg, 0], frames.turn[leg, 1]
    for pair, x, y in ((0, change.force_x, change.force_y), (2, change.tip_x, change.tip_y)):
        x_middle, x_half = bounds(x)
        y_middle, y_half = bounds(y)
        factor = frames.factors[leg, pair]
        middle[pair] = factor * (c * x_middle - s * y_middle)
        middle[pair + 1] = factor * (s * x_middle + c * y_middle)
        rounding = frames.relative_slack[0] * (abs(x_middle) + abs(y_middle) + x_half + y_half)
        half_width[pair] = abs(factor) * (abs(c) * x_half + abs(s) * y_half + rounding) * (1.0 + _SLACK)
        half_width[pair + 1] = abs(factor) * (abs(s) * x_half + abs(c) * y_half + rounding) * (1.0 + _SLACK)


class Krawczyk(NamedTuple):
    """Scratch arrays of the test of Krawczyk."""

    boxes: Array  # (2, 4)
    models: Array  # (4, 4)
    parts: Array  # (2, 4, 5): the contributions
    middle: Array  # (4, 4): the Jacobian's enclosure
    half_width: Array  # (4, 4)
    inverse: Array  # (4, 8): its right half is an approximate inverse
    bound: Array  # (4, 4): of |1 - inverse J|
    error: Array  # (4,): of |inverse F|
    trial: Array  # (4,)
    loads: Array  # (4,)


@kernel
def make_krawczyk() -> Krawczyk:
    """Return the scratch arrays."""
    return Krawczyk(
        np.zeros((2, 4)),
        np.zeros((4, 4)),
        np.zeros((2, 4, 5)),
        np.zeros((4, 4)),
        np.zeros((4, 4)),
        np.zeros((4, 8)),
        np.zeros((4, 4)),
        np.zeros(4),
        np.zeros(4),
        np.zeros(4),
    )


@kernel
def _linearise(frames: Frames, z: Array, work: Krawczyk) -> bool:
    """Fill values, Jacobian and approximate inverse at the loads z; return False where it is singular."""
    for leg in range(2):
        box = work.boxes[leg]
        box[RHO], box[RHO_HALF], box[B], box[B_HALF] = z[2 * leg], 0.0, z[2 * leg + 1], 0.0
        _set_unit_models(box, work.models)
        _set_contribution(frames, leg, work.models, work.parts[leg])
        _set_derivatives(frames, leg, box, work.middle, work.half_width)
    for row in range(_ROWS):
        for k in range(_ROWS):
            work.inverse[row, k] = work.middle[row, k]
            work.inverse[row, _ROWS + k] = 1.0 if k == row else 0.0
    return eliminate(work.inverse, _ROWS, 2 * _ROWS)


@kernel
def _newton(frames: Frames, z: Array, work: Krawczyk) -> bool:
    """Correct the loads z in place to the equilibrium near them; return whether that converged."""
    for _ in range(_NEWTON_STEPS):
        if not _linearise(frames, z, work):
            return False
        size = 0.0
        for k in range(_ROWS):
            step = 0.0
            for row in range(_ROWS):
                step += work.inverse[k, _ROWS + row] * (work.parts[0, row, CENTER] + work.parts[1, row, CENTER])
            z[k] -= step
            natural = _natural_radius(z, k)
            if not abs(step) < 10.0 * natural:
                return False
            size = max(size, abs(step) / natural)
        if size < 1e-11:
            return z[0] > 0.0 and z[2] > 0.0
    return False


@kernel
def _natural_radius(z: Array, k: int) -> float:
    """Return how much the load z[k] may change so that its rod changes by something like its own size."""
    if k % 2 == 0:
        return _LARGEST_RADIUS
    return min(_LARGEST_RADIUS, abs(z[k]) + math.exp(-abs(z[k - 1])))


@kernel
def _set_contraction(frames: Frames, z: Array, r: Array, work: Krawczyk) -> None:
    """Fill `work.bound` with a bound of |1 - Y J| over the box z +- r, Y the inverse in `work`."""
    for leg in range(2):
        box = work.boxes[leg]
        box[RHO], box[RHO_HALF] = z[2 * leg], r[2 * leg]
        box[B], box[B_HALF] = z[2 * leg + 1], r[2 * leg + 1]
        _set_derivatives(frames, leg, box, work.middle, work.half_width)
    for k in range(_ROWS):
        for j in range(_ROWS):
            product, rounding, spread = -1.0 if k == j else 0.0, 1.0, 0.0
            for row in range(_ROWS):
                factor = work.inverse[k, _ROWS + row]
                product += factor * work.middle[row, j]
                rounding += abs(factor * work.middle[row, j])
                spread += abs(factor) * work.half_width[row, j]
            work.bound[k, j] = (abs(product) + spread + _SLACK * rounding) * (1.0 + _SLACK)


@kernel
def _prove(frames: Frames, z: Array, r: Array, error: Array, work: Krawczyk) -> bool:
    """Find a box z +- r with exactly one equilibrium, within `error` of z, by Krawczyk's test; the larger the better."""
    if not _linearise(frames, z, work):
        return False
    for k in range(_ROWS):
        value = reach = 0.0
        for row in range(_ROWS):
            factor, a, b = work.inverse[k, _ROWS + row], work.parts[0, row], work.parts[1, row]
            value += factor * (a[CENTER] + b[CENTER])
            reach += abs(factor) * (a[SPREAD] + b[SPREAD] + _SLACK * (abs(a[CENTER]) + abs(b[CENTER])))
        work.error[k] = (abs(value) + reach) * (1.0 + _SLACK)
        r[k] = _natural_radius(z, k)
    size = 1.0
    shape = r.copy()
    for attempt in range(_RADII):
        for k in range(_ROWS):
            r[k] = size * shape[k]
        if r[0] >= z[0]:
            r[0] = 0.9 * z[0]
        if r[2] >= z[2]:
            r[2] = 0.9 * z[2]
        if _maps_inside(frames, z, r, error, work):
            _tighten(frames, z, r, error, work)
            return True
        if attempt % 4 == 0 and math.isfinite(error.sum()):
            _reshape(z, error, shape)
        size *= _SHRINK
    return False


@kernel
def _reshape(z: Array, image: Array, shape: Array) -> None:
    """Make the box's shape that of its image, the one that shrinks evenly, within the natural radii."""
    largest = 0.0
    for k in range(_ROWS):
        largest = max(largest, image[k] / _natural_radius(z, k))
    for k in range(_ROWS):
        natural = _natural_radius(z, k)
        shape[k] = max(image[k] / largest, 1e-3 * natural)


@kernel
def _maps_inside(frames: Frames, z: Array, r: Array, image: Array, work: Krawczyk) -> bool:
    """Fill `image` (4,) with how far Krawczyk's operator takes the box z +- r from z; return whether that is inside."""
    _set_contraction(frames, z, r, work)
    is_inside = True
    for k in range(_ROWS):
        image[k] = work.error[k]
        for j in range(_ROWS):
            image[k] += work.bound[k, j] * r[j]
        image[k] *= 1.0 + _SLACK
        is_inside = is_inside and image[k] < r[k]
    return is_inside


@kernel
def _tighten(frames: Frames, z: Array, r: Array, error: Array, work: Krawczyk) -> None:
    """Bound the error of the loads z by a smaller box around them, in which there is an equilibrium as well."""
    trial = work.trial
    for k in range(_ROWS):
        trial[k] = 2.0 * work.error[k] + _SLACK * _natural_radius(z, k)
    while trial[0] < r[0] and trial[1] < r[1] and trial[2] < r[2] and trial[3] < r[3]:
        if _maps_inside(frames, z, trial, error, work):
            return
        for k in range(_ROWS):
            trial[k] *= 4.0
    _maps_inside(frames, z, r, error, work)


@kernel
def _contains(center: Array, r: Array, first: Array, second: Array) -> bool:
    """Return whether two cells lie in a proved box."""
    return _holds(center[0:2], r[0:2], first) and _holds(center[2:4], r[2:4], second)


@kernel
def _holds(center: Array, r: Array, box: Array) -> bool:
    if not abs(box[RHO] - center[0]) + box[RHO_HALF] <= r[0] * (1.0 - _SLACK):
        return False
    gap = abs(box[B] - center[1])
    gap = min(gap, abs(gap - 2.0 * math.pi))
    return gap + box[B_HALF] + 4.0 * _SLACK <= r[1] * (1.0 - _SLACK) or (
        abs(box[B] - center[1]) + box[B_HALF] <= r[1] * (1.0 - _SLACK)
    )


@kernel
def _is_proved(proved: Proved, first: Array, second: Array) -> bool:
    for n in range(proved.count[0]):
        if _contains(proved.center[n], proved.radius[n], first, second):
            return True
    return False


@kernel
def _add(frames: Frames, z: Array, proved: Proved, work: Krawczyk) -> bool:
    """Prove the equilibrium near the loads z; add it if it is new; return whether it is proved."""
    n = proved.count[0]
    if n == proved.center.shape[0] or not _prove(frames, z, proved.radius[n], proved.error[n], work):
        return False
    for other in range(n):
        is_same = True
        for k in range(_ROWS):
            gap = abs(z[k] - proved.center[other, k])
            if k % 2 == 1:
                gap = min(gap, abs(gap - 2.0 * math.pi))
            is_same = is_same and gap + proved.error[n, k] <= proved.radius[other, k]
        if is_same:
            return True
    proved.center[n] = z
    proved.count[0] += 1
    return True


@kernel
def prove_all(frames: Frames, starts: Array, proved: Proved, failed: Integers) -> None:
    """Prove the equilibria near the loads `starts` (m, 4) one by one; mark in `failed` (m,) those without proof."""
    work = make_krawczyk()
    for n in range(starts.shape[0]):
        failed[n] = 0 if _add(frames, starts[n].copy(), proved, work) else 1


@kernel
def join(cells: UnitCells, frames: Frames, proved: Proved, pairs: Integers) -> int:
    """Find the pairs of leaves that may hold an equilibrium outside the proved boxes; return how many there are.

    They are put into `pairs` (m, 2); if there are more than fit, only one more than fit is counted.
    """
    nodes, levels = cells.boxes.shape[0], cells.levels
    parts = np.empty((2, nodes, _ROWS, 5))
    for leg in range(2):
        for node in range(nodes):
            _set_contribution(frames, leg, cells.models[node], parts[leg, node])
    test, span = np.empty((_ROWS, 2 * _ROWS)), np.empty((_ROWS, 2))
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
        if level_2 >= _BAND_LEVEL:
            if _is_proved(proved, cells.boxes[node_1], cells.boxes[node_2]):
                continue
            if not _narrow(parts[0, node_1], parts[1, node_2], test, span):
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


class Undecided(NamedTuple):
    """Pairs of cells, no longer split, that may hold an equilibrium outside the proved boxes."""

    cells: Array  # (m, 2, 4)
    count: Integers  # (1,)
    examined: Integers  # (1,): pairs of cells that were looked at


@kernel
def resolve(
    cells: UnitCells, frames: Frames, pairs: Integers, most: int, proved: Proved, undecided: Undecided
) -> bool:
    """Examine pairs of leaves until all parts are excluded, proved, or too small; False where a limit was met first."""
    work = make_krawczyk()
    stack = np.empty((_DEPTH, 2, 4))
    test, span = np.empty((_ROWS, 2 * _ROWS)), np.empty((_ROWS, 2))
    for n in range(pairs.shape[0]):
        for leg in range(2):
            stack[0, leg] = cells.boxes[pairs[n, leg]]
        top = 1
        while top > 0:
            if undecided.examined[0] >= most or top >= _DEPTH - 1:
                return False
            undecided.examined[0] += 1
            top -= 1
            pair = stack[top]
            if _is_proved(proved, pair[0], pair[1]):
                continue
            for leg in range(2):
                _set_unit_models(pair[leg], work.models)
                _set_contribution(frames, leg, work.models, work.parts[leg])
            if not _may_touch(work.parts[0], work.parts[1]):
                continue
            if not _narrow(work.parts[0], work.parts[1], test, span):
                continue
            if _relative_width(pair, _widest(pair)) < _LEAST_CELL:
                if undecided.count[0] == undecided.cells.shape[0]:
                    return False
                undecided.cells[undecided.count[0]] = pair
                undecided.count[0] += 1
                continue
            least, largest = _narrow_pair(pair, span)
            if largest < _CLEAR:
                _look_for_equilibrium(frames, pair, proved, work)
            if least < _NARROWED:
                top += 1
                continue
            split = _widest(pair)
            leg, k = split // 2, 2 * (split % 2)
            stack[top + 1] = pair
            half = 0.5 * pair[leg, k + 1]
            for child in range(2):
                box = stack[top + child, leg]
                box[k] += half if child == 0 else -half
                box[k + 1] = half * (1.0 + _SLACK) + _SLACK * abs(box[k])
            top += 2
    return True


@kernel
def _relative_width(pair: Array, k: int) -> float:
    """Return the half width of the k-th of the four loads over its natural one."""
    leg = k // 2
    if k % 2 == 0:
        return float(pair[leg, RHO_HALF] / _LARGEST_RADIUS)
    return float(pair[leg, B_HALF] / min(_LARGEST_RADIUS, abs(pair[leg, B]) + math.exp(-abs(pair[leg, RHO]))))


@kernel
def _widest(pair: Array) -> int:
    widest = 0
    for k in range(1, _ROWS):
        if _relative_width(pair, k) > _relative_width(pair, widest):
            widest = k
    return widest


@kernel
def _narrow_pair(pair: Array, span: Array) -> tuple[float, float]:
    """Cut a pair to the bounds of its local coordinates; return the least and the largest part that is left of one."""
    least, largest = 1.0, 0.0
    for k in range(_ROWS):
        box, column = pair[k // 2], 2 * (k % 2)
        part = 0.5 * (span[k, 1] - span[k, 0])
        least, largest = min(least, part), max(largest, part)
        if part < 1.0:
            width = box[column + 1]
            box[column] += 0.5 * (span[k, 0] + span[k, 1]) * width
            box[column + 1] = part * width * (1.0 + 4.0 * _SLACK) + _SLACK * (abs(box[column]) + width)
    return least, largest


@kernel
def _look_for_equilibrium(frames: Frames, pair: Array, proved: Proved, work: Krawczyk) -> None:
    z = work.loads
    for leg in range(2):
        z[2 * leg], z[2 * leg + 1] = pair[leg, RHO], pair[leg, B]
    if _newton(frames, z, work):
        _add(frames, z, proved, work)
