"""Following one branch of equilibria along a straight line in (inputs, load), with its events.

The line is parametrised by the fraction s in [0, 1], the unknowns are y = (x, s). Natural steps in s are tried first.
Where they fail, pseudo-arclength steps take over, which pass folds (see `steps` for both). The length of a step is
chosen from the defect of the last one, see `smoothness`.
"""

import math
from typing import NamedTuple

import numpy as np

from pcm_gym.arrays import Array
from pcm_gym.kernels.branches.singularity import FORWARD, singularity
from pcm_gym.kernels.branches.smoothness import UNSEEN
from pcm_gym.kernels.branches.steps import (
    AT_END,
    AT_FOLD,
    LOST,
    OTHER_INDEX,
    TAKEN,
    TURNED_BACK,
    predict_and_correct,
    start_naturally,
    step_by_arc,
    step_naturally,
)
from pcm_gym.kernels.branches.tracer import REGULAR, Tracer, accept, make_tracer, place_at, set_parameters, start
from pcm_gym.kernels.numerics.compilation import formula, kernel
from pcm_gym.kernels.statics.closure import LOWER, UPPER, Workspace, make_workspace, place, set_residual
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
    least_natural_step: float = 1.0 / 4.0
    least_step_after_arcs: float = 1.0 / 4096.0
    arc_steps: int = 100
    least_arc: float = 1e-9
    largest_arc: float = 0.2
    # Largest determinant of a state that may be a bifurcation. The branch turns back there, as at a fold, if the inputs
    # have no larger share in the squared arc than this.
    singular: float = 1e-6
    share_at_fold: float = 1e-3
    first_crossing: float = 1e-8  # fraction by which a change of index is stepped over; four times that if in vain


_RULES = LineRules()
# In place of an event: there was none so far.
_GOES_ON = -1


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
    index, is_regular = start_naturally(legs, line, work)
    if not (is_regular and step_naturally(legs, 1.0, index, UNSEEN, line, work).outcome == TAKEN):
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
        index, step = _follow_naturally(legs, reach, least, line, work)
        if line.y[-1] >= reach:
            return NONE
        event = _follow_by_arclength(legs, step, reach, index, line, work)
        if event != _GOES_ON:
            return event
        least = _RULES.least_step_after_arcs
    return SOLVER_FAILURE


@kernel
def _follow_naturally(legs: Array, reach: float, least: float, line: Tracer, work: Workspace) -> tuple[int, float]:
    """Follow the branch in steps of at least this fraction, as far as they lead; return its index and the next step."""
    y, here = line.y, UNSEEN
    step = reach - y[-1]
    index, is_regular = start_naturally(legs, line, work)
    for _ in range(_RULES.natural_steps):
        if not is_regular or y[-1] >= reach or step < least:
            break
        step = min(step, reach - y[-1])
        end = y[-1] + step if step < (reach - y[-1]) * (1.0 - 1e-12) else reach
        tried = step_naturally(legs, end, index, here, line, work)
        if tried.outcome == TAKEN:
            here = tried.there
            for j in range(y.shape[0]):
                y[j], line.tangent[j] = line.trial[j], line.trial_tangent[j]
        step *= tried.growth
    return index, step


@kernel
def _cross(legs: Array, reach: float, line: Tracer, work: Workspace) -> bool:
    """Step over a change of index with the tangent of the arc before it; return whether that succeeded.

    The tangent at the singular state itself would be rounding.
    """
    place_at(legs, line.y, line, work)
    index = assess_stability(legs, line.x, work).morse_index
    rate = line.tangent[-1]
    for j in range(line.tangent.shape[0]):
        line.tangent[j] /= rate
    end, step = line.y[-1], _RULES.first_crossing
    while end < reach:
        end = min(line.y[-1] + step, reach)
        index_beyond = predict_and_correct(legs, end, line, work)
        if index_beyond not in (LOST, index):
            line.y[:] = line.trial
            return True
        step *= 4.0
    return False


@kernel
def _follow_by_arclength(legs: Array, step: float, reach: float, index: int, line: Tracer, work: Workspace) -> int:
    """Follow the branch by arcs, the first one as long as a natural step; return the event that ends it.

    That is `_GOES_ON` after many arcs without one.
    """
    line.border[:] = 0.0
    line.border[-1] = 1.0
    if not start(legs, 1.0, line, work):
        return SOLVER_FAILURE
    arc, longest, here = step / line.tangent[-1], 0.0, UNSEEN
    refused_for, refused_at = SOLVER_FAILURE, math.inf
    for _ in range(_RULES.arc_steps):
        if arc < _RULES.least_arc:
            break
        arc = min(arc, _RULES.largest_arc)
        tried = step_by_arc(legs, arc, reach, index, here, line, work)
        if tried.outcome == AT_FOLD:
            return FOLD
        if tried.outcome == AT_END:
            return NONE
        arc *= tried.growth
        if tried.outcome == TAKEN:
            refused_for = refused_for if line.trial[-1] < refused_at else SOLVER_FAILURE
            arc, longest = (arc * arc / longest if arc < longest else arc), arc  # arcs that shrink go on shrinking
            here = tried.there
            accept(legs, line, work)
        elif tried.outcome == OTHER_INDEX:
            refused_for, refused_at = INDEX_CHANGE, line.trial[-1]
        elif tried.outcome == TURNED_BACK:
            refused_for, refused_at = FOLD, math.inf
    return _GOES_ON if arc >= _RULES.least_arc else _event_at_end(legs, refused_for, line, work)


@kernel
def _event_at_end(legs: Array, refused_for: int, line: Tracer, work: Workspace) -> int:
    """Return the event at `y`, beyond which no arc was taken."""
    if refused_for == SOLVER_FAILURE:
        return refused_for
    place_at(legs, line.y, line, work)
    if abs(singularity(legs, line.x, FORWARD, work)) > _RULES.singular:
        return refused_for
    share = line.border[-1] * line.tangent[-1]  # of the inputs in the squared arc
    return FOLD if share < _RULES.share_at_fold else INDEX_CHANGE
