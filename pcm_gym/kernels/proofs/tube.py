"""A tube around a piece of a branch, and the proof that exactly one equilibrium is in it at every place of the piece.

A piece of a straight line in inputs and load is parametrised by s in [-1, 1]. The unknowns z are those of a mechanism
with any number of legs: the loads of its rods, each in its own chart (see `krawczyk`), and the pose. The tube is a
curve, cubic in s, and half widths r around it. F(z, s) = 0 are the equations of `closure`; F along the curve and the
Jacobian J over the tube are polynomials in s with remainders, so that what changes along the piece is not mistaken for
what is unknown. Y is an approximate inverse of J at s = 0. If |Y F| + |1 - Y J| r < r in every component and at every
s, then at every s there is exactly one equilibrium in the tube, J is regular there, and so the equilibria are one
smooth curve (Krawczyk's test with a parameter; Neumaier, Interval methods for systems of equations, 1990, theorem
5.1.8).
"""

import math
from typing import NamedTuple

import numpy as np

from pcm_gym.arrays import Array, Integers
from pcm_gym.kernels.numerics.compilation import kernel
from pcm_gym.kernels.numerics.linear import eliminate
from pcm_gym.kernels.proofs.krawczyk import CARTESIAN, LARGEST_CARTESIAN_LOAD, POLAR, natural_width
from pcm_gym.kernels.proofs.rod_cells import SLACK
from pcm_gym.kernels.proofs.rod_enclosure import (
    RodEnclosure,
    enclose_rod_at,
    enclose_rod_derivatives,
    enclose_slightly_loaded,
)
from pcm_gym.kernels.proofs.taylor_models import (
    Model,
    add,
    along_s,
    constant,
    cosine_and_sine,
    multiply,
    radius,
    scale,
    shift,
    subtract,
    widen,
)
from pcm_gym.kernels.statics.closure import (
    ATTACH_X,
    ATTACH_Y,
    AXIS_X,
    AXIS_Y,
    BASE_X,
    BASE_Y,
    CLAMP_ANGLE,
    LENGTH,
    STIFFNESS,
    TURN,
)

# What is kept of a model that depends on s alone: four coefficients, and the remainder.
_COLUMNS, _REST = 5, 4
# A radius is so many times the error, and what comes back of the other radii times the second; so much more each time
# the test fails.
_ERRORS, _SPARE, _WIDENING, _TRIALS = 4.0, 1.1, 1.5, 3
# More of a radius than this that comes back at its end is too much to try.
_LARGEST_CONTRACTION = 0.9
_ROUNDS = 12
# A radius is at least this part of the natural size of its unknown.
_LEAST_RADIUS = 1e-9


class Tube(NamedTuple):
    """A tube over a piece of a line, and what is worked out of it."""

    parameters: Array  # (legs + d, 2): inputs, then load, at s = 0, and what they change by to s = 1
    curve: Array  # (size, 4): coefficients of the curve
    radius: Array  # (size,): r
    charts: Integers  # (legs,)
    values: Array  # (size, 5): F along the curve
    jacobian: Array  # (size, size, 5): J over the tube
    inverse: Array  # (size, 2 size): its right half is Y
    error: Array  # (size,): bound of |Y F|
    contraction: Array  # (size, size): bound of |1 - Y J|
    row: Array  # (5,)


class Leg(NamedTuple):
    """How a leg is placed along the piece."""

    direction: tuple[Model, Model]  # cosine and sine of the clamp's angle
    clamp: tuple[Model, Model]
    arm: tuple[Model, Model]  # from the end-effector's origin to the hinge


def new_tube(leg_count: int, size: int) -> Tube:
    """Return room for a tube of a mechanism with so many legs and a state of `size` numbers."""
    return Tube(
        np.zeros((size - leg_count, 2)),
        np.zeros((size, 4)),
        np.zeros(size),
        np.zeros(leg_count, dtype=np.int64),
        np.zeros((size, _COLUMNS)),
        np.zeros((size, size, _COLUMNS)),
        np.zeros((size, 2 * size)),
        np.zeros(size),
        np.zeros((size, size)),
        np.zeros(_COLUMNS),
    )


