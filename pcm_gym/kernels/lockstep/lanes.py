"""Natural steps of many rows in lock-step: the Newton iteration of `continuation`, with vector instructions.

Up to `LANES` rows make a block. Every quantity is a run of `LANES` numbers, one per lane, so that each loop over the
lanes, free of branches, becomes a loop over vectors. A lane that is refused changes nothing: its row is then tracked
alone. A lane that has converged is not touched again, so what becomes of a row does not depend on its neighbours.
"""

import math
from typing import NamedTuple

import numpy as np

from pcm_gym.arrays import Array
from pcm_gym.kernels.branches.continuation import STEP_RULES
from pcm_gym.kernels.numerics.compilation import formula, kernel
from pcm_gym.kernels.numerics.linear import (
    JACOBI_SWEEPS,
    Axes,
    Symmetric,
    Vector,
    adjugate_times,
    eigenvalues_2,
    is_diagonal,
    jacobi_sweep,
    solve_symmetric,
)
from pcm_gym.kernels.rods.elliptic import LARGEST_ANGLE, sine_and_cosine
from pcm_gym.kernels.rods.rod import rod_in_lanes
from pcm_gym.kernels.statics.closure import (
    ATTACH_X,
    ATTACH_Y,
    AXIS_X,
    AXIS_Y,
    BASE_X,
    BASE_Y,
    CLAMP_ANGLE,
    LENGTH,
    STIFFNESS,
    TURN,
    Derivatives,
    condensed_pull,
    placed,
    pole_distance_from,
    step_from_tip,
    stiffness_from,
    stiffness_share,
    turned,
)
from pcm_gym.kernels.statics.newton import CONVERGED, accept_correction, rod_correction
from pcm_gym.kernels.statics.stability import judge_eigenvalues, negative_directions

# Rows of a block. Its numbers stay in the fastest cache.
LANES = 64
# Lanes that one vector instruction serves where vectors are longest. A block is filled up to a multiple of it with
# copies of its last lane, unless a single lane is left over: the lanes behind the last vector are computed one by one.
_VECTOR = 8
# Nearer than this to a pole of a rod's stiffness a lane is left to the scalar code. The condensed system multiplies
# rounding errors there, so a lane is also left if the errors of its equilibrium are larger than this in the end.
_POLE_LIMIT = 1e-11
_RESIDUAL_LIMIT = 1e-12
# Newton iterations before a lane is left to the scalar code, which may take more.
_MOST_ITERATIONS = 5

# Runs of a leg: load at the tip, input and the one to move to, direction of the clamp, what `rod` gives in the world
# frame, place of the clamp, elliptic functions, stiffness, arm, right-hand side of closure, and step.
(
    G_X,
    G_Y,
    INPUT,
    TARGET,
    CLAMP_C,
    CLAMP_S,
    TIP_X,
    TIP_Y,
    FORCE_X,
    FORCE_Y,
    TIP_G,
    _,
    _,
    _,
    HALF_PERIODS,
    FORCE_G,
    _,
    _,
    _,
    DEAD_LOAD_INDEX,
    CLAMP_X,
    CLAMP_Y,
    FUNCTIONS,
    _,
    _,
    _,
    _,
    STIFF_XX,
    STIFF_XY,
    STIFF_YY,
    ARM_X,
    ARM_Y,
    RIGHT_X,
    RIGHT_Y,
    STEP_X,
    STEP_Y,
) = range(0, 36 * LANES, LANES)
_LEG_RUNS = 36

