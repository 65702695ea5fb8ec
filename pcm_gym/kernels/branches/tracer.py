"""Pseudo-arclength continuation of any smooth curve of equilibria: tangent, predictor, corrector, change of a sign.

Symbols: y = (x, p) are the unknowns, the state and parameters on which inputs and load depend linearly; r(y) is the
residual, C the linear conditions that hold along the curve, d(y) the singularity, if its states are singular; M is the
metric in which lengths are measured, t the unit tangent at the last point y_0, and b = M t the border. The point at
`arc` from y_0 is where the curve meets the plane across the tangent. Newton's correction z of a trial y solves

    | r_x  r_p |       | -r                 |
    |    d_y   |  z =  | -d                 |
    |     C    |       | -C (y - y_0)       |
    |     b'   |       | arc - b' (y - y_0) |

and the tangent at y is the solution of the same system for the right side (0, ..., 0, 1). It is regular also at folds.
"""

import math
from typing import NamedTuple

import numpy as np

from pcm_gym.arrays import Array
from pcm_gym.kernels.branches.singularity import metric_length, set_singularity_gradient, singularity
from pcm_gym.kernels.numerics.compilation import formula, kernel
from pcm_gym.kernels.numerics.linear import solve_linear
from pcm_gym.kernels.statics.closure import (
    FORCE_G,
    FORCE_X,
    FORCE_Y,
    Workspace,
    derivatives,
    make_workspace,
    place,
    set_matrix,
    set_path_derivative,
    set_residual,
)
from pcm_gym.kernels.statics.newton import CONVERGED, NewtonRules, accept_correction, correction_size

# In place of a kind of singularity: the states of the curve need not be singular.
REGULAR = -1


class Family(NamedTuple):
    """Equilibria with the inputs `inputs` + p `input_rates` and the load `load` + p `load_rates`; a curve of them.

    Of singular states the parameters must be the inputs themselves.
    """

    inputs: Array  # (legs,)
    load: Array  # (d,)
    input_rates: Array  # (m, legs)
    load_rates: Array  # (m, d)
    conditions: Array  # (k, size + m): C; k = m - 1, of singular states m - 2
    singularity: int  # kind that all states have, or REGULAR
    # Whether the only parameter is the fraction of a way. Its changes do not count as corrections, and in the metric
    # rods count by their own forces; with inputs as parameters by their tips, and forces relative to all rods'.
    is_way: bool


class Tracer(NamedTuple):
    """Where the tracing of a curve is, and scratch arrays; all points and vectors are (size + m,)."""

    family: Family
    work: Workspace  # its rod table is that of the point last looked at
    inputs: Array  # (legs,) of that point
    load: Array  # (d,)
    y: Array  # last point
    tangent: Array  # of unit length
    border: Array  # metric times tangent
    trial: Array
    trial_tangent: Array
    matrix: Array  # (size + m, size + m)
    vector: Array


class BracketRules(NamedTuple):
    """How a change of sign is closed in on by regula falsi."""

    trials: int
    bisect_every: int  # of so many trials the last is in the middle: the others may creep from one side
    least_part: float  # no trial is nearer to an end than this part of the bracket
    weight: float  # of the value at an end that stays again: 0.5 is Illinois' rule, 1 the plain one
    tolerance: float


class Bracket(NamedTuple):
    """Two arcs between which a value changes its sign, with the values there."""

    low: float
    low_value: float
    high: float
    high_value: float
    kept: int  # which end the last trial took the place of: 1 low, -1 high, 0 there was none


@kernel
def make_tracer(family: Family, size: int) -> Tracer:
    """Return a tracer of curves in a family for a state of `size` numbers, at no point yet."""
    leg_count, dof = family.inputs.shape[0], family.load.shape[0]
    count = size + family.input_rates.shape[0]
    return Tracer(
        family,
        make_workspace(leg_count, size),
        np.zeros(leg_count),
        np.zeros(dof),
        np.zeros(count),
        np.zeros(count),
        np.zeros(count),
        np.zeros(count),
        np.zeros(count),
        np.zeros((count, count)),
        np.zeros(count),
    )


@kernel
def set_parameters(y: Array, t: Tracer) -> None:
    """Fill inputs and load for the unknowns `y`."""
    family, size = t.family, t.work.step.shape[0]
    t.inputs[:] = family.inputs
    t.load[:] = family.load
    for k in range(family.input_rates.shape[0]):
        for i in range(t.inputs.shape[0]):
            t.inputs[i] += y[size + k] * family.input_rates[k, i]
        for d in range(t.load.shape[0]):
            t.load[d] += y[size + k] * family.load_rates[k, d]


@kernel
def place_at(legs: Array, y: Array, t: Tracer) -> None:
    """Fill inputs, load and rod table for the unknowns `y`."""
    set_parameters(y, t)
    place(legs, y[: t.work.step.shape[0]], t.inputs, t.work)


@kernel
def start(legs: Array, sign: float, t: Tracer) -> bool:
    """Take the tangent at `y` on the side of the border, times `sign`; return whether there is one."""
    t.trial[:] = t.y
    if not _set_tangent(legs, t):
        return False
    t.trial_tangent[:] *= sign
    accept(legs, t)
    return True


@kernel
def accept(legs: Array, t: Tracer) -> None:
    """Make the trial, whose rod table is set, the last point."""
    t.y[:] = t.trial
    t.tangent[:] = t.trial_tangent
    length_of(legs, t.tangent, t, t.border)


@kernel
def move(legs: Array, arc: float, rules: NewtonRules, t: Tracer) -> bool:
    """Put the point at `arc` into the trial, with tangent and rod table; return whether that succeeded."""
    return correct(legs, arc, rules, t) and _set_tangent(legs, t)


