"""Following one branch of equilibria along a straight line in (inputs, load), with its events.

The line is parametrised by the fraction s in [0, 1], the unknowns are y = (x, s). Natural steps in s are tried first:
Euler predictor, Newton corrector, accepted only if the first correction is small, the corrections contract fast and the
Morse index is unchanged; on one branch it can change only at a singular point. Where natural steps fail,
pseudo-arclength steps (see `tracer`) take over, which pass folds: there ds changes its sign, and the fold is located.
"""

import math
from typing import NamedTuple

import numpy as np

from pcm_gym.arrays import Array
from pcm_gym.kernels.branches.singularity import FORWARD, singularity
from pcm_gym.kernels.branches.smoothness import is_clear, is_even, is_one_branch, look
from pcm_gym.kernels.branches.tracer import (
    REGULAR,
    Bracket,
    BracketRules,
    Tracer,
    accept,
    make_tracer,
    move,
    narrowed,
    next_trial,
    place_at,
    set_parameters,
    start,
)
from pcm_gym.kernels.numerics.compilation import formula, kernel
from pcm_gym.kernels.statics.closure import (
    LOWER,
    UPPER,
    Workspace,
    evaluate_rods,
    make_workspace,
    place,
    set_path_derivative,
    set_residual,
    solve_equilibrium_system,
)
from pcm_gym.kernels.statics.newton import CONVERGED, NewtonRules, solve_forward_locally
from pcm_gym.kernels.statics.stability import assess_stability
from pcm_gym.kernels.statics.states import Point

# Event codes, why tracking stopped: the target was reached; the branch folds back; it goes on with another index; an
# actuator met its limit; the branch could not be followed, which says nothing about the mechanism.
NONE, FOLD, INDEX_CHANGE, ACTUATOR_LIMIT, SOLVER_FAILURE = range(5)


class LineRules(NamedTuple):
    """How the steps along a line are chosen."""

    turns: int = 100  # natural steps and arcs take turns
    natural_steps: int = 10_000
    # As a fraction of the line; where shorter ones are needed, arcs take over. Where arcs come to no end there are no
    # folds, but rods that grow taut: they need short steps, and natural ones are the longer ones there.
    least_natural_step: float = 1.0 / 64.0
    least_step_after_arcs: float = 1.0 / 4096.0
    arc_steps: int = 100
    first_arc: float = 0.01  # doubled after each step, halved where one is refused
    least_arc: float = 1e-9
    largest_arc: float = 0.2
    least_cosine: float = 0.9  # of the angle between the tangents at both ends of a step
    # Largest determinant of a state that may be a bifurcation. The branch turns back there, as at a fold, if the inputs
    # have no larger share in the squared arc than this.
    singular: float = 1e-6
    share_at_fold: float = 1e-3
    first_crossing: float = 1e-8  # fraction by which a change of index is stepped over; four times that if in vain


STEP_RULES = NewtonRules(first_correction=0.05, contraction=0.2, iterations=8)
_RULES = LineRules()
# The tolerance is one of s, which is quadratic at the fold: its error is that of ds / darc times that of the arc.
_FOLD_RULES = BracketRules(trials=100, bisect_every=3, least_part=0.01, weight=1.0, tolerance=1e-11)

# In place of the index of a state that was not found.
_LOST = -1
# In place of an event: there was none so far.
_GOES_ON = -1
# What became of a step by arc length.
_TAKEN, _REFUSED, _OTHER_INDEX, _TURNED_BACK, _AT_FOLD, _AT_END = range(6)


class Tracked(NamedTuple):
    """Where tracking ended, and the verdict on the state there."""

    event: int
    fraction: float
    morse_index: int
    stability_margin: float
    residual: float


@kernel
def make_line(leg_count: int, size: int) -> Tracer:
    """Return a tracer along lines for `leg_count` legs and a state of `size` numbers."""
    return make_tracer(leg_count, size, np.zeros((0, size + 1)), REGULAR, True)