# Runs that a lane has once: pose, cosine and sine of its angle, load, right-hand side of equilibrium, the force that
# moves the condensed end-effector and its move, stiffness, its diagonal form and the axes of that, last two sizes of a
# correction, errors, verdict, the slope behind its last part, and whether the lane is sound and still moving.
(
    X,
    Y,
    PHI,
    TURN_C,
    TURN_S,
    LOAD_X,
    LOAD_Y,
    LOAD_M,
    RIGHT_FX,
    RIGHT_FY,
    RIGHT_M,
    PULL_X,
    PULL_Y,
    PULL_M,
    MOVE_X,
    MOVE_Y,
    MOVE_PHI,
    XX,
    XY,
    YY,
    XZ,
    YZ,
    ZZ,
    ROTATED,
    _,
    _,
    _,
    _,
    _,
    AXES,
    _,
    _,
    _,
    _,
    _,
    _,
    _,
    _,
    SIZE,
    PREVIOUS,
    CLOSURE_ERROR,
    LARGEST_FORCE,
    INDEX,
    INDEX_BEFORE,
    STABILITY_MARGIN,
    SINGULARITY_MARGIN,
    SQUARED_SLOPE,
    IS_SOUND,
    IS_MOVING,
) = range(0, 49 * LANES, LANES)
_COMMON_RUNS = 49


class Block(NamedTuple):
    """The numbers of a block of rows: run by run, and in each run lane by lane."""

    legs: Array  # (legs, 36 * LANES)
    common: Array  # (49 * LANES,)


@kernel
def make_block(leg_count: int) -> Block:
    """Return the arrays of a block."""
    return Block(np.empty((leg_count, _LEG_RUNS * LANES)), np.empty(_COMMON_RUNS * LANES))


@kernel
def step_block(legs: Array, block: Block, count: int, dof: int) -> int:
    """Move the first `count` lanes from their equilibria to their new inputs; return how many are computed.

    Set are the loads at the tips, inputs, new inputs, pose and load. Afterwards the lanes in which `IS_SOUND` is 1 are
    at the equilibrium that a natural step of `track` over the whole way accepts; the others are to be tracked alone.
    """
    computed = _fill_up(block, count)
    _step_lanes(legs, block, computed, dof)
    return computed


@kernel
def rest_block(legs: Array, block: Block, count: int, dof: int) -> int:
    """Evaluate and judge the first `count` lanes where they are; return how many are computed.

    Set are the loads at the tips, inputs, as inputs to move to the same ones, pose and load. Afterwards the lanes in
    which `IS_SOUND` is 1 are told as after a step that ends there; the others are left to the scalar code.
    """
    computed = _fill_up(block, count)
    block.common[IS_SOUND : IS_SOUND + computed] = 1.0
    _place_clamps(legs, block, computed, 1.0)
    _finish(legs, block, computed, dof)
    return computed


@kernel
def _fill_up(block: Block, count: int) -> int:
    """Copy the last lane behind itself where that saves time; return the number of lanes to be computed."""
    common, left_over = block.common, count % _VECTOR
    if left_over < 2:
        return count
    filled = count - left_over + _VECTOR
    for lane in range(count, filled):
        for i in range(block.legs.shape[0]):
            leg = block.legs[i]
            leg[G_X + lane], leg[G_Y + lane] = leg[G_X + count - 1], leg[G_Y + count - 1]
            leg[INPUT + lane], leg[TARGET + lane] = leg[INPUT + count - 1], leg[TARGET + count - 1]
        for d in range(0, 3 * LANES, LANES):
            common[X + d + lane], common[LOAD_X + d + lane] = common[X + d + count - 1], common[LOAD_X + d + count - 1]
    return filled


@kernel
def _step_lanes(legs: Array, block: Block, count: int, dof: int) -> None:
    common = block.common
    common[IS_SOUND : IS_SOUND + count] = 1.0
    _place_clamps(legs, block, count, 0.0)
    _evaluate(legs, block, count, dof)
    _set_index(block, count)
    common[INDEX_BEFORE : INDEX_BEFORE + count] = common[INDEX : INDEX + count]
    _set_rates(legs, block, count)
    _solve(block, count)
    common[IS_MOVING : IS_MOVING + count] = 1.0
    _add_step(block, count)
    _place_clamps(legs, block, count, 1.0)
    common[PREVIOUS : PREVIOUS + count] = math.inf
    for iteration in range(_MOST_ITERATIONS):
        _evaluate(legs, block, count, dof)
        _set_residual(block, count)
        _solve(block, count)
        _add_step(block, count)
        if _close_iteration(common, count, iteration == 0) == 0:
            break
    _finish(legs, block, count, dof)
    for lane in range(count):
        is_sound = (common[INDEX + lane] == common[INDEX_BEFORE + lane]) & (common[IS_MOVING + lane] == 0.0)
        common[IS_SOUND + lane] = common[IS_SOUND + lane] if is_sound else 0.0


