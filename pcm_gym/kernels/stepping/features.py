"""What agents observe of a state, of one in the rod table and of many in lanes: smooth numbers of order one."""

import math
from typing import NamedTuple

from pcm_gym.arrays import Array
from pcm_gym.kernels.lockstep.layout import LANES, Block, LegLanes
from pcm_gym.kernels.lockstep.layout import pair as pair_in
from pcm_gym.kernels.numerics.compilation import formula, kernel
from pcm_gym.kernels.statics.closure import (
    CLAMP_COS,
    CLAMP_SIN,
    FORCE_X,
    HALF_PERIODS,
    LENGTH,
    LOWER,
    STIFFNESS,
    TIP_X,
    TURN,
    UPPER,
    Workspace,
    actuator_of,
    pair,
)
from pcm_gym.kernels.statics.formulas import Pair, clamp_angle, scaled, turned
from pcm_gym.kernels.stepping.goals import set_pose_seen
from pcm_gym.kernels.structure.strength import actuator_force

# Loads are shown as g / (LOAD_SCALE + |g|), stiffnesses and distances from a fold likewise: smooth, bounded.
LOAD_SCALE = 10.0
STIFFNESS_SCALE = 20.0
DISTANCE_SCALE = 0.1

# Features of the clamp of a leg that turns, of a rod, and of the margins.
_TURN_FEATURES, ROD_FEATURES, _MARGIN_FEATURES = 2, 5, 2
# Those that tell of stability stand last: whether it is there, and the margins.
STABILITY_FEATURES = 1 + _MARGIN_FEATURES


class Columns(NamedTuple):
    """Where the parts of the features of a state begin, behind the pose, and where the last one ends."""

    inputs: int  # of each leg its input, and cosine and sine of a clamp that turns
    rods: int
    efforts: int  # of each leg what its actuator gives
    is_stable: int
    margins: int
    end: int


@formula
def _input_features(turn: float) -> int:
    """Return how many features an input has: where it is in its range, and of an angle cosine and sine."""
    return 1 if turn == 0.0 else 1 + _TURN_FEATURES


def feature_columns(legs: Array, dof: int) -> Columns:
    """Return where the features of a mechanism are."""
    inputs = 2 if dof == 2 else 4  # a platform's angle is seen as cosine and sine
    rods = inputs
    for i in range(legs.shape[0]):
        rods += _input_features(legs[i, TURN])
    efforts = rods + ROD_FEATURES * legs.shape[0]
    is_stable = efforts + legs.shape[0]
    return Columns(inputs, rods, efforts, is_stable, is_stable + 1, is_stable + 1 + _MARGIN_FEATURES)


# The same for kernels. Python must not ask a kernel for a named tuple: Numba cannot hand one over while a signal waits.
columns_of = kernel(feature_columns)


@kernel
def set_features(legs: Array, x: Array, inputs: Array, work: Workspace, out: Array) -> None:
    """Fill `out` with the features of a state at the rod table, but for its stability: pose, inputs, rods, efforts."""
    pose = 2 * legs.shape[0]
    columns = columns_of(legs, x.shape[0] - pose)
    set_pose_seen(x[pose:], out)
    n = columns.inputs
    for i in range(legs.shape[0]):
        out[n] = _input_feature(inputs[i], legs[i, LOWER], legs[i, UPPER])
        if legs[i, TURN] != 0.0:
            out[n + 1], out[n + 2] = work.clamps[i, CLAMP_COS], work.clamps[i, CLAMP_SIN]
        n += _input_features(legs[i, TURN])
    for i in range(legs.shape[0]):
        rod, clamp = work.rods[i], pair(work.clamps[i], CLAMP_COS)
        force, n = pair(rod, FORCE_X), columns.rods + ROD_FEATURES * i
        features = _rod_features(pair(x, 2 * i), force, clamp, _force_scale(legs, i), rod[HALF_PERIODS])
        for k in range(ROD_FEATURES):
            out[n + k] = features[k]
        out[columns.efforts + i] = _effort_feature(legs, i, pair(rod, TIP_X), force)


