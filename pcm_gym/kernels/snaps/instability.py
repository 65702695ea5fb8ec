"""What a mechanism does that would lose stability on its way: end there, stay, fall and go on, or go on unstable."""

import numpy as np

from pcm_gym.arrays import Array
from pcm_gym.kernels.branches.continuation import (
    FOLD,
    INDEX_CHANGE,
    NONE,
    SOLVER_FAILURE,
    Line,
    Tracked,
    judge,
    track,
)
from pcm_gym.kernels.numerics.compilation import formula, kernel
from pcm_gym.kernels.snaps.falls import fall
from pcm_gym.kernels.snaps.relaxation import LANDED, STAYED
from pcm_gym.kernels.statics.closure import Workspace, place

# The behaviours.
TERMINATE, HOLD, SNAP, CONTINUE = range(4)

# Falls in one step of the inputs.
_MOST_FALLS = 8
# Parts of the way left that are tried, one after the other, to get away from a bifurcation into stable branches.
_PARTS_BEYOND = (1.0 / 256.0, 1.0 / 64.0, 1.0 / 16.0, 1.0 / 4.0, 1.0)


@formula
def is_instability(event: int) -> bool:
    """Return whether the event is a loss of stability."""
    return (event == FOLD) | (event == INDEX_CHANGE)


@kernel
def advance(
    legs: Array, x: Array, inputs: Array, load: Array, target: Array, behaviour: int, line: Line, work: Workspace
) -> Tracked:
    """Move the inputs from an equilibrium to `target` and change `x` and `inputs`; the rod table is that of `x`.

    The event is the first loss of stability on the way, if there is one. With `TERMINATE` and `HOLD` the way ends
    before it; with `SNAP` only before a bifurcation that the target is too little beyond for a fall; with `CONTINUE`
    only at a fold. After a solver failure `x` and `inputs` mean nothing.
    """
    if _is_there(inputs, target):
        return _stand_still(legs, x, inputs, load, NONE, 1.0, work)
    if behaviour == SNAP:
        return _advance_falling(legs, x, inputs, load, target, line, work)
    tracked = track(legs, x, inputs, load, target, load.copy(), False, line, work)
    if behaviour != CONTINUE or tracked.event != INDEX_CHANGE:
        return tracked
    tracked = track(legs, x, inputs, load, target, load.copy(), True, line, work)
    if tracked.event == INDEX_CHANGE:  # it could not be crossed
        return judge(legs, x, load, SOLVER_FAILURE, tracked.fraction, work)
    return judge(legs, x, load, INDEX_CHANGE if tracked.event == NONE else tracked.event, tracked.fraction, work)


@kernel
def _advance_falling(
    legs: Array, x: Array, inputs: Array, load: Array, target: Array, line: Line, work: Workspace
) -> Tracked:
    first_event = NONE
    for _ in range(_MOST_FALLS):
        tracked = track(legs, x, inputs, load, target, load.copy(), False, line, work)
        if tracked.event == SOLVER_FAILURE:
            return tracked
        if not is_instability(tracked.event):
            return judge(legs, x, load, tracked.event if first_event == NONE else first_event, 1.0, work)
        first_event = tracked.event if first_event == NONE else first_event
        status = fall(legs, x, inputs, load, work)[0].status
        if status == STAYED and tracked.event == INDEX_CHANGE:
            status = _fall_beyond(legs, x, inputs, load, target, line, work)
            if status == STAYED:
                return _stand_still(legs, x, inputs, load, first_event, tracked.fraction, work)
        if status != LANDED:
            break
        if _is_there(inputs, target):
            return _stand_still(legs, x, inputs, load, first_event, 1.0, work)
    return judge(legs, x, load, SOLVER_FAILURE, 0.0, work)


@kernel
def _is_there(inputs: Array, target: Array) -> bool:
    is_there = True
    for i in range(inputs.shape[0]):
        is_there = is_there and inputs[i] == target[i]
    return is_there


@kernel
def _stand_still(
    legs: Array, x: Array, inputs: Array, load: Array, event: int, fraction: float, work: Workspace
) -> Tracked:
    """Return the verdict on a state whose rod table may be another one's; near a singular point a step could fail."""
    place(legs, x, inputs, work)
    return judge(legs, x, load, event, fraction, work)


@kernel
def _fall_beyond(legs: Array, x: Array, inputs: Array, load: Array, target: Array, line: Line, work: Workspace) -> int:
    """Follow the branch over a bifurcation, no further than needed, and fall from there; return a status.

    `LANDED` if `x` and `inputs` are stable beyond it; `STAYED`, and nothing is changed, if the target is so little
    beyond it that the stable branches are still nearer than any disturbance.
    """
    beyond, inputs_beyond, goal = np.empty(x.shape[0]), np.empty(inputs.shape[0]), np.empty(inputs.shape[0])
    for part in _PARTS_BEYOND:
        beyond[:], inputs_beyond[:] = x, inputs
        for i in range(inputs.shape[0]):
            goal[i] = target[i] if part == 1.0 else inputs[i] + part * (target[i] - inputs[i])
        tracked = track(legs, beyond, inputs_beyond, load, goal, load.copy(), True, line, work)
        if tracked.morse_index == 0 and (part < 1.0 or tracked.event != NONE):
            continue
        status = fall(legs, beyond, inputs_beyond, load, work)[0].status if tracked.morse_index > 0 else LANDED
        if status == LANDED:
            x[:], inputs[:] = beyond, inputs_beyond
        if status != STAYED:
            return status
    return STAYED
