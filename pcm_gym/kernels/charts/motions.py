"""Motions from one equilibrium to another: what planning asks of many states at once."""

import numpy as np

from pcm_gym.arrays import Array, Mask
from pcm_gym.kernels.branches.continuation import NONE, make_line, track
from pcm_gym.kernels.numerics.compilation import kernel
from pcm_gym.kernels.numerics.slices import slices
from pcm_gym.kernels.statics.closure import LOWER, UPPER, make_workspace, place
from pcm_gym.kernels.statics.equilibrium import set_forward_jacobian
from pcm_gym.kernels.statics.margin import singularity_margin
from pcm_gym.kernels.statics.newton import CONVERGED, NewtonRules, solve_forward_locally, solve_inverse_locally
from pcm_gym.kernels.statics.stability import assess_stability
from pcm_gym.kernels.statics.states import Point, States

# A goal's pose is near the node from which it is sought, another mechanism's state is near the one that is known.
_TO_POSE = NewtonRules(first_correction=1.0, contraction=0.7, iterations=12)
_TO_OTHER = NewtonRules(first_correction=1.0, contraction=0.7, iterations=20)
# States that are corrected in one call of compiled code.
_CORRECTED_AT_ONCE = 4096


@kernel
def follow_inputs(legs: Array, load: Array, inputs: Array, least_margin: float, x: Array) -> int:
    """Bring the stable state in row 0 of `x` (p, size) to each of `inputs` (p, legs) in turn, filling the rows.

    Returns how many are reached on one branch that stays stable, within the limits, and keeps the margin at each.
    """
    leg_count, size = legs.shape[0], x.shape[1]
    line, work = make_line(leg_count, size), make_workspace(leg_count, size)
    here = Point(x[0].copy(), inputs[0].copy(), load.copy())
    for k in range(1, inputs.shape[0]):
        tracked = track(legs, here, inputs[k], load, False, line, work)
        if tracked.event != NONE or tracked.morse_index > 0:
            return k
        if singularity_margin(legs, here.x, work) < least_margin:
            return k
        x[k] = here.x
    return int(inputs.shape[0])


def meet_poses(legs: Array, states: States) -> Mask:
    """Correct rods and inputs, in place, to equilibria at the poses in `states` (n, ...); return where that is done."""
    return _corrected(legs, states, True)


def settle(legs: Array, states: States) -> Mask:
    """Correct rods and poses, in place, to stable equilibria at the inputs in `states` (n, ...); return where."""
    return _corrected(legs, states, False)


def _corrected(legs: Array, states: States, is_at_pose: bool) -> Mask:
    is_done = np.zeros(len(states.x), dtype=np.bool_)
    for first, last in slices(len(is_done), _CORRECTED_AT_ONCE):
        _correct(legs, States(*(array[first:last] for array in states)), is_at_pose, is_done[first:last])
    return is_done


@kernel
def _correct(legs: Array, states: States, is_at_pose: bool, is_done: Mask) -> None:
    leg_count, size = legs.shape[0], states.x.shape[1]
    work = make_workspace(leg_count, size)
    for n in range(states.x.shape[0]):
        x, inputs, load = states.x[n], states.inputs[n], states.load[n]
        if is_at_pose:
            status = solve_inverse_locally(legs, inputs, load, x, _TO_POSE, work)
        else:
            status = solve_forward_locally(legs, inputs, load, x, _TO_OTHER, work)
        if status != CONVERGED:
            continue
        place(legs, x, inputs, work)
        is_within = True
        for i in range(leg_count):
            is_within = is_within and legs[i, LOWER] <= inputs[i] <= legs[i, UPPER]
        is_done[n] = is_within and assess_stability(legs, x, work).morse_index == 0


def forward_jacobians(legs: Array, x: Array, inputs: Array) -> Array:
    """Return d pose / d inputs of states (n, size) at inputs (n, legs), (n, d, legs); 0 where it does not exist."""
    found = np.zeros((len(x), x.shape[1] - 2 * legs.shape[0], legs.shape[0]))
    for first, last in slices(len(x), _CORRECTED_AT_ONCE):
        _set_jacobians(legs, x[first:last], inputs[first:last], found[first:last])
    return found


@kernel
def _set_jacobians(legs: Array, x: Array, inputs: Array, found: Array) -> None:
    work = make_workspace(legs.shape[0], x.shape[1])
    for n in range(x.shape[0]):
        place(legs, x[n], inputs[n], work)
        if not set_forward_jacobian(legs, x[n], work, found[n]):
            found[n] = 0.0
