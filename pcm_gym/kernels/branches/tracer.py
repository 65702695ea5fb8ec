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

Short functions that take a tracer are formulas: to hand its many arrays on in a call takes as long as what they do.
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
    place,
    set_matrix,
    set_path_derivative,
    set_residual,
)
from pcm_gym.kernels.statics.newton import CONVERGED, DIVERGED, NewtonRules, accept_correction, correction_size

# Beside a bifurcation rounding errors are magnified up to this: corrections do not fall below it there. That is
# accepted where it is a small part of the arc.
_LARGEST_ROUNDING, _NEGLIGIBLE = 1e-7, 1e-2

# In place of a kind of singularity: the states of the curve need not be singular.
REGULAR = -1


class Tracer(NamedTuple):
    """Which curve is followed, where that is, and scratch arrays; all points and vectors are (size + m,).

    The inputs are `first_inputs` + p `input_rates`, the load is `first_load` + p `load_rates`. Of singular states the
    parameters must be the inputs themselves.
    """

    first_inputs: Array  # (legs,)
    first_load: Array  # (d,)
    input_rates: Array  # (m, legs)
    load_rates: Array  # (m, d)
    conditions: Array  # (k, size + m): C; k = m - 1, of singular states m - 2
    singularity: int  # kind that all states have, or REGULAR
    # Whether the only parameter is the fraction of a way. Its changes do not count as corrections, and in the metric
    # rods count by their own forces; with inputs as parameters by their tips, and forces relative to all rods'.
    is_way: bool
    inputs: Array  # (legs,) at the point last looked at
    load: Array  # (d,)
    y: Array  # last point
    x: Array  # (size,): its state, part of y
    tangent: Array  # of unit length
    border: Array  # metric times tangent
    trial: Array
    trial_x: Array  # (size,): its state
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
def make_tracer(leg_count: int, size: int, conditions: Array, kind: int, is_way: bool) -> Tracer:
    """Return a tracer, at no point yet, whose inputs and load are 0 and do not change with the parameters yet."""
    dof, count = size - 2 * leg_count, conditions.shape[1]
    y, trial = np.zeros(count), np.zeros(count)
    return Tracer(
        np.zeros(leg_count),
        np.zeros(dof),
        np.zeros((count - size, leg_count)),
        np.zeros((count - size, dof)),
        conditions,
        kind,
        is_way,
        np.zeros(leg_count),
        np.zeros(dof),
        y,
        y[:size],
        np.zeros(count),
        np.zeros(count),
        trial,
        trial[:size],
        np.zeros(count),
        np.zeros((count, count)),
        np.zeros(count),
    )


@formula
def set_parameters(y: Array, t: Tracer) -> None:
    """Fill inputs and load for the unknowns `y`."""
    first = y.shape[0] - t.input_rates.shape[0]
    for i in range(t.inputs.shape[0]):
        t.inputs[i] = t.first_inputs[i]
        for k in range(t.input_rates.shape[0]):
            t.inputs[i] += y[first + k] * t.input_rates[k, i]
    for d in range(t.load.shape[0]):
        t.load[d] = t.first_load[d]
        for k in range(t.load_rates.shape[0]):
            t.load[d] += y[first + k] * t.load_rates[k, d]


@formula
def place_at(legs: Array, y: Array, t: Tracer, work: Workspace) -> None:
    """Fill inputs, load and rod table for the unknowns `y`."""
    set_parameters(y, t)
    place(legs, y[: work.step.shape[0]], t.inputs, work)


@kernel
def start(legs: Array, sign: float, t: Tracer, work: Workspace) -> bool:
    """Take the tangent at `y` on the side of the border, times `sign`; return whether there is one."""
    t.trial[:] = t.y
    if not _set_tangent(legs, t, work):
        return False
    t.trial_tangent[:] *= sign
    accept(legs, t, work)
    return True


@formula
def accept(legs: Array, t: Tracer, work: Workspace) -> None:
    """Make the trial, whose rod table is set, the last point."""
    for j in range(t.y.shape[0]):
        t.y[j], t.tangent[j] = t.trial[j], t.trial_tangent[j]
    length_of(legs, t.tangent, t, work, t.border)


@kernel
def move(legs: Array, arc: float, rules: NewtonRules, t: Tracer, work: Workspace) -> bool:
    """Put the point at `arc` into the trial, with tangent and rod table; return whether that succeeded."""
    return correct(legs, arc, rules, t, work) and _set_tangent(legs, t, work)


@kernel
def move_foreseen(legs: Array, arc: float, rules: NewtonRules, t: Tracer, work: Workspace) -> bool:
    """Do what `move` does, from a trial that is already near the point."""
    return _correct_trial(legs, arc, rules, t, work) and _set_tangent(legs, t, work)


@kernel
def correct(legs: Array, arc: float, rules: NewtonRules, t: Tracer, work: Workspace) -> bool:
    """Put the point at `arc` into the trial; return whether that succeeded."""
    for j in range(t.y.shape[0]):
        t.trial[j] = t.y[j] + arc * t.tangent[j]
    return _correct_trial(legs, arc, rules, t, work)


