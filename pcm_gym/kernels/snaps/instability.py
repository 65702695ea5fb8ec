"""What a mechanism does that would lose stability on its way: end there, stay, snap and go on, or go on unstable."""

import numpy as np

from pcm_gym.arrays import Array
from pcm_gym.kernels.branches.continuation import (
    FOLD,
    INDEX_CHANGE,
    NONE,
    SOLVER_FAILURE,
    Tracked,
    judge,
    track,
)
from pcm_gym.kernels.branches.tracer import Tracer
from pcm_gym.kernels.numerics.compilation import formula, kernel
from pcm_gym.kernels.snaps.relaxation import LANDED, STAYED
from pcm_gym.kernels.snaps.snap import snap
from pcm_gym.kernels.statics.closure import Workspace, place
from pcm_gym.kernels.statics.states import Point

# The behaviours.
TERMINATE, HOLD, SNAP, CONTINUE = range(4)

# What `advance` counts: falls, and the energy that they release.
FALLS, ENERGY = 0, 1

# Snaps in one step of the inputs.
_MOST_SNAPS = 8
# Parts of the way left that are tried, one after the other, to get away from a bifurcation into stable branches.
_PARTS_BEYOND = (1.0 / 64.0, 1.0 / 16.0, 1.0 / 4.0, 1.0)


@kernel
def make_falls() -> Array:
    """Return room for what `advance` counts."""
    return np.zeros(2)


@formula
def is_instability(event: int) -> bool:
    """Return whether the event is a loss of stability."""
    return (event == FOLD) | (event == INDEX_CHANGE)


@kernel
def advance(
    legs: Array, point: Point, target: Array, behaviour: int, falls: Array, line: Tracer, work: Workspace
) -> Tracked:
    """Move the inputs of an equilibrium to `target` and change the point; the rod table becomes that of its end.

    The event is the first loss of stability on the way, if there is one. With `TERMINATE` and `HOLD` the way ends
    before it; with `SNAP` only before a bifurcation that the target is too little beyond for a snap; with `CONTINUE`
    only at a fold. After a solver failure the point means nothing. Fills `falls` (2,) with the number of falls and the
    energy that they release.
    """
    falls[:] = 0.0
    if _is_there(point.inputs, target):
        return _stand_still(legs, point, NONE, 1.0, work)
    if behaviour == SNAP:
        return _advance_snapping(legs, point, target, falls, line, work)
    if behaviour == CONTINUE:
        return _advance_continuing(legs, point, target, line, work)
    return track(legs, point, target, point.load, False, line, work)


@kernel
def _advance_continuing(legs: Array, point: Point, target: Array, line: Tracer, work: Workspace) -> Tracked:
    first = Point(point.x.copy(), point.inputs.copy(), point.load)
    tracked = track(legs, point, target, point.load, False, line, work)
    if tracked.event != INDEX_CHANGE:
        return tracked
    point.x[:], point.inputs[:] = first.x, first.inputs  # which tells where the branch leads; a bifurcation does not
    tracked = track(legs, point, target, point.load, True, line, work)
    event = tracked.event
    if event == NONE:
        event = INDEX_CHANGE
    elif event == INDEX_CHANGE:  # it could not be crossed
        event = SOLVER_FAILURE
    return judge(legs, point.x, point.load, event, tracked.fraction, work)


@kernel
def _advance_snapping(legs: Array, point: Point, target: Array, falls: Array, line: Tracer, work: Workspace) -> Tracked:
    first_event = NONE
    for _ in range(_MOST_SNAPS):
        first = Point(point.x.copy(), point.inputs.copy(), point.load)
        tracked = track(legs, point, target, point.load, False, line, work)
        if tracked.event == SOLVER_FAILURE:
            return tracked
        first_event = tracked.event if first_event == NONE else first_event
        if not is_instability(tracked.event):
            return judge(legs, point.x, point.load, first_event, 1.0, work)
        status, released, _ = snap(legs, point, np.empty(0))
        if status == STAYED and tracked.event == INDEX_CHANGE:
            status, released = _snap_beyond(legs, first, point, target, line, work)
            if status == STAYED:
                return _stand_still(legs, point, first_event, tracked.fraction, work)
        if status != LANDED:
            break
        falls[FALLS] += 1.0
        falls[ENERGY] += released
        if _is_there(point.inputs, target):
            return _stand_still(legs, point, first_event, 1.0, work)
    return judge(legs, point.x, point.load, SOLVER_FAILURE, 0.0, work)


@kernel
def _is_there(inputs: Array, target: Array) -> bool:
    is_there = True
    for i in range(inputs.shape[0]):
        is_there = is_there and inputs[i] == target[i]
    return is_there


@kernel
def _stand_still(legs: Array, point: Point, event: int, fraction: float, work: Workspace) -> Tracked:
    """Return the verdict on a point whose rod table may be another one's; near a singular point a step could fail."""
    place(legs, point.x, point.inputs, work)
    return judge(legs, point.x, point.load, event, fraction, work)


@kernel
def _snap_beyond(
    legs: Array, first: Point, point: Point, target: Array, line: Tracer, work: Workspace
) -> tuple[int, float]:
    """Follow the branch from `first` over a bifurcation, no further than needed, and snap; return status and energy.

    `LANDED` if the point is stable beyond it; `STAYED`, and nothing is changed, if the target is so little beyond it
    that the stable branches are still nearer than any disturbance.
    """
    goal = np.empty(target.shape[0])
    for part in _PARTS_BEYOND:
        beyond = Point(first.x.copy(), first.inputs.copy(), point.load)
        for i in range(target.shape[0]):
            goal[i] = target[i] if part == 1.0 else point.inputs[i] + part * (target[i] - point.inputs[i])
        tracked = track(legs, beyond, goal, point.load, True, line, work)
        if tracked.morse_index == 0 and (part < 1.0 or tracked.event != NONE):
            continue
        status, released = LANDED, 0.0
        if tracked.morse_index > 0:
            status, released, _ = snap(legs, beyond, np.empty(0))
        if status == LANDED:
            point.x[:], point.inputs[:] = beyond.x, beyond.inputs
        if status != STAYED:
            return status, released
    return STAYED, 0.0
