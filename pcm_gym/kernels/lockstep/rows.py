"""Rows of a batch go into the lanes of a block and come back."""

from pcm_gym.arrays import Array
from pcm_gym.kernels.lockstep.layout import Block
from pcm_gym.kernels.numerics.compilation import formula, kernel
from pcm_gym.kernels.statics.states import States


@formula
def load_lane(states: States, row: int, target: Array, block: Block, lane: int) -> None:
    """Put the state of a row, and the inputs that it is to move to, into a lane."""
    common, leg_count, dof = block.common[0], block.legs.shape[0], states.load.shape[1]
    for i in range(leg_count):
        leg = block.legs[i]
        leg.g[0, lane] = states.x[row, 2 * i]
        leg.g[1, lane] = states.x[row, 2 * i + 1]
        leg.input[lane] = states.inputs[row, i]
        leg.target[lane] = target[i]
    for d in range(3):
        common.pose[d, lane] = states.x[row, 2 * leg_count + d] if d < dof else 0.0
        common.load[d, lane] = states.load[row, d] if d < dof else 0.0


@formula
def store_state(block: Block, lane: int, x: Array) -> None:
    """Fill `x` (size,) with the state that a lane has come to."""
    common, leg_count = block.common[0], block.legs.shape[0]
    for i in range(leg_count):
        leg = block.legs[i]
        x[2 * i] = leg.g[0, lane]
        x[2 * i + 1] = leg.g[1, lane]
    for d in range(x.shape[0] - 2 * leg_count):
        x[2 * leg_count + d] = common.pose[d, lane]


@formula
def store_lane(states: States, row: int, block: Block, lane: int) -> None:
    """Put the state and the inputs that a lane has come to into its row."""
    store_state(block, lane, states.x[row])
    for i in range(block.legs.shape[0]):
        states.inputs[row, i] = block.legs[i].target[lane]


@kernel
def set_way_point(start: Array, target: Array, fraction: float, point: Array) -> None:
    """Set the point at a fraction of the way; at the end of it exactly the target."""
    for i in range(start.shape[0]):
        point[i] = target[i] if fraction == 1.0 else start[i] + fraction * (target[i] - start[i])
