"""The singularity margin of many rows in lock-step: that of `margin`, with vector instructions.

The rods are condensed here. The gradient of v' K v at fixed v, by the pose and by the inputs, is carried along the
sheet by one more solution for each eigenvector v, whatever the number of inputs.
"""

import math

from pcm_gym.arrays import Array
from pcm_gym.kernels.lockstep.lanes import (
    ARM_X,
    ARM_Y,
    CLAMP_C,
    CLAMP_S,
    FORCE_G,
    FORCE_X,
    FORCE_Y,
    FUNCTIONS,
    G_X,
    G_Y,
    LANES,
    MOVE_PHI,
    MOVE_X,
    MOVE_Y,
    PULL_M,
    PULL_X,
    PULL_Y,
    RIGHT_X,
    RIGHT_Y,
    ROTATED,
    SINGULARITY_MARGIN,
    SQUARED_SLOPE,
    STEP_X,
    TIP_G,
    TIP_X,
    TIP_Y,
    Block,
    axis_of,
    derivatives_of,
    leg_stiffness,
)
from pcm_gym.kernels.numerics.compilation import formula, kernel
from pcm_gym.kernels.rods.rod import Form, bend, rod_curvature
from pcm_gym.kernels.statics.closure import (
    AXIS_X,
    AXIS_Y,
    LENGTH,
    STIFFNESS,
    TURN,
    step_from_tip,
    turned,
)
from pcm_gym.kernels.statics.margin import FARTHEST, STIFF

# Where the eigenvalues stand among the six numbers of the diagonal matrix: xx, yy and zz.
_DIAGONAL = (0, 2, 5)
# Keeps the ratio of two vanishing numbers finite.
_LEAST_SLOPE = 1e-300
# The runs of steps are free here: derivatives of v' K v by tip of the rod and by the turn of its clamp.
_BY_TIP_X, _BY_TIP_Y, _BY_TURN = RIGHT_X, RIGHT_Y, STEP_X
# So are twelve in a row, from the derivatives of the force to the elliptic functions, once these are used: second
# derivatives of the rod, three runs each.
_TIP_X_BENDS, _TIP_Y_BENDS, _FORCE_X_BENDS, _FORCE_Y_BENDS = range(FORCE_G, FORCE_G + 12 * LANES, 3 * LANES)


@kernel
def set_margins(legs: Array, block: Block, count: int, dof: int) -> None:
    """Fill the singularity margin of lanes that are evaluated and judged; leaves their verdict and error alone."""
    common = block.common
    common[SINGULARITY_MARGIN : SINGULARITY_MARGIN + count] = FARTHEST
    for i in range(legs.shape[0]):
        _set_curvature(block.legs[i], count)
    for mode in range(dof):
        common[PULL_X : PULL_X + count] = 0.0
        common[PULL_Y : PULL_Y + count] = 0.0
        common[PULL_M : PULL_M + count] = 0.0
        for i in range(legs.shape[0]):
            length = legs[i, LENGTH]
            _differentiate(block.legs[i], common, count, mode, length, legs[i, STIFFNESS] / (length * length))
        _carry_along(common, count, mode)
        for i in range(legs.shape[0]):
            _add_slope(block.legs[i], common, count, mode, legs[i, AXIS_X], legs[i, AXIS_Y], legs[i, TURN])
        _close_mode(common, count, mode)


@kernel
def _set_curvature(leg: Array, count: int) -> None:
    """Fill the second derivatives of the rod, and so replace the elliptic functions that they come from."""
    for lane in range(count):
        functions = (
            leg[FUNCTIONS + lane],
            leg[FUNCTIONS + LANES + lane],
            leg[FUNCTIONS + 2 * LANES + lane],
            leg[FUNCTIONS + 3 * LANES + lane],
            leg[FUNCTIONS + 4 * LANES + lane],
        )
        tip_x, tip_y, force_x, force_y = rod_curvature(leg[G_X + lane], leg[G_Y + lane], functions)
        leg[_TIP_X_BENDS + lane] = tip_x[0]
        leg[_TIP_X_BENDS + LANES + lane] = tip_x[1]
        leg[_TIP_X_BENDS + 2 * LANES + lane] = tip_x[2]
        leg[_TIP_Y_BENDS + lane] = tip_y[0]
        leg[_TIP_Y_BENDS + LANES + lane] = tip_y[1]
        leg[_TIP_Y_BENDS + 2 * LANES + lane] = tip_y[2]
        leg[_FORCE_X_BENDS + lane] = force_x[0]
        leg[_FORCE_X_BENDS + LANES + lane] = force_x[1]
        leg[_FORCE_X_BENDS + 2 * LANES + lane] = force_x[2]
        leg[_FORCE_Y_BENDS + lane] = force_y[0]
        leg[_FORCE_Y_BENDS + LANES + lane] = force_y[1]
        leg[_FORCE_Y_BENDS + 2 * LANES + lane] = force_y[2]


@formula
def _form(leg: Array, run: int, lane: int) -> Form:
    return leg[run + lane], leg[run + LANES + lane], leg[run + 2 * LANES + lane]


