"""Following one branch of equilibria along a straight line in (inputs, load), with its events.

The line is parametrised by the fraction s in [0, 1]. Natural steps in s are tried first: Euler predictor, Newton
corrector, accepted only if the first correction is small, the corrections contract fast and the Morse index is
unchanged; on one branch it can change only at a singular point. Where natural steps fail, pseudo-arclength steps take
over, which pass folds: there ds changes its sign, and the fold is located by interpolating it.
"""

import math
from typing import NamedTuple

import numpy as np

from pcm_gym.arrays import Array
from pcm_gym.kernels.numerics.compilation import kernel
from pcm_gym.kernels.numerics.linear import solve_linear
from pcm_gym.kernels.statics.closure import (
    FORCE_G,
    FORCE_X,
    FORCE_Y,
    LOWER,
    UPPER,
    Workspace,
    evaluate_rods,
    place,
    set_inputs,
    set_matrix,
    set_path_derivative,
    set_residual,
    solve_equilibrium_system,
)
from pcm_gym.kernels.statics.newton import (
    CONVERGED,
    ROUNDING,
    NewtonRules,
    correction_size,
    is_last,
    solve_forward_locally,
)
from pcm_gym.kernels.statics.stability import assess_stability

# Why tracking stopped.
NONE, FOLD, INDEX_CHANGE, ACTUATOR_LIMIT, SOLVER_FAILURE = range(5)

STEP_RULES = NewtonRules(first_correction=0.05, contraction=0.2, iterations=8)
_LEAST_NATURAL_STEP = 1.0 / 64.0
_MOST_NATURAL_STEPS = 10_000
_MOST_ARC_STEPS = 2_000
_LEAST_ARC_STEP = 1e-9
_FIRST_ARC_STEP = 0.01
_LARGEST_ARC_STEP = 0.2
_LEAST_TANGENT_COSINE = 0.9
_FOLD_TOLERANCE = 1e-11
_LEAST_CROSSING = 1e-8
_MOST_FOLD_STEPS = 100


class Line(NamedTuple):
    """The straight line in (inputs, load), the point on it, and scratch arrays for following it."""

    inputs_start: Array  # (legs,)
    input_rate: Array  # (legs,)
    load_start: Array  # (d,)
    load_rate: Array  # (d,)
    inputs: Array  # (legs,) at the present fraction
    load: Array  # (d,)
    rate: Array  # (size,): derivative of the residual by the fraction
    x: Array  # (size,): trial state
    tangent: Array  # (size + 1,): d(x, s) / d arclength, or d x / d s in natural steps
    trial_tangent: Array  # (size + 1,)
    border: Array  # (size + 1,): metric times tangent
    x_low: Array  # (size,): last state known to be before the fold


class Tracked(NamedTuple):
    """Where tracking ended, and the verdict on the state there."""

    event: int
    fraction: float
    morse_index: int
    stability_margin: float
    residual: float


@kernel
def make_line(leg_count: int, size: int) -> Line:
    """Return the arrays of a line for `leg_count` legs and a state of `size` numbers."""
    dof = size - 2 * leg_count
    return Line(
        np.zeros(leg_count),
        np.zeros(leg_count),
        np.zeros(dof),
        np.zeros(dof),
        np.zeros(leg_count),
        np.zeros(dof),
        np.zeros(size),
        np.zeros(size),
        np.zeros(size + 1),
        np.zeros(size + 1),
        np.zeros(size + 1),
        np.zeros(size),
    )


@kernel
def _go_to(legs: Array, line: Line, fraction: float, work: Workspace) -> None:
    for i in range(line.inputs.shape[0]):
        line.inputs[i] = line.inputs_start[i] + fraction * line.input_rate[i]
    for d in range(line.load.shape[0]):
        line.load[d] = line.load_start[d] + fraction * line.load_rate[d]
    set_inputs(legs, line.inputs, work)