@kernel
def _finish(legs: Array, block: Block, count: int, dof: int) -> None:
    """Evaluate and judge the lanes at the state that they have come to; refuse those that are no equilibria."""
    common = block.common
    _evaluate(legs, block, count, dof)
    _set_residual(block, count)
    judge_block(block, count, dof)
    for lane in range(count):
        is_sound = residual(common, lane) < _RESIDUAL_LIMIT
        common[IS_SOUND + lane] = common[IS_SOUND + lane] if is_sound else 0.0


@formula
def residual(common: Array, lane: int) -> float:
    """Return the largest error of a lane, as `judge` of `continuation` does."""
    force = max(abs(common[RIGHT_FX + lane]), abs(common[RIGHT_FY + lane]), abs(common[RIGHT_M + lane]))
    error: float = max(common[CLOSURE_ERROR + lane], force / (1.0 + common[LARGEST_FORCE + lane]))
    return error


@kernel
def _place_clamps(legs: Array, block: Block, count: int, fraction: float) -> None:
    """Set the clamps to the inputs at a fraction, 0 or 1, of the step."""
    sound = block.common[IS_SOUND : IS_SOUND + LANES]
    for i in range(legs.shape[0]):
        leg = block.legs[i]
        base_x, base_y, axis_x, axis_y = legs[i, BASE_X], legs[i, BASE_Y], legs[i, AXIS_X], legs[i, AXIS_Y]
        clamp_angle, turn = legs[i, CLAMP_ANGLE], legs[i, TURN]
        for lane in range(count):
            value = leg[INPUT + lane] + fraction * (leg[TARGET + lane] - leg[INPUT + lane])
            angle = clamp_angle + turn * value
            cosine, sine = _cosine_and_sine(angle)
            leg[CLAMP_X + lane] = base_x + axis_x * value
            leg[CLAMP_Y + lane] = base_y + axis_y * value
            leg[CLAMP_C + lane] = cosine
            leg[CLAMP_S + lane] = sine
            sound[lane] = sound[lane] if abs(angle) <= LARGEST_ANGLE else 0.0


@formula
def _cosine_and_sine(angle: float) -> tuple[float, float]:
    sine, cosine = sine_and_cosine(angle)
    return cosine, sine


@kernel
def _evaluate(legs: Array, block: Block, count: int, dof: int) -> None:
    """Fill all that follows from loads at the tips, clamps and pose: rods and stiffness."""
    common = block.common
    own_turn = 0.0 if dof == 3 else 1.0  # as in `stiffness`
    for lane in range(count):
        cosine, sine = _cosine_and_sine(common[PHI + lane])
        common[TURN_C + lane] = cosine
        common[TURN_S + lane] = sine
        is_sound = abs(common[PHI + lane]) <= LARGEST_ANGLE
        common[IS_SOUND + lane] = common[IS_SOUND + lane] if is_sound else 0.0
        common[XX + lane] = 0.0
        common[XY + lane] = 0.0
        common[YY + lane] = 0.0
        common[XZ + lane] = 0.0
        common[YZ + lane] = 0.0
        common[ZZ + lane] = own_turn
    for i in range(legs.shape[0]):
        length = legs[i, LENGTH]
        unit_force = legs[i, STIFFNESS] / (length * length)
        _evaluate_leg(block.legs[i], common, count, length, unit_force)
        _add_stiffness(block.legs[i], common, count, legs[i, ATTACH_X], legs[i, ATTACH_Y])