@kernel
def _differentiate(leg: Array, common: Array, count: int, mode: int, length: float, unit_force: float) -> None:
    """Fill the derivatives of v' K v that come from one leg, and add that by the pose."""
    for lane in range(count):
        move_x, move_y, turn = axis_of(common, mode, lane)
        arm_x, arm_y = leg[ARM_X + lane], leg[ARM_Y + lane]
        force_x, force_y = leg[FORCE_X + lane], leg[FORCE_Y + lane]
        a_xx, a_xy, a_yy = leg_stiffness(leg, lane)
        tip_x, tip_y = move_x - turn * arm_y, move_y + turn * arm_x
        pull_x, pull_y = a_xx * tip_x + a_xy * tip_y, a_xy * tip_x + a_yy * tip_y
        step_x, step_y = step_from_tip(derivatives_of(leg, TIP_G, lane), tip_x, tip_y)
        curvature = (
            _form(leg, _TIP_X_BENDS, lane),
            _form(leg, _TIP_Y_BENDS, lane),
            _form(leg, _FORCE_X_BENDS, lane),
            _form(leg, _FORCE_Y_BENDS, lane),
        )
        bends = bend(leg[G_X + lane], leg[G_Y + lane], curvature, step_x, step_y)
        cosine, sine = leg[CLAMP_C + lane], leg[CLAMP_S + lane]
        bend_x, bend_y = turned(length * cosine, length * sine, bends[0], bends[1])
        by_tip_x, by_tip_y = turned(unit_force * cosine, unit_force * sine, bends[2], bends[3])
        # with the end-effector the arm turns, and the tip leaves its straight line
        bend_x, bend_y = bend_x + turn * turn * arm_x, bend_y + turn * turn * arm_y
        by_tip_x -= a_xx * bend_x + a_xy * bend_y
        by_tip_y -= a_xy * bend_x + a_yy * bend_y
        moment = turn * turn * (arm_x * force_y - arm_y * force_x)
        leg[_BY_TIP_X + lane] = by_tip_x
        leg[_BY_TIP_Y + lane] = by_tip_y
        leg[_BY_TURN + lane] = moment - 2.0 * (pull_y * tip_x - pull_x * tip_y)
        common[PULL_X + lane] += by_tip_x
        common[PULL_Y + lane] += by_tip_y
        by_arm = arm_x * (by_tip_y - 2.0 * turn * pull_x) - arm_y * (by_tip_x + 2.0 * turn * pull_y)
        common[PULL_M + lane] += by_arm - moment


@kernel
def _carry_along(common: Array, count: int, mode: int) -> None:
    """Fill the move with the inverse of K times the derivative by the pose, times the eigenvalue: finite at its fold.

    It is put together from the eigenvectors, because beside a pole, where one eigenvalue is large, the adjugate would
    lose the digits of the others.
    """
    for lane in range(count):
        pull_x, pull_y, pull_m = common[PULL_X + lane], common[PULL_Y + lane], common[PULL_M + lane]
        own = common[ROTATED + _DIAGONAL[mode] * LANES + lane]
        move_x = move_y = turn = 0.0
        for n in range(3):
            x, y, phi = axis_of(common, n, lane)
            ratio = own / common[ROTATED + _DIAGONAL[n] * LANES + lane]
            ratio = 1.0 if n == mode else ratio
            part = ratio * (x * pull_x + y * pull_y + phi * pull_m)
            move_x += x * part
            move_y += y * part
            turn += phi * part
        common[MOVE_X + lane] = move_x
        common[MOVE_Y + lane] = move_y
        common[MOVE_PHI + lane] = turn
        common[SQUARED_SLOPE + lane] = 0.0


@kernel
def _add_slope(leg: Array, common: Array, count: int, mode: int, axis_x: float, axis_y: float, turn: float) -> None:
    """Add the squared derivative by the input of one leg along the sheet, times the squared eigenvalue."""
    own = ROTATED + _DIAGONAL[mode] * LANES
    for lane in range(count):
        arm_x, arm_y = leg[ARM_X + lane], leg[ARM_Y + lane]
        hinge_x = common[MOVE_X + lane] - arm_y * common[MOVE_PHI + lane]
        hinge_y = common[MOVE_Y + lane] + arm_x * common[MOVE_PHI + lane]
        rate_x, rate_y = axis_x - turn * leg[TIP_Y + lane], axis_y + turn * leg[TIP_X + lane]
        a_xx, a_xy, a_yy = leg_stiffness(leg, lane)
        pull_x = a_xx * rate_x + a_xy * rate_y + turn * leg[FORCE_Y + lane]
        pull_y = a_xy * rate_x + a_yy * rate_y - turn * leg[FORCE_X + lane]
        direct = turn * leg[_BY_TURN + lane] - leg[_BY_TIP_X + lane] * rate_x - leg[_BY_TIP_Y + lane] * rate_y
        slope = hinge_x * pull_x + hinge_y * pull_y + common[own + lane] * direct
        common[SQUARED_SLOPE + lane] += slope * slope


@kernel
def _close_mode(common: Array, count: int, mode: int) -> None:
    """Reduce the margin to that of one eigenvalue."""
    run = ROTATED + _DIAGONAL[mode] * LANES
    for lane in range(count):
        stiffness = common[run + lane]
        ratio = stiffness / STIFF
        distance = 0.5 * stiffness * stiffness * (1.0 + ratio * ratio)
        slope = max(math.sqrt(common[SQUARED_SLOPE + lane]), distance / FARTHEST, _LEAST_SLOPE)
        common[SINGULARITY_MARGIN + lane] = min(common[SINGULARITY_MARGIN + lane], distance / slope)