@kernel
def _reach(legs: Array, line: Line) -> float:
    """Return the fraction at which the first actuator meets its limit; an input already outside may move inwards."""
    reach = 1.0
    for i in range(legs.shape[0]):
        rate, start = line.input_rate[i], line.inputs_start[i]
        if rate > 0.0 and start + rate > legs[i, UPPER]:
            reach = min(reach, max(0.0, (legs[i, UPPER] - start) / rate))
        elif rate < 0.0 and start + rate < legs[i, LOWER]:
            reach = min(reach, max(0.0, (legs[i, LOWER] - start) / rate))
    return reach


@kernel
def _set_ends(line: Line, inputs: Array, load: Array, inputs_target: Array, load_target: Array) -> None:
    for i in range(inputs.shape[0]):
        line.inputs_start[i] = inputs[i]
        line.input_rate[i] = inputs_target[i] - inputs[i]
    for d in range(load.shape[0]):
        line.load_start[d] = load[d]
        line.load_rate[d] = load_target[d] - load[d]


@kernel
def track(
    legs: Array,
    x: Array,
    inputs: Array,
    load: Array,
    inputs_target: Array,
    load_target: Array,
    follow_index_changes: bool,
    line: Line,
    work: Workspace,
) -> Tracked:
    """Follow the branch through (x, inputs, load) towards the target; all three are changed in place.

    They end at the target, or at the last state before the event that stopped the way. With `follow_index_changes`
    a change of index where the branch goes on (a bifurcation of a symmetric mechanism) does not stop it.
    """
    _set_ends(line, inputs, load, inputs_target, load_target)
    reach = _reach(legs, line)
    event, fraction = _follow(legs, x, line, 0.0, reach, work)
    while event == INDEX_CHANGE and follow_index_changes:
        crossed = _cross(legs, x, line, fraction, reach, work)
        if crossed == fraction:
            break
        event, fraction = _follow(legs, x, line, crossed, reach, work)
    for i in range(inputs.shape[0]):
        inputs[i] = inputs_target[i] if fraction == 1.0 else line.inputs_start[i] + fraction * line.input_rate[i]
    for d in range(load.shape[0]):
        load[d] = load_target[d] if fraction == 1.0 else line.load_start[d] + fraction * line.load_rate[d]
    if event != NONE:  # else the rod table is that of x already
        place(legs, x, inputs, work)
    elif reach < 1.0:
        event = ACTUATOR_LIMIT
    return judge(legs, x, load, event, fraction, work)


@kernel
def track_in_one_step(
    legs: Array, x: Array, inputs: Array, load: Array, inputs_target: Array, line: Line, work: Workspace
) -> Tracked:
    """Go to the target in one natural step and change `x` and `inputs`; or leave them, with `SOLVER_FAILURE`."""
    _set_ends(line, inputs, load, inputs_target, load)
    _go_to(legs, line, 0.0, work)
    evaluate_rods(legs, x, work)
    index = assess_stability(legs, x, work).morse_index
    if not (_set_natural_tangent(legs, x, line, work) and _step_naturally(legs, x, line, 0.0, 1.0, index, work)):
        return judge(legs, x, load, SOLVER_FAILURE, 0.0, work)
    x[:], inputs[:] = line.x, inputs_target
    return judge(legs, x, load, NONE, 1.0, work)


@kernel
def judge(legs: Array, x: Array, load: Array, event: int, fraction: float, work: Workspace) -> Tracked:
    """Return the verdict on the state whose rod table is set, with this event and fraction."""
    closure_error, force_error = set_residual(legs, x, load, work)
    verdict = assess_stability(legs, x, work)
    return Tracked(
        event,
        fraction,
        verdict.morse_index,
        verdict.stability_margin,
        max(closure_error, force_error),
    )


@kernel
def _set_natural_tangent(legs: Array, x: Array, line: Line, work: Workspace) -> bool:
    set_path_derivative(legs, x, line.input_rate, line.load_rate, work, line.rate)
    regular = solve_equilibrium_system(legs, x, line.rate, work)
    line.tangent[: x.shape[0]] = work.step
    return regular