@kernel
def _evaluate_leg(leg: Array, common: Array, count: int, length: float, unit_force: float) -> None:
    for lane in range(count):
        unit, functions, holds = rod_in_lanes(leg[G_X + lane], leg[G_Y + lane])
        point = placed(unit, length, unit_force, leg[CLAMP_C + lane], leg[CLAMP_S + lane])
        tip_g = (point.tip_x_gx, point.tip_x_gy, point.tip_y_gx, point.tip_y_gy)
        force_g = (point.force_x_gx, point.force_x_gy, point.force_y_gx, point.force_y_gy)
        leg[TIP_X + lane] = point.tip_x
        leg[TIP_Y + lane] = point.tip_y
        leg[FORCE_X + lane] = point.force_x
        leg[FORCE_Y + lane] = point.force_y
        leg[TIP_G + lane] = tip_g[0]
        leg[TIP_G + LANES + lane] = tip_g[1]
        leg[TIP_G + 2 * LANES + lane] = tip_g[2]
        leg[TIP_G + 3 * LANES + lane] = tip_g[3]
        leg[FORCE_G + lane] = force_g[0]
        leg[FORCE_G + LANES + lane] = force_g[1]
        leg[FORCE_G + 2 * LANES + lane] = force_g[2]
        leg[FORCE_G + 3 * LANES + lane] = force_g[3]
        leg[DEAD_LOAD_INDEX + lane] = point.dead_load_index
        leg[HALF_PERIODS + lane] = point.half_periods
        leg[FUNCTIONS + lane] = functions[0]
        leg[FUNCTIONS + LANES + lane] = functions[1]
        leg[FUNCTIONS + 2 * LANES + lane] = functions[2]
        leg[FUNCTIONS + 3 * LANES + lane] = functions[3]
        leg[FUNCTIONS + 4 * LANES + lane] = functions[4]
        own = stiffness_from(tip_g, force_g)
        leg[STIFF_XX + lane] = own[0]
        leg[STIFF_XY + lane] = own[1]
        leg[STIFF_YY + lane] = own[2]
        is_sound = holds & (pole_distance_from(tip_g) > _POLE_LIMIT)
        common[IS_SOUND + lane] = common[IS_SOUND + lane] if is_sound else 0.0


@formula
def derivatives_of(leg: Array, run: int, lane: int) -> Derivatives:
    """Return the derivatives by g that stand in four runs of a leg."""
    return leg[run + lane], leg[run + LANES + lane], leg[run + 2 * LANES + lane], leg[run + 3 * LANES + lane]


@formula
def leg_stiffness(leg: Array, lane: int) -> tuple[float, float, float]:
    """Return xx, xy and yy of the stiffness of a leg."""
    return leg[STIFF_XX + lane], leg[STIFF_XY + lane], leg[STIFF_YY + lane]


@formula
def symmetric(common: Array, run: int, lane: int) -> Symmetric:
    """Return the matrix that stands in six runs."""
    return Symmetric(
        common[run + lane],
        common[run + LANES + lane],
        common[run + 2 * LANES + lane],
        common[run + 3 * LANES + lane],
        common[run + 4 * LANES + lane],
        common[run + 5 * LANES + lane],
    )


@kernel
def _add_stiffness(leg: Array, common: Array, count: int, attach_x: float, attach_y: float) -> None:
    for lane in range(count):
        arm_x, arm_y = turned(common[TURN_C + lane], common[TURN_S + lane], attach_x, attach_y)
        leg[ARM_X + lane] = arm_x
        leg[ARM_Y + lane] = arm_y
        share = stiffness_share(leg_stiffness(leg, lane), arm_x, arm_y, leg[FORCE_X + lane], leg[FORCE_Y + lane])
        common[XX + lane] += share.xx
        common[XY + lane] += share.xy
        common[YY + lane] += share.yy
        common[XZ + lane] += share.xz
        common[YZ + lane] += share.yz
        common[ZZ + lane] += share.zz


