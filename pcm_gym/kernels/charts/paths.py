"""Following a path of poses: the inputs that lead the end-effector along it."""

import numpy as np

from pcm_gym.arrays import Array, Mask
from pcm_gym.kernels.branches.continuation import NONE, make_line, track_in_one_step
from pcm_gym.kernels.numerics.compilation import kernel
from pcm_gym.kernels.statics.closure import LOWER, UPPER, make_workspace
from pcm_gym.kernels.statics.margin import singularity_margin
from pcm_gym.kernels.statics.newton import CONVERGED, NewtonRules, solve_inverse_locally
from pcm_gym.kernels.statics.states import Point, States, are_same

_RULES = NewtonRules(first_correction=0.3, contraction=0.5, iterations=10)


@kernel
def follow_path(
    legs: Array, load: Array, poses: Array, largest_step: Array, least_margin: float, x: Array, inputs: Array
) -> int:
    """Bring the stable state in row 0 of `x` (p, size) and `inputs` (p, legs) along `poses` (p, d), filling the rows.

    Returns how many poses are reached: by steps of the inputs of at most `largest_step` each, within the limits, on one
    branch that stays stable and keeps the margin. Row 0 must be at the first pose.
    """
    leg_count, size = legs.shape[0], x.shape[1]
    line, work = make_line(leg_count, size), make_workspace(leg_count, size)
    here = Point(x[0].copy(), inputs[0].copy(), load)
    for k in range(1, poses.shape[0]):
        x[k], inputs[k] = here.x, here.inputs
        x[k, 2 * leg_count :] = poses[k]
        if solve_inverse_locally(legs, inputs[k], load, x[k], _RULES, work) != CONVERGED:
            return k
        for i in range(leg_count):
            if not legs[i, LOWER] <= inputs[k, i] <= legs[i, UPPER]:
                return k
            if not abs(inputs[k, i] - here.inputs[i]) <= largest_step[i]:
                return k
        tracked = track_in_one_step(legs, here, inputs[k], line, work)
        is_stable = tracked.event == NONE and tracked.morse_index == 0
        if not is_stable or singularity_margin(legs, here.x, work) < least_margin:
            return k
        if not are_same(here.x, x[k], leg_count):
            return k
    return int(poses.shape[0])


@kernel
def step_to_poses(
    legs: Array, poses: Array, largest_step: Array, least_margin: float, states: States, has_arrived: Mask
) -> None:
    """Bring stable states (n, ...) to poses (n, d), one step each, and fill `has_arrived` (n,).

    As `follow_path` does; those that do not arrive are left as they were.
    """
    size, leg_count = states.x.shape[1], legs.shape[0]
    path, path_x, path_inputs = np.empty((2, poses.shape[1])), np.empty((2, size)), np.empty((2, leg_count))
    for n in range(poses.shape[0]):
        path[0], path[1], path_x[0], path_inputs[0] = (
            states.x[n, 2 * leg_count :],
            poses[n],
            states.x[n],
            states.inputs[n],
        )
        reached = follow_path(legs, states.load[n], path, largest_step, least_margin, path_x, path_inputs)
        has_arrived[n] = reached == 2
        if reached == 2:
            states.x[n], states.inputs[n] = path_x[1], path_inputs[1]