@kernel
def _follow(legs: Array, x: Array, line: Line, start: float, reach: float, work: Workspace) -> tuple[int, float]:
    """Follow the branch with constant index from `start` to `reach`; leave `x` and the rod table where it ends."""
    fraction, step = start, reach - start
    _go_to(legs, line, start, work)
    evaluate_rods(legs, x, work)
    regular = _set_natural_tangent(legs, x, line, work)
    index = assess_stability(legs, x, work).morse_index
    for _ in range(_MOST_NATURAL_STEPS):
        if fraction >= reach:
            return NONE, reach
        end = fraction + step if step < (reach - fraction) * (1.0 - 1e-12) else reach
        if regular and _step_naturally(legs, x, line, fraction, end, index, work):
            x[:] = line.x
            fraction = end
            step *= 2.0
            if fraction < reach:
                regular = _set_natural_tangent(legs, x, line, work)
        elif regular and step > _LEAST_NATURAL_STEP:
            step *= 0.5
        else:
            return _follow_by_arclength(legs, x, line, fraction, reach, index, work)
    return SOLVER_FAILURE, fraction


@kernel
def _step_naturally(legs: Array, x: Array, line: Line, start: float, end: float, index: int, work: Workspace) -> bool:
    """Try to put the state at fraction `end` into `line.x`; return whether it is surely on the same branch."""
    for j in range(x.shape[0]):
        line.x[j] = x[j] + (end - start) * line.tangent[j]
    return _correct_on_branch(legs, line, end, index, work)


@kernel
def _correct_on_branch(legs: Array, line: Line, fraction: float, index: int, work: Workspace) -> bool:
    """Correct `line.x` at this fraction; return whether it is surely on the branch with this index."""
    _go_to(legs, line, fraction, work)
    if solve_forward_locally(legs, line.inputs, line.load, line.x, STEP_RULES, work) != CONVERGED:
        return False
    evaluate_rods(legs, line.x, work)
    return assess_stability(legs, line.x, work).morse_index == index


@kernel
def _cross(legs: Array, x: Array, line: Line, fraction: float, reach: float, work: Workspace) -> float:
    """Step over a change of index with the tangent before it; return the fraction reached, or the old one."""
    end, step = fraction, _LEAST_CROSSING
    while end < reach:
        end = min(fraction + step, reach)
        _go_to(legs, line, fraction, work)
        evaluate_rods(legs, x, work)
        _set_natural_tangent(legs, x, line, work)
        index = assess_stability(legs, x, work).morse_index
        for j in range(x.shape[0]):
            line.x[j] = x[j] + (end - fraction) * line.tangent[j]
        _go_to(legs, line, end, work)
        if solve_forward_locally(legs, line.inputs, line.load, line.x, STEP_RULES, work) == CONVERGED:
            evaluate_rods(legs, line.x, work)
            if assess_stability(legs, line.x, work).morse_index != index:
                x[:] = line.x
                return end
        step *= 4.0
    return fraction


@kernel
def _apply_metric(legs: Array, line: Line, vector: Array, work: Workspace, out: Array) -> float:
    """Fill `out` with metric times `vector` (x, s); return the squared length of `vector`.

    The metric weighs the change of pose, of each rod's force relative to 1 + |force|, and of inputs and load.
    """
    pose, size = 2 * legs.shape[0], vector.shape[0] - 1
    rods = work.rods
    for i in range(legs.shape[0]):
        q_xx, q_xy, q_yx, q_yy = rods[i, FORCE_G], rods[i, FORCE_G + 1], rods[i, FORCE_G + 2], rods[i, FORCE_G + 3]
        weight = 1.0 / (1.0 + math.hypot(rods[i, FORCE_X], rods[i, FORCE_Y])) ** 2
        change_x = weight * (q_xx * vector[2 * i] + q_xy * vector[2 * i + 1])
        change_y = weight * (q_yx * vector[2 * i] + q_yy * vector[2 * i + 1])
        out[2 * i] = q_xx * change_x + q_yx * change_y
        out[2 * i + 1] = q_xy * change_x + q_yy * change_y
    out[pose:size] = vector[pose:size]
    rate = 0.0
    for i in range(line.input_rate.shape[0]):
        rate += line.input_rate[i] ** 2
    for d in range(line.load_rate.shape[0]):
        rate += line.load_rate[d] ** 2
    out[size] = rate * vector[size]
    squared = 0.0
    for j in range(size + 1):
        squared += out[j] * vector[j]
    return squared