@kernel
def _set_rates(legs: Array, block: Block, count: int) -> None:
    """Fill the right-hand side with the derivative of the residual along the step."""
    common = block.common
    common[RIGHT_FX : RIGHT_FX + count] = 0.0
    common[RIGHT_FY : RIGHT_FY + count] = 0.0
    common[RIGHT_M : RIGHT_M + count] = 0.0
    for i in range(legs.shape[0]):
        leg, axis_x, axis_y, turn = block.legs[i], legs[i, AXIS_X], legs[i, AXIS_Y], legs[i, TURN]
        for lane in range(count):
            rate = leg[TARGET + lane] - leg[INPUT + lane]
            pull_x, pull_y = -rate * turn * leg[FORCE_Y + lane], rate * turn * leg[FORCE_X + lane]
            leg[RIGHT_X + lane] = rate * (axis_x - turn * leg[TIP_Y + lane])
            leg[RIGHT_Y + lane] = rate * (axis_y + turn * leg[TIP_X + lane])
            common[RIGHT_FX + lane] += pull_x
            common[RIGHT_FY + lane] += pull_y
            common[RIGHT_M + lane] += leg[ARM_X + lane] * pull_y - leg[ARM_Y + lane] * pull_x


@kernel
def _set_residual(block: Block, count: int) -> None:
    """Fill the right-hand side with the residual, and with what `residual` needs."""
    common = block.common
    for lane in range(count):
        common[RIGHT_FX + lane] = -common[LOAD_X + lane]
        common[RIGHT_FY + lane] = -common[LOAD_Y + lane]
        common[RIGHT_M + lane] = -common[LOAD_M + lane]
        common[CLOSURE_ERROR + lane] = 0.0
        common[LARGEST_FORCE + lane] = 0.0
    for i in range(block.legs.shape[0]):
        leg = block.legs[i]
        for lane in range(count):
            arm_x, arm_y = leg[ARM_X + lane], leg[ARM_Y + lane]
            force_x, force_y = leg[FORCE_X + lane], leg[FORCE_Y + lane]
            right_x = leg[CLAMP_X + lane] + leg[TIP_X + lane] - common[X + lane] - arm_x
            right_y = leg[CLAMP_Y + lane] + leg[TIP_Y + lane] - common[Y + lane] - arm_y
            leg[RIGHT_X + lane] = right_x
            leg[RIGHT_Y + lane] = right_y
            common[RIGHT_FX + lane] += force_x
            common[RIGHT_FY + lane] += force_y
            common[RIGHT_M + lane] += arm_x * force_y - arm_y * force_x
            common[CLOSURE_ERROR + lane] = max(common[CLOSURE_ERROR + lane], abs(right_x), abs(right_y))
            common[LARGEST_FORCE + lane] = max(common[LARGEST_FORCE + lane], abs(force_x), abs(force_y))
            is_sound = abs(right_x) + abs(right_y) + abs(force_x) + abs(force_y) < math.inf
            common[IS_SOUND + lane] = common[IS_SOUND + lane] if is_sound else 0.0