@kernel
def _datum(value: float) -> Model:
    """Return the model of a number that is known up to rounding."""
    return along_s(value, 0.0, SLACK * abs(value))


@kernel
def _parameter(tube: Tube, k: int) -> Model:
    """Return the model of an input or of a component of the load."""
    middle, change = tube.parameters[k, 0], tube.parameters[k, 1]
    return along_s(middle, change, SLACK * (abs(middle) + abs(change)))


@kernel
def _unknown(tube: Tube, k: int, width: float) -> Model:
    """Return the model of an unknown on the curve, or up to `width` beside it."""
    c = tube.curve[k]
    return widen(Model(c[0], c[1], 0.0, c[2], 0.0, 0.0, c[3], 0.0, 0.0, 0.0, 0.0), width)


@kernel
def _turned(direction: tuple[Model, Model], x: Model, y: Model) -> tuple[Model, Model]:
    c, s = direction
    return subtract(multiply(c, x), multiply(s, y)), add(multiply(s, x), multiply(c, y))


@kernel
def _place_leg(legs: Array, leg: int, turn: tuple[Model, Model], tube: Tube) -> Leg:
    """Return how a leg is placed; `turn` are cosine and sine of the platform's angle."""
    row, value = legs[leg], _parameter(tube, leg)
    return Leg(
        cosine_and_sine(add(_datum(row[CLAMP_ANGLE]), multiply(_datum(row[TURN]), value))),
        (
            add(_datum(row[BASE_X]), multiply(_datum(row[AXIS_X]), value)),
            add(_datum(row[BASE_Y]), multiply(_datum(row[AXIS_Y]), value)),
        ),
        _turned(turn, _datum(row[ATTACH_X]), _datum(row[ATTACH_Y])),
    )


@kernel
def _platform_turn(legs: Array, tube: Tube, width: float) -> tuple[Model, Model]:
    """Return cosine and sine of the platform's angle up to `width` beside the curve; of a point 1 and 0."""
    last = 2 * legs.shape[0] + 2
    if tube.curve.shape[0] == last:
        return constant(1.0), constant(0.0)
    return cosine_and_sine(_unknown(tube, last, width))


@kernel
def _put(model: Model, out: Array) -> None:
    """Add a model of s alone to a row (5,)."""
    size = 0.0
    size += abs(model.center) + abs(model.s) + abs(model.ss) + abs(model.sss)
    size += abs(out[0]) + abs(out[1]) + abs(out[2]) + abs(out[3])
    out[0] += model.center
    out[1] += model.s
    out[2] += model.ss
    out[3] += model.sss
    out[_REST] = (out[_REST] + model.remainder + SLACK * size) * (1.0 + SLACK)


@kernel
def _bound(row: Array) -> float:
    """Return the largest absolute value of a row (5,) over all s."""
    bound = abs(row[0] + 0.5 * row[2]) + abs(row[1]) + 0.5 * abs(row[2]) + abs(row[3]) + row[_REST]
    return float((bound + SLACK * (abs(row[0]) + abs(row[2]))) * (1.0 + SLACK))


