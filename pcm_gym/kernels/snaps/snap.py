"""A snap as mechanisms make it: the motion of whole rods, on as many points as it needs."""

from pcm_gym.arrays import Array
from pcm_gym.kernels.numerics.compilation import kernel
from pcm_gym.kernels.snaps.moving_rods import make_grid, make_moving_rods
from pcm_gym.kernels.snaps.relaxation import LANDED, RelaxationRules, relax
from pcm_gym.kernels.statics.closure import make_workspace
from pcm_gym.kernels.statics.states import Point

_RULES = RelaxationRules()
# The second grid is tried where the first does not lead to a landing.
_GRID, _FINE_GRID = make_grid(20), make_grid(40)


@kernel
def snap(legs: Array, point: Point) -> tuple[int, float, Array]:
    """Let the mechanism snap as `relax` does; return status, energy released and the energies (steps + 1,).

    Those are the energies at the start and after each step. Takes the memory for the motion each time: a snap takes a
    thousand times as long as that.
    """
    leg_count, size = legs.shape[0], point.x.shape[0]
    work = make_workspace(leg_count, size)
    moving = make_moving_rods(_GRID, leg_count, size, _RULES.steps)
    status, steps, released = relax(legs, point, _RULES, moving, work)
    if status != LANDED:
        moving = make_moving_rods(_FINE_GRID, leg_count, size, _RULES.steps)
        status, steps, released = relax(legs, point, _RULES, moving, work)
    return status, released, moving.energies[: steps + 1]