@kernel
def _solve(block: Block, count: int) -> None:
    """Solve the condensed system for the step, J step = -right-hand side."""
    common = block.common
    for lane in range(count):
        common[PULL_X + lane] = -common[RIGHT_FX + lane]
        common[PULL_Y + lane] = -common[RIGHT_FY + lane]
        common[PULL_M + lane] = -common[RIGHT_M + lane]
    for i in range(block.legs.shape[0]):
        leg = block.legs[i]
        for lane in range(count):
            own, arm_x, arm_y = leg_stiffness(leg, lane), leg[ARM_X + lane], leg[ARM_Y + lane]
            pull = condensed_pull(own, arm_x, arm_y, leg[RIGHT_X + lane], leg[RIGHT_Y + lane])
            common[PULL_X + lane] += pull[0]
            common[PULL_Y + lane] += pull[1]
            common[PULL_M + lane] += pull[2]
    for lane in range(count):
        pull_x, pull_y, pull_m = common[PULL_X + lane], common[PULL_Y + lane], common[PULL_M + lane]
        move = solve_symmetric(symmetric(common, XX, lane), pull_x, pull_y, pull_m)
        common[MOVE_X + lane] = move[0]
        common[MOVE_Y + lane] = move[1]
        common[MOVE_PHI + lane] = move[2]
        common[SIZE + lane] = max(abs(move[0]), abs(move[1]), abs(move[2]))
    for i in range(block.legs.shape[0]):
        leg = block.legs[i]
        for lane in range(count):
            turn = common[MOVE_PHI + lane]
            tip_x = common[MOVE_X + lane] - leg[ARM_Y + lane] * turn - leg[RIGHT_X + lane]
            tip_y = common[MOVE_Y + lane] + leg[ARM_X + lane] * turn - leg[RIGHT_Y + lane]
            tip_g, force_g = derivatives_of(leg, TIP_G, lane), derivatives_of(leg, FORCE_G, lane)
            step_x, step_y = step_from_tip(tip_g, tip_x, tip_y)
            force = 1.0 + abs(leg[FORCE_X + lane]) + abs(leg[FORCE_Y + lane])
            leg[STEP_X + lane] = step_x
            leg[STEP_Y + lane] = step_y
            common[SIZE + lane] = max(common[SIZE + lane], rod_correction(tip_g, force_g, force, step_x, step_y))
            is_sound = abs(step_x) + abs(step_y) + abs(turn) < math.inf  # max() drops a nan
            common[IS_SOUND + lane] = common[IS_SOUND + lane] if is_sound else 0.0


@kernel
def _add_step(block: Block, count: int) -> None:
    """Add the step where the lane still moves."""
    common = block.common
    for i in range(block.legs.shape[0]):
        leg = block.legs[i]
        for lane in range(count):
            is_moving = common[IS_MOVING + lane] > 0.0
            leg[G_X + lane] += leg[STEP_X + lane] if is_moving else 0.0
            leg[G_Y + lane] += leg[STEP_Y + lane] if is_moving else 0.0
    for lane in range(count):
        is_moving = common[IS_MOVING + lane] > 0.0
        common[X + lane] += common[MOVE_X + lane] if is_moving else 0.0
        common[Y + lane] += common[MOVE_Y + lane] if is_moving else 0.0
        common[PHI + lane] += common[MOVE_PHI + lane] if is_moving else 0.0


@kernel
def _close_iteration(common: Array, count: int, is_first: bool) -> int:
    """Refuse or stop the lanes that `solve_forward_locally` would; return how many still move."""
    moving = 0
    for lane in range(count):
        size, previous, was_moving = common[SIZE + lane], common[PREVIOUS + lane], common[IS_MOVING + lane] > 0.0
        verdict = accept_correction(size, previous, is_first, STEP_RULES)
        is_sound = (common[IS_SOUND + lane] > 0.0) & ((verdict <= CONVERGED) | (not was_moving))
        is_moving = was_moving & is_sound & (verdict != CONVERGED)
        common[IS_SOUND + lane] = 1.0 if is_sound else 0.0
        common[IS_MOVING + lane] = 1.0 if is_moving else 0.0
        common[PREVIOUS + lane] = size
        moving += 1 if is_moving else 0
    return moving


@kernel
def _set_index(block: Block, count: int) -> None:
    """Fill the Morse index from rods and stiffness, by the signs of the coefficients of the characteristic polynomial.

    All its roots are real: as many are negative as these signs change (Descartes).
    """
    common = block.common
    for lane in range(count):
        a = symmetric(common, XX, lane)
        trace = a.xx + a.yy + a.zz
        minors = a.xx * a.yy - a.xy * a.xy + a.xx * a.zz - a.xz * a.xz + a.yy * a.zz - a.yz * a.yz
        _, determinant = adjugate_times(a, 0.0, 0.0, 0.0)
        first, second, third = trace < 0.0, minors < 0.0, determinant < 0.0
        changes = 1.0 if first else 0.0
        changes += 1.0 if first != second else 0.0
        changes += 1.0 if second != third else 0.0
        common[INDEX + lane] = changes
    _add_rod_indices(block, count)