@kernel
def _slightly_loaded_rod(g_x: Model, g_y: Model) -> RodEnclosure:
    """Return tip and tip force of a slightly loaded rod: its derivatives are all but those of the unloaded one."""
    x, y = g_x.center, g_y.center
    rho, b = math.sqrt(math.hypot(x, y)), math.atan2(-y, x)
    middle = enclose_rod_at(along_s(rho, 0.0, SLACK * rho), along_s(b, 0.0, SLACK))
    step_x, step_y = shift(g_x, -x), shift(g_y, -y)
    load = math.hypot(abs(x) + radius(step_x), abs(y) + radius(step_y)) * (1.0 + SLACK)
    if not load < LARGEST_CARTESIAN_LOAD:
        unknown = widen(constant(0.0), math.inf)
        return RodEnclosure(unknown, unknown, unknown, unknown)
    near, far_x, far_y = enclose_slightly_loaded(load), radius(step_x), radius(step_y)
    return RodEnclosure(
        widen(middle.tip_x, near.tip_x_gx * far_x + near.tip_x_gy * far_y),
        widen(add(middle.tip_y, scale(1.0 / 3.0, step_y)), near.tip_y_gx * far_x + near.tip_y_gy * far_y),
        widen(add(middle.force_x, step_x), near.force_x_gx * far_x + near.force_x_gy * far_y),
        widen(add(middle.force_y, step_y), near.force_y_gx * far_x + near.force_y_gy * far_y),
    )


@kernel
def _slightly_loaded_derivatives(g_x: Model, g_y: Model) -> tuple[RodEnclosure, RodEnclosure]:
    """Return the derivatives of tip and tip force of a slightly loaded rod by g_x and by g_y."""
    load = math.hypot(abs(g_x.center) + radius(g_x), abs(g_y.center) + radius(g_y)) * (1.0 + SLACK)
    if not load < LARGEST_CARTESIAN_LOAD:
        unknown = widen(constant(0.0), math.inf)
        nothing = RodEnclosure(unknown, unknown, unknown, unknown)
        return nothing, nothing
    near = enclose_slightly_loaded(load)
    return (
        RodEnclosure(
            along_s(0.0, 0.0, near.tip_x_gx),
            along_s(0.0, 0.0, near.tip_y_gx),
            along_s(1.0, 0.0, near.force_x_gx),
            along_s(0.0, 0.0, near.force_y_gx),
        ),
        RodEnclosure(
            along_s(0.0, 0.0, near.tip_x_gy),
            widen(constant(1.0 / 3.0), near.tip_y_gy),
            along_s(0.0, 0.0, near.force_x_gy),
            along_s(1.0, 0.0, near.force_y_gy),
        ),
    )


@kernel
def _in_world(legs: Array, leg: int, placed: Leg, rod: RodEnclosure) -> RodEnclosure:
    """Return tip and tip force of the unit rod, or derivatives of them, in the world's frame and units."""
    length = _datum(legs[leg, LENGTH])
    force = _datum(legs[leg, STIFFNESS] / (legs[leg, LENGTH] * legs[leg, LENGTH]))
    tip_x, tip_y = _turned(placed.direction, rod.tip_x, rod.tip_y)
    force_x, force_y = _turned(placed.direction, rod.force_x, rod.force_y)
    return RodEnclosure(
        multiply(length, tip_x), multiply(length, tip_y), multiply(force, force_x), multiply(force, force_y)
    )


@kernel
def set_values(legs: Array, tube: Tube) -> None:
    """Fill in F along the curve."""
    values, pose = tube.values, 2 * legs.shape[0]
    dof = values.shape[0] - pose
    values[:] = 0.0
    turn = _platform_turn(legs, tube, 0.0)
    for leg in range(legs.shape[0]):
        placed = _place_leg(legs, leg, turn, tube)
        first, second = _unknown(tube, 2 * leg, 0.0), _unknown(tube, 2 * leg + 1, 0.0)
        own = enclose_rod_at(first, second) if tube.charts[leg] == POLAR else _slightly_loaded_rod(first, second)
        rod = _in_world(legs, leg, placed, own)
        _put(placed.clamp[0], values[2 * leg])
        _put(placed.clamp[1], values[2 * leg + 1])
        _put(rod.tip_x, values[2 * leg])
        _put(rod.tip_y, values[2 * leg + 1])
        for d in range(2):
            _put(scale(-1.0, _unknown(tube, pose + d, 0.0)), values[2 * leg + d])
        _put(scale(-1.0, placed.arm[0]), values[2 * leg])
        _put(scale(-1.0, placed.arm[1]), values[2 * leg + 1])
        _put(rod.force_x, values[pose])
        _put(rod.force_y, values[pose + 1])
        if dof == 3:
            _put(_moment(placed.arm, rod), values[pose + 2])
    for d in range(dof):
        _put(scale(-1.0, _parameter(tube, legs.shape[0] + d)), values[pose + d])