@kernel
def track(
    legs: Array,
    point: Point,
    inputs_target: Array,
    load_target: Array,
    follow_index_changes: bool,
    line: Tracer,
    work: Workspace,
) -> Tracked:
    """Follow the branch through a point towards the target; the point is changed in place.

    It ends at the target, or at the last state before the event that stopped the way; the rod table becomes
    that of its end. With `follow_index_changes` a change of index where the branch goes on (a bifurcation of a
    symmetric mechanism) does not stop it.
    """
    _set_ends(point, inputs_target, load_target, line)
    reach = _reach(legs, line)
    while True:
        event = _follow(legs, reach, line, work)
        if event != INDEX_CHANGE or not follow_index_changes or not _cross(legs, reach, line, work):
            break
    fraction = float(line.y[-1])
    set_parameters(line.y, line)
    for j in range(point.x.shape[0]):
        point.x[j] = line.y[j]
    for i in range(point.inputs.shape[0]):
        point.inputs[i] = inputs_target[i] if fraction == 1.0 else line.inputs[i]
    for d in range(point.load.shape[0]):
        point.load[d] = load_target[d] if fraction == 1.0 else line.load[d]
    place(legs, point.x, point.inputs, work)
    if event == NONE and reach < 1.0:
        event = ACTUATOR_LIMIT
    return judge(legs, point.x, point.load, event, fraction, work)


@kernel
def follow_branch(
    legs: Array, point: Point, inputs_target: Array, load_target: Array, follow_index_changes: bool
) -> tuple[int, float]:
    """Do what `track` does for callers outside compiled code; return the event and the fraction."""
    leg_count, size = legs.shape[0], point.x.shape[0]
    line, work = make_line(leg_count, size), make_workspace(leg_count, size)
    tracked = track(legs, point, inputs_target, load_target, follow_index_changes, line, work)
    return tracked.event, tracked.fraction


@kernel
def track_in_one_step(legs: Array, point: Point, inputs_target: Array, line: Tracer, work: Workspace) -> Tracked:
    """Go to the target in one natural step and change the point; or leave it, with `SOLVER_FAILURE`."""
    _set_ends(point, inputs_target, point.load, line)
    index, is_regular = _start_naturally(legs, line, work)
    if not (is_regular and _step_naturally(legs, 1.0, index, line, work)):
        place(legs, point.x, point.inputs, work)
        return judge(legs, point.x, point.load, SOLVER_FAILURE, 0.0, work)
    point.x[:], point.inputs[:] = line.trial_x, inputs_target
    place(legs, point.x, point.inputs, work)
    return judge(legs, point.x, point.load, NONE, 1.0, work)


@kernel
def judge(legs: Array, x: Array, load: Array, event: int, fraction: float, work: Workspace) -> Tracked:
    """Return the verdict on the state whose rod table is set, with this event and fraction."""
    closure_error, force_error = set_residual(legs, x, load, work)
    verdict = assess_stability(legs, x, work)
    return Tracked(event, fraction, verdict.morse_index, verdict.stability_margin, max(closure_error, force_error))


@formula
def _set_ends(point: Point, inputs_target: Array, load_target: Array, line: Tracer) -> None:
    """Let the line lead from the point, where `y` becomes (x, 0), to the target."""
    for i in range(point.inputs.shape[0]):
        line.first_inputs[i], line.input_rates[0, i] = point.inputs[i], inputs_target[i] - point.inputs[i]
    for d in range(point.load.shape[0]):
        line.first_load[d], line.load_rates[0, d] = point.load[d], load_target[d] - point.load[d]
    for j in range(point.x.shape[0]):
        line.y[j] = point.x[j]
    line.y[-1] = 0.0


@formula
def _reach(legs: Array, line: Tracer) -> float:
    """Return the fraction at which the first actuator meets its limit; an input already outside may move inwards."""
    reach = 1.0
    for i in range(legs.shape[0]):
        rate, first = line.input_rates[0, i], line.first_inputs[i]
        if rate > 0.0 and first + rate > legs[i, UPPER]:
            reach = min(reach, max(0.0, (legs[i, UPPER] - first) / rate))
        elif rate < 0.0 and first + rate < legs[i, LOWER]:
            reach = min(reach, max(0.0, (legs[i, LOWER] - first) / rate))
    return reach


@kernel
def _follow(legs: Array, reach: float, line: Tracer, work: Workspace) -> int:
    """Follow the branch with constant index from `y` to the fraction `reach`, left in `y`; return the event there."""
    least = _RULES.least_natural_step
    for _ in range(_RULES.turns):
        index = _follow_naturally(legs, reach, least, line, work)
        if line.y[-1] >= reach:
            return NONE
        event = _follow_by_arclength(legs, reach, index, line, work)
        if event != _GOES_ON:
            return event
        least = _RULES.least_step_after_arcs
    return SOLVER_FAILURE