@kernel
def _set_bordered_matrix(legs: Array, x: Array, line: Line, work: Workspace) -> None:
    size = x.shape[0]
    set_matrix(legs, x, work)
    set_path_derivative(legs, x, line.input_rate, line.load_rate, work, line.rate)
    for row in range(size):
        work.matrix[row, size] = line.rate[row]
    for column in range(size + 1):
        work.matrix[size, column] = line.border[column]


@kernel
def _set_arc_tangent(legs: Array, x: Array, line: Line, work: Workspace, tangent: Array) -> bool:
    """Fill `tangent` with the unit tangent of the branch at the rod table, on the side of `line.border`."""
    size = x.shape[0]
    _set_bordered_matrix(legs, x, line, work)
    work.vector[:] = 0.0
    work.vector[size] = 1.0
    if not solve_linear(work.matrix, work.vector, size + 1):
        return False
    tangent[:] = work.vector
    squared = _apply_metric(legs, line, tangent, work, work.vector)
    if not (squared > 0.0 and math.isfinite(squared)):
        return False
    tangent /= math.sqrt(squared)
    return True


@kernel
def _correct_on_plane(
    legs: Array, x: Array, fraction: float, arc: float, line: Line, work: Workspace
) -> tuple[bool, float]:
    """Find the point of the branch at `arc` along `line.tangent` from (x, fraction), on the plane across it.

    Fills `line.x` and returns success and the fraction there; `line.border` must hold metric times tangent.
    """
    size = x.shape[0]
    for j in range(size):
        line.x[j] = x[j] + arc * line.tangent[j]
    trial = fraction + arc * float(line.tangent[size])
    previous = math.inf
    for iteration in range(STEP_RULES.iterations):
        _go_to(legs, line, trial, work)
        evaluate_rods(legs, line.x, work)
        set_residual(legs, line.x, line.load, work)
        _set_bordered_matrix(legs, line.x, line, work)
        gap = line.border[size] * (trial - fraction) - arc
        for j in range(size):
            work.vector[j] = -work.residual[j]
            gap += line.border[j] * (line.x[j] - x[j])
        work.vector[size] = -gap
        if not solve_linear(work.matrix, work.vector, size + 1):
            return False, trial
        work.step[:] = work.vector[:size]
        correction = correction_size(legs, line.x, work)
        if iteration == 0 and correction > STEP_RULES.first_correction:
            return False, trial
        if not correction <= max(STEP_RULES.contraction * previous, ROUNDING) or correction == math.inf:
            return False, trial
        line.x[:] += work.step
        trial += float(work.vector[size])
        if is_last(correction, previous):
            _go_to(legs, line, trial, work)
            evaluate_rods(legs, line.x, work)
            return True, trial
        previous = correction
    return False, trial


@kernel
def _start_arc(legs: Array, x: Array, line: Line, fraction: float, work: Workspace) -> bool:
    """Set unit tangent and border at (x, fraction), pointing to larger fractions."""
    size = x.shape[0]
    _go_to(legs, line, fraction, work)
    evaluate_rods(legs, x, work)
    line.border[:] = 0.0
    line.border[size] = 1.0
    if not _set_arc_tangent(legs, x, line, work, line.tangent):
        return False
    _apply_metric(legs, line, line.tangent, work, line.border)
    return True


