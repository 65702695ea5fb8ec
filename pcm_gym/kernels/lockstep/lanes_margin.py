"""The singularity margin of many rows in lock-step: that of `margin`, with vector instructions.

Its derivatives also tell whether the step that ends there may have passed a singular state.

The rods are condensed here. The gradient of v' K v at fixed v, by the pose and by the inputs, is carried along the
sheet by one more solution for each eigenvector v, whatever the number of inputs.
"""

import math

from pcm_gym.arrays import Array
from pcm_gym.kernels.branches.smoothness import compliance_before, is_far_from_zero
from pcm_gym.kernels.lockstep.layout import (
    Block,
    CommonLanes,
    LegLanes,
    add_triple,
    derivatives,
    functions_of,
    pair,
    set_pair,
    set_triple,
    set_vector,
    triple,
    vector,
)
from pcm_gym.kernels.numerics.compilation import formula, kernel
from pcm_gym.kernels.rods.curvature import bend, lag_in_lanes, rod_curvature
from pcm_gym.kernels.statics.closure import LENGTH, STIFFNESS, actuator_of
from pcm_gym.kernels.statics.formulas import (
    Actuator,
    Pair,
    force_unit,
    hinge_move,
    input_rate,
    moment,
    pull_of,
    step_from_tip,
)
from pcm_gym.kernels.statics.margin import FARTHEST, Yielding, cubic_share, fold_distance, placed_bend

# Where the eigenvalues stand among the six numbers of the diagonal matrix: xx, yy and zz.
_DIAGONAL = (0, 2, 5)


@kernel
def set_margins(legs: Array, block: Block, count: int, dof: int) -> None:
    """Fill the singularity margin of lanes that are evaluated and judged; leaves their verdict and error alone."""
    common = block.common[0]
    common.singularity_margin[:count] = FARTHEST
    common.foreseen[:count] = 0.0
    common.greatest[:count] = 0.0
    common.is_clear[:count] = 1.0
    for i in range(legs.shape[0]):
        set_curvature(block.legs[i], count)
    for mode in range(dof):
        common.pull[:, :count] = 0.0
        for i in range(legs.shape[0]):
            length = legs[i, LENGTH]
            differentiate(block.legs[i], common, count, mode, length, force_unit(length, legs[i, STIFFNESS]))
        _carry_along(common, count, mode)
        for i in range(legs.shape[0]):
            _add_slope(actuator_of(legs, i), block.legs[i], common, count, mode)
        _close_mode(common, count, mode)


@kernel
def set_curvature(leg: LegLanes, count: int) -> None:
    """Fill the second derivatives of the rod, and so replace the elliptic functions that they come from."""
    for lane in range(count):
        g_x, g_y = pair(leg.g, lane)
        functions = functions_of(leg, lane)
        curvature = rod_curvature(g_x, g_y, functions, lag_in_lanes(g_x, g_y, functions))
        set_vector(leg.curvature, 0, lane, curvature[0])
        set_vector(leg.curvature, 1, lane, curvature[1])
        set_vector(leg.curvature, 2, lane, curvature[2])
        set_vector(leg.curvature, 3, lane, curvature[3])


@formula
def _bend(leg: LegLanes, lane: int, step: Pair, length: float, unit_force: float) -> tuple[Pair, Pair]:
    """Return the second derivatives of tip and force, world frame, along a path that leaves g with this step."""
    field = leg.curvature
    curvature = (vector(field, 0, lane), vector(field, 1, lane), vector(field, 2, lane), vector(field, 3, lane))
    bends = bend(leg.g[0, lane], leg.g[1, lane], curvature, step[0], step[1])
    return placed_bend(bends, length, unit_force, pair(leg.direction, lane))


@kernel
def differentiate(leg: LegLanes, common: CommonLanes, count: int, mode: int, length: float, unit_force: float) -> None:
    """Fill the derivatives of v' K v that come from one leg, and add that by the pose."""
    for lane in range(count):
        axis, arm, own = vector(common.axes, mode, lane), pair(leg.arm, lane), triple(leg.stiffness, lane)
        tip = hinge_move(axis, arm)
        bends = _bend(leg, lane, step_from_tip(derivatives(leg.tip_g, lane), tip), length, unit_force)
        share = cubic_share(Yielding(axis[2], tip, pull_of(own, tip), bends), arm, pair(leg.force, lane))
        condensed = pull_of(own, share.by_pull)
        by_tip = (share.by_tip[0] + condensed[0], share.by_tip[1] + condensed[1])
        set_pair(leg.by_tip, lane, by_tip)
        leg.by_clamp[lane] = share.by_clamp
        by_arm = (by_tip[0] + share.by_arm[0], by_tip[1] + share.by_arm[1])
        add_triple(common.pull, lane, (by_tip[0], by_tip[1], moment(arm, by_arm) + share.by_turn))


@kernel
def _carry_along(common: CommonLanes, count: int, mode: int) -> None:
    """Fill the move with the inverse of K times the derivative by the pose, times the eigenvalue: finite at its fold.

    It is put together from the eigenvectors, because beside a pole, where one eigenvalue is large, the adjugate would
    lose the digits of the others.
    """
    for lane in range(count):
        pull = triple(common.pull, lane)
        own = common.eigenvalues[_DIAGONAL[mode], lane]
        move_x = move_y = turn = 0.0
        for n in range(3):
            x, y, phi = vector(common.axes, n, lane)
            ratio = own / common.eigenvalues[_DIAGONAL[n], lane]
            ratio = 1.0 if n == mode else ratio
            part = ratio * (x * pull[0] + y * pull[1] + phi * pull[2])
            move_x += x * part
            move_y += y * part
            turn += phi * part
        set_triple(common.move, lane, (move_x, move_y, turn))
        common.squared_slope[lane] = 0.0
        common.along[lane] = 0.0


@kernel
def _add_slope(actuator: Actuator, leg: LegLanes, common: CommonLanes, count: int, mode: int) -> None:
    """Add the squared derivative by the input of one leg along the sheet, times the squared eigenvalue."""
    diagonal = _DIAGONAL[mode]
    for lane in range(count):
        hinge = hinge_move(triple(common.move, lane), pair(leg.arm, lane))
        rate, turned_force = input_rate(actuator, 1.0, pair(leg.tip, lane), pair(leg.force, lane))
        pull, by_tip = pull_of(triple(leg.stiffness, lane), rate), pair(leg.by_tip, lane)
        direct = actuator.turn * leg.by_clamp[lane] - by_tip[0] * rate[0] - by_tip[1] * rate[1]
        slope = hinge[0] * (pull[0] - turned_force[0]) + hinge[1] * (pull[1] - turned_force[1])
        slope += common.eigenvalues[diagonal, lane] * direct
        common.squared_slope[lane] += slope * slope
        common.along[lane] += slope * (leg.target[lane] - leg.input[lane])


@kernel
def _close_mode(common: CommonLanes, count: int, mode: int) -> None:
    """Reduce the margin to that of one eigenvalue, and see whether it vanished within the step."""
    diagonal = _DIAGONAL[mode]
    for lane in range(count):
        own, along = common.eigenvalues[diagonal, lane], common.along[lane]
        is_clear = (common.is_clear[lane] > 0.0) & is_far_from_zero(own, along)
        common.is_clear[lane] = 1.0 if is_clear else 0.0
        compliance = compliance_before(own, along)
        common.foreseen[lane] += compliance
        common.greatest[lane] += abs(compliance)
        distance = fold_distance(own, 1.0, math.sqrt(common.squared_slope[lane]))
        common.singularity_margin[lane] = min(common.singularity_margin[lane], distance)