@kernel
def _follow_naturally(legs: Array, reach: float, least: float, line: Tracer, work: Workspace) -> int:
    """Follow the branch in steps of at least this fraction, as far as they lead; return its index."""
    y = line.y
    step = reach - y[-1]
    index, is_regular = _start_naturally(legs, line, work)
    for _ in range(_RULES.natural_steps):
        if not is_regular or y[-1] >= reach or step < least:
            break
        end = y[-1] + step if step < (reach - y[-1]) * (1.0 - 1e-12) else reach
        if _step_naturally(legs, end, index, line, work):
            for j in range(y.shape[0]):
                y[j], line.tangent[j] = line.trial[j], line.trial_tangent[j]
            step *= 2.0
        else:
            step *= 0.5
    return index


@formula
def _start_naturally(legs: Array, line: Tracer, work: Workspace) -> tuple[int, bool]:
    """Set rod table and tangent of `y`; return its index, and whether there is a tangent."""
    place_at(legs, line.y, line, work)
    is_regular = _set_natural_tangent(legs, line.x, line.tangent, line, work)
    return assess_stability(legs, line.x, work).morse_index, is_regular


@kernel
def _set_natural_tangent(legs: Array, x: Array, tangent: Array, line: Tracer, work: Workspace) -> bool:
    """Fill the tangent at a state, whose rod table is set, with d y / d s; return whether there is one."""
    set_path_derivative(legs, x, line.input_rates[0], line.load_rates[0], work, work.residual)
    is_regular = solve_equilibrium_system(legs, x, work.residual, work)
    for j in range(work.step.shape[0]):
        tangent[j] = work.step[j]
    tangent[-1] = 1.0
    return is_regular


@kernel
def _step_naturally(legs: Array, end: float, index: int, line: Tracer, work: Workspace) -> bool:
    """Put the state at the fraction `end` into the trial, with its tangent; return whether the branch leads there.

    It must do so smoothly and with this index all the way.
    """
    return _predict_and_correct(legs, end, line, work) == index and _is_smooth(legs, end - line.y[-1], line, work)


@kernel
def _predict_and_correct(legs: Array, end: float, line: Tracer, work: Workspace) -> int:
    """Put a state at the fraction `end` into the trial; return its index, or `_LOST`."""
    way = end - line.y[-1]
    for j in range(work.step.shape[0]):
        line.trial[j] = line.y[j] + way * line.tangent[j]
    line.trial[-1] = end
    return _correct_state(legs, line, work)


@kernel
def _is_smooth(legs: Array, way: float, line: Tracer, work: Workspace) -> bool:
    """Return whether the natural step to the trial, whose rod table is set, is smooth; fill the trial's tangent."""
    if not _set_natural_tangent(legs, line.trial_x, line.trial_tangent, line, work):
        return False
    if not is_even(legs, way, line, work):
        return False
    there = look(legs, line.trial, line.trial_tangent, -way, line, work)
    place_at(legs, line.y, line, work)
    return is_clear(look(legs, line.y, line.tangent, way, line, work), there, 1.0)


@formula
def _correct_state(legs: Array, line: Tracer, work: Workspace) -> int:
    """Correct the trial's state at its fraction and set its rod table; return its index, or `_LOST`."""
    x = line.trial_x
    set_parameters(line.trial, line)
    if solve_forward_locally(legs, line.inputs, line.load, x, STEP_RULES, work) != CONVERGED:
        return _LOST
    evaluate_rods(legs, x, work)
    return assess_stability(legs, x, work).morse_index


@kernel
def _cross(legs: Array, reach: float, line: Tracer, work: Workspace) -> bool:
    """Step over a change of index with the tangent before it; return whether that succeeded."""
    index, _ = _start_naturally(legs, line, work)
    end, step = line.y[-1], _RULES.first_crossing
    while end < reach:
        end = min(line.y[-1] + step, reach)
        index_beyond = _predict_and_correct(legs, end, line, work)
        if index_beyond not in (_LOST, index):
            line.y[:] = line.trial
            return True
        step *= 4.0
    return False


