"""A fall as mechanisms make it: the motion of whole rods, on as many points as it needs."""

from pcm_gym.arrays import Array
from pcm_gym.kernels.numerics.compilation import kernel
from pcm_gym.kernels.snaps.moving_rods import make_grid, make_moving_rods
from pcm_gym.kernels.snaps.relaxation import LANDED, RelaxationRules, Relaxed, relax
from pcm_gym.kernels.statics.closure import Workspace

_RULES = RelaxationRules()
# The second grid is tried where the first does not lead to a landing.
_GRID, _FINE_GRID = make_grid(20), make_grid(40)


@kernel
def fall(legs: Array, x: Array, inputs: Array, load: Array, work: Workspace) -> tuple[Relaxed, Array]:
    """Let the mechanism fall as `relax` does; also return the energies (steps + 1,) at the start and after each step.

    Takes the memory for the motion each time: a fall takes a thousand times as long as that.
    """
    moving = make_moving_rods(_GRID, legs.shape[0], x.shape[0], _RULES.steps)
    relaxed = relax(legs, x, inputs, load, _RULES, moving, work)
    if relaxed.status != LANDED:
        moving = make_moving_rods(_FINE_GRID, legs.shape[0], x.shape[0], _RULES.steps)
        relaxed = relax(legs, x, inputs, load, _RULES, moving, work)
    return relaxed, moving.energies[: relaxed.steps + 1]
