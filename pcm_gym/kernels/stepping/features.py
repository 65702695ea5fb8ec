"""What agents observe of a state, of one in the rod table and of many in lanes: smooth numbers of order one."""

import math
from typing import NamedTuple

from pcm_gym.arrays import Array
from pcm_gym.kernels.lockstep import lanes
from pcm_gym.kernels.lockstep.lanes import LANES, Block
from pcm_gym.kernels.lockstep.lanes_margin import set_margins
from pcm_gym.kernels.numerics.compilation import formula, kernel
from pcm_gym.kernels.statics.closure import (
    FORCE_X,
    FORCE_Y,
    HALF_PERIODS,
    LENGTH,
    LOWER,
    STIFFNESS,
    TURN,
    UPPER,
    Workspace,
)

# Loads are shown as g / (LOAD_SCALE + |g|), stiffnesses and distances from a fold likewise: smooth, bounded.
LOAD_SCALE = 10.0
STIFFNESS_SCALE = 20.0
DISTANCE_SCALE = 0.1

# Features of the clamp of a leg that turns, of a rod, and of the margins.
_TURN_FEATURES, _ROD_FEATURES, _MARGIN_FEATURES = 2, 5, 2
# Those that tell of stability stand last: whether it is there, and the margins.
STABILITY_FEATURES = 1 + _MARGIN_FEATURES


class Columns(NamedTuple):
    """Where the parts of the features of a state begin, behind the pose, and where the last one ends."""

    inputs: int  # of each leg its input, and cosine and sine of a clamp that turns
    rods: int
    is_stable: int
    margins: int
    end: int


@kernel
def columns_of(legs: Array, dof: int) -> Columns:
    """Return where the features of a mechanism are."""
    inputs = 2 if dof == 2 else 4  # a platform's angle is seen as cosine and sine
    rods = inputs
    for i in range(legs.shape[0]):
        rods += 1 + (_TURN_FEATURES if legs[i, TURN] != 0.0 else 0)
    is_stable = rods + _ROD_FEATURES * legs.shape[0]
    return Columns(inputs, rods, is_stable, is_stable + 1, is_stable + 1 + _MARGIN_FEATURES)


@kernel
def set_features(legs: Array, x: Array, inputs: Array, work: Workspace, out: Array) -> None:
    """Fill `out` with the features of a state at the rod table, but for its stability: pose, inputs, rods."""
    pose = 2 * legs.shape[0]
    dof = x.shape[0] - pose
    columns = columns_of(legs, dof)
    out[0], out[1] = x[pose], x[pose + 1]
    if dof == 3:
        out[2], out[3] = math.cos(x[pose + 2]), math.sin(x[pose + 2])
    n = columns.inputs
    for i in range(legs.shape[0]):
        out[n] = _input_feature(inputs[i], legs[i, LOWER], legs[i, UPPER])
        n += 1
        if legs[i, TURN] != 0.0:
            out[n], out[n + 1] = work.clamps[i, 2], work.clamps[i, 3]
            n += _TURN_FEATURES
    for i in range(legs.shape[0]):
        rod, clamp = work.rods[i], work.clamps[i]
        force = (rod[FORCE_X], rod[FORCE_Y])
        features = _rod_features(
            x[2 * i], x[2 * i + 1], force, clamp[2], clamp[3], _force_unit(legs, i), rod[HALF_PERIODS]
        )
        n = columns.rods + _ROD_FEATURES * i
        for k in range(_ROD_FEATURES):
            out[n + k] = features[k]


@kernel
def see_block(legs: Array, block: Block, count: int, computed: int, dof: int, out: Array) -> None:
    """Fill the margins of lanes that are evaluated and judged, and `out` (m, lanes) as `set_features` does."""
    set_margins(legs, block, computed, dof)
    common, columns = block.common, columns_of(legs, dof)
    out[0], out[1] = common[lanes.X : lanes.X + LANES], common[lanes.Y : lanes.Y + LANES]
    if dof == 3:
        out[2] = common[lanes.TURN_C : lanes.TURN_C + LANES]
        out[3] = common[lanes.TURN_S : lanes.TURN_S + LANES]
    n = columns.inputs
    for i in range(legs.shape[0]):
        leg, lower, upper = block.legs[i], legs[i, LOWER], legs[i, UPPER]
        for lane in range(count):
            out[n, lane] = _input_feature(leg[lanes.TARGET + lane], lower, upper)
        n += 1
        if legs[i, TURN] != 0.0:
            out[n] = leg[lanes.CLAMP_C : lanes.CLAMP_C + LANES]
            out[n + 1] = leg[lanes.CLAMP_S : lanes.CLAMP_S + LANES]
            n += _TURN_FEATURES
    for i in range(legs.shape[0]):
        n = columns.rods + _ROD_FEATURES * i
        _see_rod(block.legs[i], count, _force_unit(legs, i), out[n : n + _ROD_FEATURES].reshape(-1))


@kernel
def _see_rod(leg: Array, count: int, force_unit: float, out: Array) -> None:
    for lane in range(count):
        g_x, g_y = leg[lanes.G_X + lane], leg[lanes.G_Y + lane]
        force, half_periods = (leg[lanes.FORCE_X + lane], leg[lanes.FORCE_Y + lane]), leg[lanes.HALF_PERIODS + lane]
        clamp_c, clamp_s = leg[lanes.CLAMP_C + lane], leg[lanes.CLAMP_S + lane]
        features = _rod_features(g_x, g_y, force, clamp_c, clamp_s, force_unit, half_periods)
        out[lane] = features[0]
        out[LANES + lane] = features[1]
        out[2 * LANES + lane] = features[2]
        out[3 * LANES + lane] = features[3]
        out[4 * LANES + lane] = features[4]


@formula
def _input_feature(value: float, lower: float, upper: float) -> float:
    return (2.0 * value - lower - upper) / (upper - lower)


@formula
def _force_unit(legs: Array, leg: int) -> float:
    """Return the factor that makes the force on a rod dimensionless."""
    length, stiffness = float(legs[leg, LENGTH]), float(legs[leg, STIFFNESS])
    return length * length / stiffness


@formula
def _rod_features(
    g_x: float,
    g_y: float,
    force: tuple[float, float],
    clamp_c: float,
    clamp_s: float,
    force_unit: float,
    half_periods: float,
) -> tuple[float, float, float, float, float]:
    scale = 1.0 / (LOAD_SCALE + math.sqrt(g_x * g_x + g_y * g_y))
    along, across = clamp_c * force[0] + clamp_s * force[1], clamp_c * force[1] - clamp_s * force[0]
    force_scale = scale * force_unit
    return scale * g_x, scale * g_y, force_scale * along, force_scale * across, half_periods / (1.0 + half_periods)


@formula
def stability_features(is_stable: bool, stability_margin: float, margin: float) -> tuple[float, float, float]:
    """Return the features of a state that tell of its stability."""
    return (
        1.0 if is_stable else 0.0,
        stability_margin / (STIFFNESS_SCALE + abs(stability_margin)),
        margin / (DISTANCE_SCALE + margin),
    )