@kernel
def _add_rod_indices(block: Block, count: int) -> None:
    common = block.common
    for i in range(block.legs.shape[0]):
        leg = block.legs[i]
        for lane in range(count):
            common[INDEX + lane] += leg[DEAD_LOAD_INDEX + lane] - negative_directions(leg_stiffness(leg, lane))


@kernel
def judge_block(block: Block, count: int, dof: int) -> None:
    """Fill Morse index, stability margin, eigenvalues and axes of the stiffness from rods and stiffness."""
    common = block.common
    _diagonalise(common, count, dof)
    for lane in range(count):
        rotated = symmetric(common, ROTATED, lane)
        first, second, third = rotated.xx, rotated.yy, rotated.zz
        if dof == 2:
            first, second = eigenvalues_2(symmetric(common, XX, lane))
            third = math.inf
        negative, stability_margin = judge_eigenvalues(first, second, third)
        common[INDEX + lane] = negative
        common[STABILITY_MARGIN + lane] = stability_margin
    _add_rod_indices(block, count)


@kernel
def _diagonalise(common: Array, count: int, dof: int) -> None:
    """Fill `ROTATED` with K turned into a diagonal matrix, and `AXES` with its eigenvectors, one after the other.

    A matrix of two rows is diagonal after one turn.
    """
    common[ROTATED : ROTATED + 6 * LANES] = common[XX : XX + 6 * LANES]
    common[AXES : AXES + 9 * LANES] = 0.0
    for d in range(0, 3 * LANES, LANES):
        common[AXES + 4 * d : AXES + 4 * d + LANES] = 1.0
    for _ in range(JACOBI_SWEEPS if dof == 3 else 1):
        left = 0
        for lane in range(count):
            before, axes = symmetric(common, ROTATED, lane), axes_of(common, lane)
            is_done = is_diagonal(before)
            after, turned_axes = jacobi_sweep(before, axes)
            common[ROTATED + lane] = before.xx if is_done else after.xx
            common[ROTATED + LANES + lane] = before.xy if is_done else after.xy
            common[ROTATED + 2 * LANES + lane] = before.yy if is_done else after.yy
            common[ROTATED + 3 * LANES + lane] = before.xz if is_done else after.xz
            common[ROTATED + 4 * LANES + lane] = before.yz if is_done else after.yz
            common[ROTATED + 5 * LANES + lane] = before.zz if is_done else after.zz
            common[AXES + lane] = axes[0][0] if is_done else turned_axes[0][0]
            common[AXES + LANES + lane] = axes[0][1] if is_done else turned_axes[0][1]
            common[AXES + 2 * LANES + lane] = axes[0][2] if is_done else turned_axes[0][2]
            common[AXES + 3 * LANES + lane] = axes[1][0] if is_done else turned_axes[1][0]
            common[AXES + 4 * LANES + lane] = axes[1][1] if is_done else turned_axes[1][1]
            common[AXES + 5 * LANES + lane] = axes[1][2] if is_done else turned_axes[1][2]
            common[AXES + 6 * LANES + lane] = axes[2][0] if is_done else turned_axes[2][0]
            common[AXES + 7 * LANES + lane] = axes[2][1] if is_done else turned_axes[2][1]
            common[AXES + 8 * LANES + lane] = axes[2][2] if is_done else turned_axes[2][2]
            left += 0 if is_done else 1
        if left == 0:
            break


@formula
def axes_of(common: Array, lane: int) -> Axes:
    """Return the eigenvectors of the stiffness of a lane."""
    return axis_of(common, 0, lane), axis_of(common, 1, lane), axis_of(common, 2, lane)


@formula
def axis_of(common: Array, mode: int, lane: int) -> Vector:
    """Return one of them."""
    run = AXES + 3 * mode * LANES + lane
    return common[run], common[run + LANES], common[run + 2 * LANES]