@kernel
def _moment(arm: tuple[Model, Model], rod: RodEnclosure) -> Model:
    return subtract(multiply(arm[0], rod.force_y), multiply(arm[1], rod.force_x))


@kernel
def set_jacobian(legs: Array, tube: Tube) -> None:
    """Fill in J over the tube."""
    jacobian, pose, r = tube.jacobian, 2 * legs.shape[0], tube.radius
    is_platform = jacobian.shape[0] - pose == 3
    jacobian[:] = 0.0
    turn = _platform_turn(legs, tube, r[pose + 2] if is_platform else 0.0)
    for leg in range(legs.shape[0]):
        placed = _place_leg(legs, leg, turn, tube)
        first, second = _unknown(tube, 2 * leg, r[2 * leg]), _unknown(tube, 2 * leg + 1, r[2 * leg + 1])
        if tube.charts[leg] == POLAR:
            own, by_first, by_second = enclose_rod_derivatives(first, second)
        else:
            own = _slightly_loaded_rod(first, second)
            by_first, by_second = _slightly_loaded_derivatives(first, second)
        for k, change in ((2 * leg, by_first), (2 * leg + 1, by_second)):
            rate = _in_world(legs, leg, placed, change)
            _put(rate.tip_x, jacobian[2 * leg, k])
            _put(rate.tip_y, jacobian[2 * leg + 1, k])
            _put(rate.force_x, jacobian[pose, k])
            _put(rate.force_y, jacobian[pose + 1, k])
            if is_platform:
                _put(_moment(placed.arm, rate), jacobian[pose + 2, k])
        jacobian[2 * leg, pose, 0] = -1.0
        jacobian[2 * leg + 1, pose + 1, 0] = -1.0
        if is_platform:
            rod, arm = _in_world(legs, leg, placed, own), placed.arm
            _put(arm[1], jacobian[2 * leg, pose + 2])
            _put(scale(-1.0, arm[0]), jacobian[2 * leg + 1, pose + 2])
            pull = add(multiply(arm[0], rod.force_x), multiply(arm[1], rod.force_y))
            _put(scale(-1.0, pull), jacobian[pose + 2, pose + 2])


@kernel
def set_inverse(tube: Tube) -> bool:
    """Fill in Y; return whether it exists."""
    size, inverse = tube.radius.shape[0], tube.inverse
    for row in range(size):
        for k in range(size):
            inverse[row, k] = tube.jacobian[row, k, 0]
            inverse[row, size + k] = 1.0 if k == row else 0.0
    return eliminate(inverse, size, 2 * size)


@kernel
def _combine(tube: Tube, k: int, rows: Array, start: float) -> float:
    """Bound start + the k-th row of Y times `rows` (size, 5)."""
    total, size = tube.row, rows.shape[0]
    total[:] = 0.0
    total[0] = start
    magnitude = abs(start)
    for row in range(size):
        factor = tube.inverse[k, size + row]
        for column in range(_REST):
            part = factor * rows[row, column]
            total[column] += part
            magnitude += abs(part)
        total[_REST] += abs(factor) * rows[row, _REST]
    total[_REST] = (total[_REST] + SLACK * magnitude) * (1.0 + SLACK)
    return _bound(total)


@kernel
def set_error(tube: Tube) -> None:
    """Fill in the bound of |Y F|."""
    for k in range(tube.error.shape[0]):
        tube.error[k] = _combine(tube, k, tube.values, 0.0)