@kernel
def _correct_trial(legs: Array, arc: float, rules: NewtonRules, t: Tracer, work: Workspace) -> bool:
    """Correct the trial to the point at `arc`; return whether that succeeded."""
    previous = math.inf
    for iteration in range(rules.iterations):
        _set_system(legs, arc, t, work)
        if not solve_linear(t.matrix, t.vector, t.vector.shape[0]):
            return False
        size = _correction_size(legs, t, work)
        verdict = accept_correction(size, previous, iteration == 0, rules)
        if verdict == DIVERGED and size < min(_NEGLIGIBLE * arc, _LARGEST_ROUNDING):
            verdict = CONVERGED
        if verdict > CONVERGED:
            return False
        for j in range(t.y.shape[0]):
            t.trial[j] += t.vector[j]
        if verdict == CONVERGED:
            return True
        previous = size
    return False


@formula
def _correction_size(legs: Array, t: Tracer, work: Workspace) -> float:
    """Return the size of the correction `t.vector` of the trial."""
    size = work.step.shape[0]
    for j in range(size):
        work.step[j] = t.vector[j]
    largest = correction_size(legs, t.trial_x, work)
    if not t.is_way:
        for j in range(size, t.vector.shape[0]):
            largest = max(largest, abs(t.vector[j]))
    return largest


@kernel
def _set_tangent(legs: Array, t: Tracer, work: Workspace) -> bool:
    """Fill the trial's unit tangent, on the side of the border, and its rod table; return whether there is one."""
    _set_system(legs, 0.0, t, work)
    count = t.vector.shape[0]
    for j in range(count):
        t.vector[j] = 1.0 if j == count - 1 else 0.0
    if not solve_linear(t.matrix, t.vector, count):
        return False
    for j in range(count):
        t.trial_tangent[j] = t.vector[j]
    length = length_of(legs, t.trial_tangent, t, work, t.vector)
    for j in range(count):
        t.trial_tangent[j] /= length
    return length > 0.0 and math.isfinite(length)


@formula
def _set_system(legs: Array, arc: float, t: Tracer, work: Workspace) -> None:
    """Fill matrix and right side of Newton's method at the trial, and its rod table."""
    y = t.trial
    count, size = y.shape[0], work.step.shape[0]
    x, row = t.trial_x, size
    if t.singularity != REGULAR:
        set_singularity_gradient(legs, y, t.singularity, t.vector, work, t.matrix[row])
    place_at(legs, y, t, work)
    if t.singularity != REGULAR:
        t.vector[row] = -singularity(legs, x, t.singularity, work)
        row += 1
    for condition in t.conditions:
        t.vector[row] = 0.0
        for j in range(count):
            t.matrix[row, j] = condition[j]
            t.vector[row] -= condition[j] * (y[j] - t.y[j])
        row += 1
    t.vector[row] = arc
    for n in range(count):
        t.matrix[row, n] = t.border[n]
        j = n - 1 if t.is_way else n  # the fraction first: the order of the sum decides its last digit
        t.vector[row] -= t.border[j] * (y[j] - t.y[j])
    set_residual(legs, x, t.load, work)
    set_matrix(legs, x, work)
    for i in range(size):
        t.vector[i] = -work.residual[i]
        for j in range(size):
            t.matrix[i, j] = work.matrix[i, j]
    for k in range(count - size):
        set_path_derivative(legs, x, t.input_rates[k], t.load_rates[k], work, work.step)
        for i in range(size):
            t.matrix[i, size + k] = work.step[i]


@kernel
def length_of(legs: Array, change: Array, t: Tracer, work: Workspace, out: Array) -> float:
    """Return the length of a change of the unknowns at the rod table; fill `out` with metric times `change`."""
    if not t.is_way:
        return metric_length(legs, change, out, work)
    rods, size = work.rods, change.shape[0] - 1
    for i in range(legs.shape[0]):
        q_xx, q_xy, q_yx, q_yy = derivatives(rods[i], FORCE_G)
        weight = 1.0 / (1.0 + math.hypot(rods[i, FORCE_X], rods[i, FORCE_Y])) ** 2
        change_x = weight * (q_xx * change[2 * i] + q_xy * change[2 * i + 1])
        change_y = weight * (q_yx * change[2 * i] + q_yy * change[2 * i + 1])
        out[2 * i] = q_xx * change_x + q_yx * change_y
        out[2 * i + 1] = q_xy * change_x + q_yy * change_y
    out[2 * legs.shape[0] : size] = change[2 * legs.shape[0] : size]
    rate = 0.0
    for value in t.input_rates[0]:
        rate += value**2
    for value in t.load_rates[0]:
        rate += value**2
    out[size] = rate * change[size]
    squared = 0.0
    for j in range(size + 1):
        squared += out[j] * change[j]
    return math.sqrt(max(squared, 0.0))


@kernel
def cosine_of_turn(legs: Array, t: Tracer, work: Workspace) -> float:
    """Return the cosine of the angle between the tangents at `y` and at the trial, whose rod table is set.

    It is as the metrics of both ends see it: one alone would take its own change for a turn.
    """
    length_of(legs, t.trial_tangent, t, work, t.vector)
    cosine = 0.0
    for j in range(t.y.shape[0]):
        cosine += 0.5 * (t.border[j] * t.trial_tangent[j] + t.vector[j] * t.tangent[j])
    return cosine


@formula
def speed_at_trial(t: Tracer) -> float:
    """Return how far the trial moves along its unit tangent per arc, which is measured along that at `y`."""
    along = 0.0
    for j in range(t.y.shape[0]):
        along += t.border[j] * t.trial_tangent[j]
    return 1.0 / along


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