@kernel
def see_block(legs: Array, block: Block, count: int, dof: int, out: Array) -> None:
    """Fill `out` (m, lanes) as `set_features` does."""
    common, columns = block.common[0], columns_of(legs, dof)
    out[0], out[1] = common.pose[0], common.pose[1]
    if dof == 3:
        out[2], out[3] = common.turn[0], common.turn[1]
    n = columns.inputs
    for i in range(legs.shape[0]):
        leg, lower, upper = block.legs[i], legs[i, LOWER], legs[i, UPPER]
        for lane in range(count):
            out[n, lane] = _input_feature(leg.target[lane], lower, upper)
        if legs[i, TURN] != 0.0:
            out[n + 1], out[n + 2] = leg.direction[0], leg.direction[1]
        n += _input_features(legs[i, TURN])
    for i in range(legs.shape[0]):
        n = columns.rods + ROD_FEATURES * i
        _see_rod(block.legs[i], count, _force_scale(legs, i), out[n : n + ROD_FEATURES].reshape(-1))
        leg, effort = block.legs[i], out[columns.efforts + i]
        for lane in range(count):
            effort[lane] = _effort_feature(legs, i, pair_in(leg.tip, lane), pair_in(leg.force, lane))


@kernel
def _see_rod(leg: LegLanes, count: int, force_scale: float, out: Array) -> None:
    for lane in range(count):
        force, clamp = pair_in(leg.force, lane), pair_in(leg.direction, lane)
        features = _rod_features(pair_in(leg.g, lane), force, clamp, force_scale, leg.half_periods[lane])
        out[lane] = features[0]
        out[LANES + lane] = features[1]
        out[2 * LANES + lane] = features[2]
        out[3 * LANES + lane] = features[3]
        out[4 * LANES + lane] = features[4]


@formula
def _input_feature(value: float, lower: float, upper: float) -> float:
    return (2.0 * value - lower - upper) / (upper - lower)


@formula
def _force_scale(legs: Array, leg: int) -> float:
    """Return the factor that makes the force on a rod dimensionless, L^2 / EI."""
    length, stiffness = float(legs[leg, LENGTH]), float(legs[leg, STIFFNESS])
    return length * length / stiffness


@formula
def _rod_features(
    g: Pair, force: Pair, clamp: Pair, force_scale: float, half_periods: float
) -> tuple[float, float, float, float, float]:
    """Return load and force, as the tip and the clamp see them, and the buckling mode."""
    scale = 1.0 / (LOAD_SCALE + math.sqrt(g[0] * g[0] + g[1] * g[1]))
    along, across = clamp[0] * force[0] + clamp[1] * force[1], clamp[0] * force[1] - clamp[1] * force[0]
    own_scale = scale * force_scale
    return scale * g[0], scale * g[1], own_scale * along, own_scale * across, half_periods / (1.0 + half_periods)


@formula
def force_and_periods(g: Pair, features: Array, first: int) -> tuple[Pair, float]:
    """Return the force on a rod of unit length and stiffness, as its clamp sees it, and its half periods.

    They are taken back from the rod's features, of which the `first` has this number.
    """
    scale = LOAD_SCALE + math.sqrt(g[0] * g[0] + g[1] * g[1])
    force, share = (scale * features[first + 2], scale * features[first + 3]), features[first + 4]
    return force, share / (1.0 - share)


@kernel
def set_loads_seen(
    legs: Array, states: Array, inputs: Array, features: Array, tip_forces: Array, efforts: Array
) -> None:
    """Fill the forces on the rods' tips (n, legs, 2), world frame, and what actuators give (n, legs), from features."""
    columns = columns_of(legs, states.shape[1] - 2 * legs.shape[0])
    for n in range(states.shape[0]):
        for i in range(legs.shape[0]):
            force, _ = force_and_periods(pair(states[n], 2 * i), features[n], columns.rods + ROD_FEATURES * i)
            angle, scale = clamp_angle(actuator_of(legs, i), inputs[n, i]), 1.0 / _force_scale(legs, i)
            tip_forces[n, i, 0], tip_forces[n, i, 1] = turned(scaled(scale, (math.cos(angle), math.sin(angle))), force)
            share = features[n, columns.efforts + i]
            efforts[n, i] = LOAD_SCALE * share / (1.0 - abs(share))


@formula
def _effort_feature(legs: Array, leg: int, tip: Pair, force: Pair) -> float:
    """Return what an actuator gives, its torque or force."""
    effort = actuator_force(actuator_of(legs, leg), tip, force)
    return effort / (LOAD_SCALE + abs(effort))


@formula
def stability_features(is_stable: bool, stability_margin: float, margin: float) -> tuple[float, float, float]:
    """Return the features of a state that tell of its stability."""
    return (
        1.0 if is_stable else 0.0,
        stability_margin / (STIFFNESS_SCALE + abs(stability_margin)),
        margin / (DISTANCE_SCALE + margin),
    )
