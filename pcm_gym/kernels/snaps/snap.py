"""A snap as mechanisms make it: the motion of whole rods, on as many points as it needs."""

from pcm_gym.arrays import Array
from pcm_gym.kernels.numerics.compilation import kernel
from pcm_gym.kernels.snaps.moving_rods import make_grid, make_moving_rods
from pcm_gym.kernels.snaps.relaxation import LANDED, RelaxationRules, relax
from pcm_gym.kernels.statics.closure import make_workspace
from pcm_gym.kernels.statics.states import Point

_RULES = RelaxationRules()
MOST_ENERGIES = _RULES.steps + 1
# The second grid is tried where the first does not lead to a landing.
_GRID, _FINE_GRID = make_grid(20), make_grid(40)


@kernel
def snap(legs: Array, point: Point, energies: Array) -> tuple[int, float, int]:
    """Let the mechanism snap as `relax` does; return status, energy released and the number of steps.

    Fills `energies` (m,), up to `MOST_ENERGIES`, with those at the start and after each step, as far as there is room.
    Takes the memory for the motion each time: a snap takes a thousand times as long as that.
    """
    leg_count, size = legs.shape[0], point.x.shape[0]
    work = make_workspace(leg_count, size)
    moving = make_moving_rods(_GRID, leg_count, size, _RULES.steps)
    status, steps, released = relax(legs, point, _RULES, moving, work)
    if status != LANDED:
        moving = make_moving_rods(_FINE_GRID, leg_count, size, _RULES.steps)
        status, steps, released = relax(legs, point, _RULES, moving, work)
    for n in range(min(steps + 1, energies.shape[0])):
        energies[n] = moving.energies[n]
    return status, released, steps