@kernel
def _follow_by_arclength(
    legs: Array, x: Array, line: Line, fraction: float, reach: float, index: int, work: Workspace
) -> tuple[int, float]:
    size = x.shape[0]
    if not _start_arc(legs, x, line, fraction, work):
        return SOLVER_FAILURE, fraction
    arc, refused_for_index, refused_at = _FIRST_ARC_STEP, False, math.inf
    for _ in range(_MOST_ARC_STEPS):
        if arc < _LEAST_ARC_STEP:
            break
        found, end = _correct_on_plane(legs, x, fraction, arc, line, work)
        if not (found and _set_arc_tangent(legs, line.x, line, work, line.trial_tangent)):
            arc *= 0.5
            continue
        if line.trial_tangent[size] <= 0.0:
            before = x.copy()
            at_fold = _locate_fold(legs, x, line, fraction, arc, index, work)
            if at_fold <= reach:
                return FOLD, at_fold
            x[:] = before  # the fold is beyond the target
            arc *= 0.5
            continue
        cosine = 0.0
        for j in range(size + 1):
            cosine += line.border[j] * line.trial_tangent[j]
        if cosine < _LEAST_TANGENT_COSINE:
            arc *= 0.5
            continue
        if end >= reach:
            if _step_onto(legs, x, line, fraction, end, reach, index, work):
                x[:] = line.x
                return NONE, reach
            arc *= 0.5
            continue
        if assess_stability(legs, line.x, work).morse_index != index:
            refused_for_index, refused_at = True, end
            arc *= 0.5
            continue
        refused_for_index = refused_for_index and end < refused_at
        x[:] = line.x
        fraction = end
        line.tangent[:] = line.trial_tangent
        _apply_metric(legs, line, line.tangent, work, line.border)
        arc = min(2.0 * arc, _LARGEST_ARC_STEP)
    return (INDEX_CHANGE if refused_for_index else SOLVER_FAILURE), fraction


@kernel
def _step_onto(
    legs: Array, x: Array, line: Line, start: float, end: float, reach: float, index: int, work: Workspace
) -> bool:
    """Put the state at fraction `reach` into `line.x`, between (x, start) and (line.x, end)."""
    part = (reach - start) / (end - start)
    for j in range(x.shape[0]):
        line.x[j] = x[j] + part * (line.x[j] - x[j])
    return _correct_on_branch(legs, line, reach, index, work)


@kernel
def _locate_fold(legs: Array, x: Array, line: Line, fraction: float, arc: float, index: int, work: Workspace) -> float:
    """Find the fold within `arc` of (x, fraction); put the last state before it into `x`, return its fraction.

    ds/darc changes its sign at the fold; s is quadratic there, so its error is that of ds/darc times that of arc.
    """
    size = x.shape[0]
    low, low_rate, low_fraction = 0.0, float(line.tangent[size]), fraction
    high, high_rate = arc, float(line.trial_tangent[size])
    line.x_low[:] = x
    for iteration in range(_MOST_FOLD_STEPS):
        if (high - low) * max(low_rate, -high_rate) < _FOLD_TOLERANCE:
            break
        part = low_rate / (low_rate - high_rate)
        if iteration % 3 == 2:  # regula falsi may creep from one side
            part = 0.5
        middle = low + min(max(part, 0.01), 0.99) * (high - low)
        found, end = _correct_on_plane(legs, x, fraction, middle, line, work)
        found = found and _set_arc_tangent(legs, line.x, line, work, line.trial_tangent)
        rate = float(line.trial_tangent[size])
        if found and rate > 0.0 and assess_stability(legs, line.x, work).morse_index == index:
            low, low_rate, low_fraction = middle, rate, end
            line.x_low[:] = line.x
        else:
            high = middle
            high_rate = min(rate, 0.0) if found else high_rate
    x[:] = line.x_low
    return low_fraction
