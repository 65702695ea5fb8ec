"""Boxes of loads that hold exactly one equilibrium each, proved by Krawczyk's test.

The unknowns z are the loads of the two rods, each in its own chart: (rho, b), or, for a rod that is nearly unloaded,
the load g = rho^2 (cos b, -sin b) itself, in which everything is smooth at zero. F(z) = 0 are the equations of
`rod_cells`, J their Jacobian, enclosed over the whole box, and Y an approximate inverse. If |Y F(z)| + |1 - Y J| r < r
in every component, the box z +- r holds exactly one equilibrium (Krawczyk 1969; Neumaier, Interval methods for systems
of equations, 1990, theorem 5.1.8).
"""

import math
from typing import NamedTuple

import numpy as np

from pcm_gym.arrays import Array, Integers
from pcm_gym.kernels.numerics.compilation import kernel
from pcm_gym.kernels.numerics.linear import eliminate
from pcm_gym.kernels.proofs.rod_cells import (
    B_HALF,
    CENTER,
    PLACED,
    RHO,
    RHO_HALF,
    ROWS,
    SLACK,
    SPREAD,
    TURNABLE,
    B,
    Frames,
    set_contribution,
    set_unit_models,
)
from pcm_gym.kernels.proofs.rod_enclosure import (
    enclose_rod_derivatives,
    enclose_slightly_loaded,
    enclose_turnable_derivatives,
)
from pcm_gym.kernels.proofs.taylor_models import Model, along_s, along_t, bounds

# The charts of a rod's load.
POLAR, CARTESIAN = range(2)
# Below this rho the load itself is the chart; the equations are known over loads |g| up to the second number.
CARTESIAN_RHO = 0.3
LARGEST_CARTESIAN_LOAD = 0.9
# A change of a load that is of the order of its own size is at most this.
_LARGEST_RADIUS = 0.5
_NEWTON_STEPS = 20
_LAST_CORRECTION = 1e-11
# Sizes of boxes tried around an equilibrium, each smaller than the one before; the shape is adapted in every fourth.
_SIZES, _SHRINK = 60, 0.7
_THINNEST = 1e-3


class Proved(NamedTuple):
    """Boxes that hold exactly one equilibrium each."""

    center: Array  # (m, 4): the loads of the approximate equilibrium
    radius: Array  # (m, 4): half widths of the box
    error: Array  # (m, 4): half widths of a smaller box that holds the equilibrium
    charts: Integers  # (m, 2): of each rod
    total: Integers  # (1,): how many there are


class Krawczyk(NamedTuple):
    """Scratch arrays of the test, and of the search around it."""

    box: Array  # (4,)
    models: Array  # (4, 4)
    parts: Array  # (2, 4, 5): the contributions
    middle: Array  # (4, 4): centre of the Jacobian's enclosure
    half_width: Array  # (4, 4)
    inverse: Array  # (4, 8): its right half is the approximate inverse Y
    unit: Array  # (4,), with the next: intervals of a derivative of the unit rod
    unit_half: Array  # (4,)
    value: Array  # (4,): bound of |Y F(z)|
    trial: Array  # (4,)
    loads: Array  # (4,)
    span: Array  # (4, 2)
    charts: Integers  # (2,)


def make_proved(capacity: int) -> Proved:
    """Return room for so many boxes."""
    return Proved(
        np.zeros((capacity, 4)),
        np.zeros((capacity, 4)),
        np.zeros((capacity, 4)),
        np.zeros((capacity, 2), dtype=np.int64),
        np.zeros(1, dtype=np.int64),
    )


@kernel
def make_krawczyk() -> Krawczyk:
    """Return the scratch arrays."""
    return Krawczyk(
        np.zeros(4),
        np.zeros((4, 4)),
        np.zeros((2, 4, 5)),
        np.zeros((4, 4)),
        np.zeros((4, 4)),
        np.zeros((4, 8)),
        np.zeros(4),
        np.zeros(4),
        np.zeros(4),
        np.zeros(4),
        np.zeros(4),
        np.zeros((4, 2)),
        np.zeros(2, dtype=np.int64),
    )


@kernel
def natural_width(rho: float, b: float, k: int) -> float:
    """Return a change of rho (k even) or b (odd) that is of the order of the rod's own size, small in tension."""
    return _LARGEST_RADIUS if k % 2 == 0 else min(_LARGEST_RADIUS, abs(b) + math.exp(-abs(rho)))


