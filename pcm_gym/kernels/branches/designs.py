"""One equilibrium followed from one design to another, its inputs and its load held."""

from pcm_gym.arrays import Array
from pcm_gym.kernels.branches.steps import STEP_RULES
from pcm_gym.kernels.numerics.compilation import kernel
from pcm_gym.kernels.statics.closure import make_workspace, place
from pcm_gym.kernels.statics.newton import CONVERGED, solve_forward_locally
from pcm_gym.kernels.statics.stability import assess_stability

# Least part of the way from one design to the other that is tried at once.
_LEAST_PART = 1.0 / 4096.0


@kernel
def follow_design(legs: Array, goal: Array, x: Array, inputs: Array, load: Array) -> bool:
    """Move the state `x` in place from the leg table `legs` to the leg table `goal`; return whether it gets there.

    Each part of the way is a step of Newton's method from where the last one ended, taken only if it converges as a
    natural step of `steps` must, and the Morse index stays: otherwise it is halved.
    """
    work, trial = make_workspace(legs.shape[0], x.shape[0]), x.copy()
    place(legs, x, inputs, work)
    index = assess_stability(legs, x, work).morse_index
    done, part = 0.0, 1.0
    while done < 1.0:
        end = done + part if part < 1.0 - done else 1.0
        between = goal if end == 1.0 else legs + end * (goal - legs)
        trial[:] = x
        is_taken = solve_forward_locally(between, inputs, load, trial, STEP_RULES, work) == CONVERGED
        if is_taken:
            place(between, trial, inputs, work)
            is_taken = assess_stability(between, trial, work).morse_index == index
        if is_taken:
            x[:], done, part = trial, end, 2.0 * part
        else:
            part *= 0.5
            if part < _LEAST_PART:
                return False
    return True