@kernel
def _follow_by_arclength(legs: Array, reach: float, index: int, line: Tracer, work: Workspace) -> int:
    """Follow the branch by arcs; return the event that ends it, or `_GOES_ON` after many without one."""
    line.border[:] = 0.0
    line.border[-1] = 1.0
    if not start(legs, 1.0, line, work):
        return SOLVER_FAILURE
    arc, refused_for, refused_at = _RULES.first_arc, SOLVER_FAILURE, math.inf
    for _ in range(_RULES.arc_steps):
        if arc < _RULES.least_arc:
            break
        outcome = _step_by_arc(legs, arc, reach, index, line, work)
        if outcome == _AT_FOLD:
            return FOLD
        if outcome == _AT_END:
            return NONE
        if outcome == _TAKEN:
            refused_for = refused_for if line.trial[-1] < refused_at else SOLVER_FAILURE
            accept(legs, line, work)
            arc = min(2.0 * arc, _RULES.largest_arc)
            continue
        if outcome == _OTHER_INDEX:
            refused_for, refused_at = INDEX_CHANGE, line.trial[-1]
        elif outcome == _TURNED_BACK:
            refused_for, refused_at = FOLD, math.inf
        arc *= 0.5
    if arc >= _RULES.least_arc:
        return _GOES_ON
    if refused_for == SOLVER_FAILURE:
        return refused_for
    place_at(legs, line.y, line, work)
    if abs(singularity(legs, line.x, FORWARD, work)) > _RULES.singular:
        return refused_for
    share = line.border[-1] * line.tangent[-1]  # of the inputs in the squared arc
    return FOLD if share < _RULES.share_at_fold else INDEX_CHANGE


@kernel
def _step_by_arc(legs: Array, arc: float, reach: float, index: int, line: Tracer, work: Workspace) -> int:
    """Put the point at `arc` into the trial, or that at the fold or the end before it into `y`; return which."""
    if not (move(legs, arc, STEP_RULES, line, work) and is_even(legs, arc, line, work)):
        return _REFUSED
    trial_index = assess_stability(legs, line.trial_x, work).morse_index
    there = look(legs, line.trial, line.trial_tangent, -arc, line, work)
    place_at(legs, line.y, line, work)
    here = look(legs, line.y, line.tangent, arc, line, work)
    rate = line.trial_tangent[-1]
    if not is_one_branch(here, there, rate):
        if trial_index != index:
            return _OTHER_INDEX
        return _TURNED_BACK if rate <= 0.0 else _REFUSED
    if rate <= 0.0:
        fold = _locate_fold(legs, arc, index, line, work)
        if fold[-1] > reach:
            return _REFUSED
        line.y[:] = fold
        return _AT_FOLD
    cosine = 0.0
    for j in range(line.y.shape[0]):
        cosine += line.border[j] * line.trial_tangent[j]
    if cosine < _RULES.least_cosine:
        return _REFUSED
    is_beyond = line.trial[-1] >= reach
    if not is_beyond and trial_index != index:
        return _OTHER_INDEX
    part = (reach - line.y[-1]) / (line.trial[-1] - line.y[-1]) if is_beyond else 1.0
    if not is_clear(here, there, part):
        return _REFUSED
    if is_beyond:
        return _AT_END if _step_back_to(legs, reach, part, index, line, work) else _REFUSED
    place_at(legs, line.trial, line, work)
    return _TAKEN


@kernel
def _step_back_to(legs: Array, reach: float, part: float, index: int, line: Tracer, work: Workspace) -> bool:
    """Go to the fraction `reach`, at a part of the step to the trial; return whether this branch is there."""
    for j in range(work.step.shape[0]):
        line.trial[j] = line.y[j] + part * (line.trial[j] - line.y[j])
    line.trial[-1] = reach
    if _correct_state(legs, line, work) != index:
        return False
    line.y[:] = line.trial
    return True


@kernel
def _locate_fold(legs: Array, arc: float, index: int, line: Tracer, work: Workspace) -> Array:
    """Return the last point before the fold, where ds / darc changes its sign, between `y` and the trial at `arc`."""
    low, rules = line.y.copy(), _FOLD_RULES
    bracket = Bracket(0.0, line.tangent[-1], arc, line.trial_tangent[-1], 0)
    for number in range(rules.trials):
        if (bracket.high - bracket.low) * max(bracket.low_value, -bracket.high_value) < rules.tolerance:
            break
        middle = next_trial(bracket, number, rules)
        is_found = move(legs, middle, STEP_RULES, line, work)
        rate = line.trial_tangent[-1] if is_found else bracket.high_value
        if rate > 0.0 and assess_stability(legs, line.trial_x, work).morse_index == index:
            low[:] = line.trial
        else:
            rate = min(rate, 0.0)
        bracket = narrowed(bracket, middle, rate, rules)
    return low