@kernel
def _natural_radius(z: Array, charts: Integers, k: int) -> float:
    first = k - k % 2
    return _LARGEST_RADIUS if charts[k // 2] == CARTESIAN else natural_width(z[first], z[first + 1], k)


@kernel
def _polar(z: Array, charts: Integers, leg: int) -> tuple[float, float]:
    """Return rho and b of a rod."""
    first, second = z[2 * leg], z[2 * leg + 1]
    if charts[leg] == POLAR:
        return first, second
    return math.sqrt(math.hypot(first, second)), math.atan2(-second, first)


@kernel
def _set_values(frames: Frames, z: Array, charts: Integers, work: Krawczyk) -> None:
    """Enclose what the legs add to the equations at the loads z."""
    box = work.box
    for leg in range(2):
        box[RHO], box[B] = _polar(z, charts, leg)
        box[RHO_HALF], box[B_HALF] = 0.0, 0.0
        set_unit_models(box, frames.kinds[leg], work.models)
        set_contribution(frames, leg, work.models, work.parts[leg])


@kernel
def _set_jacobian(frames: Frames, z: Array, r: Array, charts: Integers, work: Krawczyk) -> None:
    """Enclose the Jacobian over the box z +- r."""
    for leg in range(2):
        first, second = z[2 * leg], z[2 * leg + 1]
        if charts[leg] == POLAR:
            rho, b = along_s(first, r[2 * leg], 0.0), along_t(second, r[2 * leg + 1], 0.0)
            for k in range(2):
                _set_polar_bounds(frames.kinds[leg], rho, b, k, work)
                column = 2 * leg + k
                _set_column(frames, leg, work.unit, work.unit_half, work.middle[:, column], work.half_width[:, column])
        else:
            load = math.hypot(abs(first) + r[2 * leg], abs(second) + r[2 * leg + 1]) * (1.0 + SLACK)
            for k in range(2):
                _set_cartesian_bounds(load, k, work.unit, work.unit_half)
                column = 2 * leg + k
                _set_column(frames, leg, work.unit, work.unit_half, work.middle[:, column], work.half_width[:, column])


@kernel
def _set_polar_bounds(kind: int, rho: Model, b: Model, k: int, work: Krawczyk) -> None:
    """Put intervals of the derivatives by rho (k = 0) or b of the unit rod's quantities into the scratch arrays."""
    middle, half_width = work.unit, work.unit_half
    if kind == TURNABLE:
        own = enclose_turnable_derivatives(rho, b)[k]
        middle[0], half_width[0] = bounds(own.dot)
        middle[1], half_width[1] = bounds(own.cross)
        middle[2], half_width[2] = bounds(own.square)
        middle[3] = half_width[3] = 0.0
        return
    _, by_rho, by_b = enclose_rod_derivatives(rho, b)
    change = by_rho if k == 0 else by_b
    middle[0], half_width[0] = bounds(change.force_x)
    middle[1], half_width[1] = bounds(change.force_y)
    middle[2], half_width[2] = bounds(change.tip_x)
    middle[3], half_width[3] = bounds(change.tip_y)


@kernel
def _set_cartesian_bounds(load: float, k: int, middle: Array, half_width: Array) -> None:
    """Put intervals of the derivatives by g_x (k = 0) or g_y over all loads up to `load` into (4,) and (4,)."""
    middle[:] = 0.0
    middle[k] = 1.0
    middle[3] = k / 3.0
    if load > LARGEST_CARTESIAN_LOAD:
        half_width[:] = math.inf
        return
    near = enclose_slightly_loaded(load)
    half_width[0] = near.force_x_gx if k == 0 else near.force_x_gy
    half_width[1] = near.force_y_gx if k == 0 else near.force_y_gy
    half_width[2] = near.tip_x_gx if k == 0 else near.tip_x_gy
    half_width[3] = near.tip_y_gx if k == 0 else near.tip_y_gy


@kernel
def _set_column(frames: Frames, leg: int, unit: Array, unit_half: Array, middle: Array, half_width: Array) -> None:
    """Turn and scale intervals of a derivative of the unit rod's quantities into a column of the Jacobian."""
    for row in range(ROWS):
        x = frames.sources[leg, row]
        y, by_x, by_y = x + 1, frames.factors[leg, row, 0], frames.factors[leg, row, 1]
        middle[row], half_width[row] = by_x * unit[x] + by_y * unit[y], 0.0
        if frames.sizes[leg, row] > 0.0:
            size = abs(unit[x]) + abs(unit[y]) + unit_half[x] + unit_half[y]
            rounding = frames.relative_slack[0] * frames.sizes[leg, row] * size
            half_width[row] = (abs(by_x) * unit_half[x] + abs(by_y) * unit_half[y] + rounding) * (1.0 + SLACK)


@kernel
def _linearise(frames: Frames, z: Array, charts: Integers, work: Krawczyk) -> bool:
    """Fill values, Jacobian and approximate inverse at the loads z; return whether that exists."""
    work.trial[:] = 0.0
    _set_values(frames, z, charts, work)
    _set_jacobian(frames, z, work.trial, charts, work)
    for row in range(ROWS):
        for k in range(ROWS):
            work.inverse[row, k] = work.middle[row, k]
            work.inverse[row, ROWS + k] = 1.0 if k == row else 0.0
    return eliminate(work.inverse, ROWS, 2 * ROWS)


@kernel
def _choose_charts(frames: Frames, z: Array, charts: Integers) -> None:
    """Change polar loads in place to the charts that suit them.

    A rod whose clamp may be turned stays in the polar one: unloaded it is straight, where the inverse problem folds.
    """
    for leg in range(2):
        rho, b = z[2 * leg], z[2 * leg + 1]
        charts[leg] = POLAR
        if rho < CARTESIAN_RHO and frames.kinds[leg] == PLACED:
            charts[leg] = CARTESIAN
            z[2 * leg], z[2 * leg + 1] = rho * rho * math.cos(b), -rho * rho * math.sin(b)


@kernel
def correct(frames: Frames, z: Array, work: Krawczyk) -> bool:
    """Correct the polar loads z in place to the equilibrium near them; return whether that converged."""
    charts = work.charts
    _choose_charts(frames, z, charts)
    for _ in range(_NEWTON_STEPS):
        if not _linearise(frames, z, charts, work):
            return False
        size = 0.0
        for k in range(ROWS):
            step = 0.0
            for row in range(ROWS):
                step += work.inverse[k, ROWS + row] * (work.parts[0, row, CENTER] + work.parts[1, row, CENTER])
            natural = _natural_radius(z, charts, k)
            z[k] -= step
            size = max(size, abs(step) / natural)
            if not abs(step) < natural:
                return False
        if size < _LAST_CORRECTION:
            for leg in range(2):
                z[2 * leg], z[2 * leg + 1] = _polar(z, charts, leg)
            return bool(z[0] >= 0.0 and z[2] >= 0.0)
    return False


@kernel
def _maps_inside(frames: Frames, z: Array, r: Array, charts: Integers, image: Array, work: Krawczyk) -> bool:
    """Fill `image` (4,) with how far Krawczyk's operator takes the box z +- r from z; return whether that is inside."""
    _set_jacobian(frames, z, r, charts, work)
    is_inside = True
    for k in range(ROWS):
        image[k] = work.value[k]
        for j in range(ROWS):
            product, rounding, spread = -1.0 if k == j else 0.0, 1.0, 0.0
            for row in range(ROWS):
                factor = work.inverse[k, ROWS + row]
                product += factor * work.middle[row, j]
                rounding += abs(factor * work.middle[row, j])
                spread += abs(factor) * work.half_width[row, j]
            image[k] += (abs(product) + spread + SLACK * rounding) * (1.0 + SLACK) * r[j]
        image[k] *= 1.0 + SLACK
        is_inside = is_inside and image[k] < r[k]
    return is_inside


@kernel
def _prove(frames: Frames, z: Array, charts: Integers, r: Array, error: Array, work: Krawczyk) -> bool:
    """Find a box z +- r that holds exactly one equilibrium, the larger the better, and bound its error."""
    if not _linearise(frames, z, charts, work):
        return False
    for k in range(ROWS):
        value = reach = 0.0
        for row in range(ROWS):
            factor, a, b = work.inverse[k, ROWS + row], work.parts[0, row], work.parts[1, row]
            value += factor * (a[CENTER] + b[CENTER])
            reach += abs(factor) * (a[SPREAD] + b[SPREAD] + SLACK * (abs(a[CENTER]) + abs(b[CENTER])))
        # the second part: the change from g to the polar chart is rounded
        work.value[k] = (abs(value) + reach) * (1.0 + SLACK) + SLACK * abs(z[k])
        work.loads[k] = _natural_radius(z, charts, k)
    size, shape = 1.0, work.loads
    for attempt in range(_SIZES):
        for k in range(ROWS):
            r[k] = size * shape[k]
            if k % 2 == 0 and charts[k // 2] == POLAR:
                r[k] = min(r[k], 0.9 * z[k])
        if _maps_inside(frames, z, r, charts, error, work):
            _tighten(frames, z, charts, r, error, work)
            return True
        if attempt % 4 == 0 and math.isfinite(error.sum()):
            _reshape(z, charts, error, shape)
        size *= _SHRINK
    return False


@kernel
def _reshape(z: Array, charts: Integers, image: Array, shape: Array) -> None:
    """Make the box's shape that of its image, the one that shrinks evenly, within the natural radii."""
    largest = 0.0
    for k in range(ROWS):
        largest = max(largest, image[k] / _natural_radius(z, charts, k))
    for k in range(ROWS):
        shape[k] = max(image[k] / largest, _THINNEST * _natural_radius(z, charts, k))


@kernel
def _tighten(frames: Frames, z: Array, charts: Integers, r: Array, error: Array, work: Krawczyk) -> None:
    """Find a small box that the test maps into itself: the equilibrium of the box z +- r is in there."""
    trial = work.trial
    for k in range(ROWS):
        trial[k] = 2.0 * work.value[k] + SLACK * _natural_radius(z, charts, k)
    while trial[0] < r[0] and trial[1] < r[1] and trial[2] < r[2] and trial[3] < r[3]:
        if _maps_inside(frames, z, trial, charts, error, work):
            return
        for k in range(ROWS):
            trial[k] *= 4.0
    error[:] = r


@kernel
def is_proved(proved: Proved, first: Array, second: Array) -> bool:
    """Return whether a pair of cells, one of each rod, lies in a proved box: it holds no other equilibrium."""
    n = 0
    while n < proved.total[0] and not (_holds(proved, n, 0, first) and _holds(proved, n, 1, second)):
        n += 1
    return bool(n < proved.total[0])


@kernel
def _holds(proved: Proved, n: int, leg: int, cell: Array) -> bool:
    """Return whether a cell of a rod lies in its part of a proved box."""
    first, second = proved.center[n, 2 * leg], proved.center[n, 2 * leg + 1]
    r_first, r_second = proved.radius[n, 2 * leg] * (1.0 - SLACK), proved.radius[n, 2 * leg + 1] * (1.0 - SLACK)
    rho, b = cell[RHO], cell[B]
    if proved.charts[n, leg] == POLAR:
        gap = abs(b - second)
        if gap > math.pi:  # the same direction, once around
            gap = abs(gap - 2.0 * math.pi) + SLACK
        return bool(abs(rho - first) + cell[RHO_HALF] <= r_first and gap + cell[B_HALF] <= r_second)
    # |g - g_c| <= |rho^2 - rho_c^2| + rho_c^2 |b - b_c|
    load = rho * rho
    largest = rho + cell[RHO_HALF]
    reach = (largest * largest - load + load * cell[B_HALF]) * (1.0 + SLACK) + SLACK * load
    x, y = load * math.cos(b), -load * math.sin(b)
    return bool(abs(x - first) + reach <= r_first and abs(y - second) + reach <= r_second)


@kernel
def _is_known(proved: Proved, z: Array, charts: Integers, error: Array) -> bool:
    """Return whether the equilibrium within `error` of z lies in a proved box."""
    for n in range(proved.total[0]):
        is_inside = charts[0] == proved.charts[n, 0] and charts[1] == proved.charts[n, 1]
        for k in range(ROWS):
            gap = abs(z[k] - proved.center[n, k])
            if k % 2 == 1 and charts[k // 2] == POLAR and gap > math.pi:
                gap = abs(gap - 2.0 * math.pi) + SLACK
            is_inside = is_inside and gap + error[k] <= proved.radius[n, k] * (1.0 - SLACK)
        if is_inside:
            return True
    return False


@kernel
def _is_apart(proved: Proved, z: Array, charts: Integers, error: Array) -> bool:
    """Return whether the equilibrium within `error` of z is another than all those that are proved."""
    for n in range(proved.total[0]):
        is_other = False
        for leg in range(2):
            if charts[leg] != proved.charts[n, leg]:
                # one is above and one below the rho where the charts meet; between the two there is no doubt
                rho, _ = _polar(z, charts, leg)
                other, _ = _polar(proved.center[n], proved.charts[n], leg)
                is_other = is_other or abs(rho - other) > 1e-3
                continue
            for k in range(2 * leg, 2 * leg + 2):
                gap = abs(z[k] - proved.center[n, k])
                if k % 2 == 1 and charts[leg] == POLAR and gap > math.pi:
                    gap = abs(gap - 2.0 * math.pi) - SLACK
                is_other = is_other or gap > (error[k] + proved.error[n, k]) * (1.0 + SLACK)
        if not is_other:
            return False
    return True


@kernel
def prove(frames: Frames, z: Array, proved: Proved, work: Krawczyk) -> bool:
    """Prove the equilibrium near the polar loads z, which are changed; keep its box if it is new.

    Returns whether the equilibrium is proved.
    """
    n = proved.total[0]
    if n == proved.center.shape[0]:
        return False
    charts = proved.charts[n]
    _choose_charts(frames, z, charts)
    if not _prove(frames, z, charts, proved.radius[n], proved.error[n], work):
        return False
    if _is_known(proved, z, charts, proved.error[n]):
        return True
    if not _is_apart(proved, z, charts, proved.error[n]):
        return False
    proved.center[n] = z
    proved.total[0] += 1
    return True
