"""Rows of a batch go into the lanes of a block and come back."""

from pcm_gym.arrays import Array
from pcm_gym.kernels.lockstep import lanes
from pcm_gym.kernels.lockstep.lanes import LANES, Block
from pcm_gym.kernels.numerics.compilation import formula, kernel
from pcm_gym.kernels.statics.states import States

# A step that is refused is halved, down to this part of it, before it is tracked alone.
LEAST_PART = 0.25


@formula
def load_lane(states: States, row: int, target: Array, block: Block, lane: int) -> None:
    """Put the state of a row, and the inputs that it is to move to, into a lane."""
    leg_runs, common, leg_count, dof = block.legs, block.common, block.legs.shape[0], states.load.shape[1]
    for i in range(leg_count):
        leg_runs[i, lanes.G_X + lane] = states.x[row, 2 * i]
        leg_runs[i, lanes.G_Y + lane] = states.x[row, 2 * i + 1]
        leg_runs[i, lanes.INPUT + lane] = states.inputs[row, i]
        leg_runs[i, lanes.TARGET + lane] = target[i]
    for d in range(3):
        common[lanes.X + d * LANES + lane] = states.x[row, 2 * leg_count + d] if d < dof else 0.0
        common[lanes.LOAD_X + d * LANES + lane] = states.load[row, d] if d < dof else 0.0


@formula
def store_lane(states: States, row: int, block: Block, lane: int) -> None:
    """Put the state that a lane has come to into its row."""
    leg_runs, common, leg_count = block.legs, block.common, block.legs.shape[0]
    for i in range(leg_count):
        states.x[row, 2 * i] = leg_runs[i, lanes.G_X + lane]
        states.x[row, 2 * i + 1] = leg_runs[i, lanes.G_Y + lane]
        states.inputs[row, i] = leg_runs[i, lanes.TARGET + lane]
    for d in range(states.load.shape[1]):
        states.x[row, 2 * leg_count + d] = common[lanes.X + d * LANES + lane]


@kernel
def set_way_point(start: Array, target: Array, fraction: float, point: Array) -> None:
    """Set the point at a fraction of the way; at the end of it exactly the target."""
    for i in range(start.shape[0]):
        point[i] = target[i] if fraction == 1.0 else start[i] + fraction * (target[i] - start[i])