@kernel
def correct(legs: Array, arc: float, rules: NewtonRules, t: Tracer) -> bool:
    """Put the point at `arc` into the trial; return whether that succeeded."""
    for j in range(t.y.shape[0]):
        t.trial[j] = t.y[j] + arc * t.tangent[j]
    previous = math.inf
    for iteration in range(rules.iterations):
        _set_system(legs, arc, t)
        if not solve_linear(t.matrix, t.vector, t.vector.shape[0]):
            return False
        size = _correction_size(legs, t)
        verdict = accept_correction(size, previous, iteration == 0, rules)
        if verdict > CONVERGED:
            return False
        t.trial[:] += t.vector
        if verdict == CONVERGED:
            return True
        previous = size
    return False


@kernel
def _correction_size(legs: Array, t: Tracer) -> float:
    """Return the size of the correction `t.vector` of the trial."""
    size = t.work.step.shape[0]
    t.work.step[:] = t.vector[:size]
    largest = correction_size(legs, t.trial[:size], t.work)
    if not t.family.is_way:
        for j in range(size, t.vector.shape[0]):
            largest = max(largest, abs(t.vector[j]))
    return largest


@kernel
def _set_tangent(legs: Array, t: Tracer) -> bool:
    """Fill the trial's unit tangent, on the side of the border, and its rod table; return whether there is one."""
    _set_system(legs, 0.0, t)
    t.vector[:] = 0.0
    t.vector[-1] = 1.0
    if not solve_linear(t.matrix, t.vector, t.vector.shape[0]):
        return False
    t.trial_tangent[:] = t.vector
    length = length_of(legs, t.trial_tangent, t, t.vector)
    t.trial_tangent[:] /= length
    return length > 0.0 and math.isfinite(length)


@kernel
def _set_system(legs: Array, arc: float, t: Tracer) -> None:
    """Fill matrix and right side of Newton's method at the trial, and its rod table."""
    family, work, y = t.family, t.work, t.trial
    count, size = y.shape[0], work.step.shape[0]
    x, row = y[:size], size
    if family.singularity != REGULAR:
        set_singularity_gradient(legs, y, family.singularity, t.vector, work, t.matrix[row])
    place_at(legs, y, t)
    if family.singularity != REGULAR:
        t.vector[row] = -singularity(legs, y, family.singularity, work)
        row += 1
    for condition in family.conditions:
        t.matrix[row] = condition
        t.vector[row] = 0.0
        for j in range(count):
            t.vector[row] -= condition[j] * (y[j] - t.y[j])
        row += 1
    t.matrix[row] = t.border
    t.vector[row] = arc
    for n in range(count):
        j = n - 1 if family.is_way else n  # the fraction first: the order of the sum decides its last digit
        t.vector[row] -= t.border[j] * (y[j] - t.y[j])
    set_residual(legs, x, t.load, work)
    set_matrix(legs, x, work)
    t.matrix[:size, :size] = work.matrix[:size, :size]
    for k in range(count - size):
        set_path_derivative(legs, x, family.input_rates[k], family.load_rates[k], work, work.step)
        t.matrix[:size, size + k] = work.step
    for j in range(size):
        t.vector[j] = -work.residual[j]


@kernel
def length_of(legs: Array, change: Array, t: Tracer, out: Array) -> float:
    """Return the length of a change of the unknowns at the rod table; fill `out` with metric times `change`."""
    if not t.family.is_way:
        return metric_length(legs, change, out, t.work)
    rods, size = t.work.rods, change.shape[0] - 1
    for i in range(legs.shape[0]):
        q_xx, q_xy, q_yx, q_yy = derivatives(rods[i], FORCE_G)
        weight = 1.0 / (1.0 + math.hypot(rods[i, FORCE_X], rods[i, FORCE_Y])) ** 2
        change_x = weight * (q_xx * change[2 * i] + q_xy * change[2 * i + 1])
        change_y = weight * (q_yx * change[2 * i] + q_yy * change[2 * i + 1])
        out[2 * i] = q_xx * change_x + q_yx * change_y
        out[2 * i + 1] = q_xy * change_x + q_yy * change_y
    out[2 * legs.shape[0] : size] = change[2 * legs.shape[0] : size]
    rate = 0.0
    for value in t.family.input_rates[0]:
        rate += value**2
    for value in t.family.load_rates[0]:
        rate += value**2
    out[size] = rate * change[size]
    squared = 0.0
    for j in range(size + 1):
        squared += out[j] * change[j]
    return math.sqrt(max(squared, 0.0))


@formula
def next_trial(bracket: Bracket, number: int, rules: BracketRules) -> float:
    """Return the arc at which trial `number`, from 0 on, is to be made."""
    secant = bracket.low_value / (bracket.low_value - bracket.high_value)
    part = 0.5 if number % rules.bisect_every == rules.bisect_every - 1 else secant
    part = min(max(part, rules.least_part), 1.0 - rules.least_part)
    return bracket.low + part * (bracket.high - bracket.low)


@kernel
def narrowed(bracket: Bracket, arc: float, value: float, rules: BracketRules) -> Bracket:
    """Return the bracket with the trial at `arc`, where this value was found, in place of one of its ends."""
    if (value > 0.0) == (bracket.low_value > 0.0):
        high_value = bracket.high_value * (rules.weight if bracket.kept > 0 else 1.0)
        return Bracket(arc, value, bracket.high, high_value, 1)
    low_value = bracket.low_value * (rules.weight if bracket.kept < 0 else 1.0)
    return Bracket(bracket.low, low_value, arc, value, -1)