@kernel
def set_contraction(tube: Tube) -> None:
    """Fill in the bound of |1 - Y J|."""
    size = tube.error.shape[0]
    for k in range(size):
        for j in range(size):
            tube.contraction[k, j] = _combine(tube, k, tube.jacobian[:, j], -1.0 if k == j else 0.0)


@kernel
def image(tube: Tube, r: Array, k: int) -> float:
    """Return how far Krawczyk's operator takes what is up to r beside the curve, in the k-th unknown."""
    reach = tube.error[k]
    for j in range(r.shape[0]):
        reach += tube.contraction[k, j] * r[j]
    return float(reach * (1.0 + SLACK))


@kernel
def natural_size(tube: Tube, k: int) -> float:
    """Return a change of the k-th unknown that is of the order of its own size."""
    if k >= 2 * tube.charts.shape[0] or tube.charts[k // 2] == CARTESIAN:
        return 1.0
    first = k - k % 2
    return natural_width(tube.curve[first, 0], tube.curve[first + 1, 0], k)


@kernel
def _choose_radius(tube: Tube) -> float:
    """Choose r so that the test holds if J varies no more over the tube than along its curve.

    Returns the largest part of a radius that comes back, inf where r grows without end.
    """
    r, size, ratio = tube.radius, tube.radius.shape[0], 0.0
    for k in range(size):
        r[k] = _ERRORS * tube.error[k] + _LEAST_RADIUS * natural_size(tube, k)
    for _ in range(_ROUNDS):
        ratio = 0.0
        for k in range(size):
            back = _SPARE * (image(tube, r, k) - tube.error[k])
            reach = back + _ERRORS * tube.error[k] + _LEAST_RADIUS * natural_size(tube, k)
            ratio = max(ratio, back / reach)
            r[k] = max(r[k], reach)
            if not r[k] < natural_size(tube, k):
                return math.inf
    return ratio


@kernel
def _test(tube: Tube) -> float:
    """Return the largest part of a radius that comes back, the error included; below 1 the tube is proved."""
    largest = 0.0
    for k in range(tube.radius.shape[0]):
        part = image(tube, tube.radius, k) / tube.radius[k]
        if not part < math.inf:  # max() would drop a nan
            return math.inf
        largest = max(largest, part)
    return largest


@kernel
def prove_tube(legs: Array, tube: Tube) -> tuple[bool, float]:
    """Choose the radius of a tube around its curve and try to prove it.

    Returns whether it is proved, and how much of a radius comes back at a thin tube: about proportional to the length
    of the piece, and 1 at most.
    """
    tube.radius[:] = 0.0
    set_jacobian(legs, tube)
    if not set_inverse(tube):
        return False, math.inf
    set_values(legs, tube)
    set_error(tube)
    set_contraction(tube)
    ratio = _choose_radius(tube)
    if not ratio < _LARGEST_CONTRACTION:
        return False, ratio
    for _ in range(_TRIALS):
        set_jacobian(legs, tube)
        set_contraction(tube)
        part = _test(tube)
        if part < 1.0:
            return True, ratio
        if not part < math.inf:
            return False, ratio
        for k in range(tube.radius.shape[0]):
            tube.radius[k] = _WIDENING * max(tube.radius[k], image(tube, tube.radius, k))
    return False, ratio


@kernel
def bound_error(tube: Tube, out: Array) -> None:
    """Bound, in `out` (size,), how far the equilibrium of a proved tube is from a point of its curve.

    `tube.error` must be the bound of |Y F| at the point. What the test takes into itself holds the equilibrium.
    """
    size = out.shape[0]
    out[:] = tube.error
    for _ in range(_ROUNDS):
        for k in range(size):
            out[k] = max(out[k], _SPARE * image(tube, out, k))
    for k in range(size):
        if not (image(tube, out, k) < out[k] <= tube.radius[k]):
            out[:] = tube.radius
            return
