"""Natural steps of many rows in lock-step: the Newton iteration of `continuation`, with vector instructions.

Each loop over the lanes of a block, free of branches, becomes a loop over vectors: load, formula, store. A lane that is
refused changes nothing: its row is then tracked alone. A lane that has converged is not touched again, so what becomes
of a row does not depend on its neighbours.
"""

import math

from pcm_gym.arrays import Array
from pcm_gym.kernels.branches.smoothness import growth, is_as_foreseen, relative_defect
from pcm_gym.kernels.branches.steps import STEP_RULES
from pcm_gym.kernels.lockstep.lanes_margin import set_margins
from pcm_gym.kernels.lockstep.layout import (
    Block,
    CommonLanes,
    LegLanes,
    add_pair,
    add_triple,
    derivatives,
    keep_if,
    pair,
    set_derivatives,
    set_functions,
    set_pair,
    set_symmetric,
    set_triple,
    symmetric,
    triple,
)
from pcm_gym.kernels.lockstep.verdicts import judge_block, residual, set_index
from pcm_gym.kernels.numerics.compilation import formula, kernel, shared_kernel
from pcm_gym.kernels.numerics.linear import Symmetric, solve_symmetric, trace_of_inverse
from pcm_gym.kernels.rods.elliptic import LARGEST_ANGLE, sine_and_cosine
from pcm_gym.kernels.rods.rod import rod_in_lanes
from pcm_gym.kernels.statics.closure import ATTACH_X, LENGTH, STIFFNESS, actuator_of
from pcm_gym.kernels.statics.closure import pair as pair_of_row
from pcm_gym.kernels.statics.formulas import (
    Actuator,
    Pair,
    added,
    are_finite,
    clamp_angle,
    clamp_point,
    condensed_pull,
    force_unit,
    hinge_gap,
    hinge_move,
    input_rate,
    larger,
    moment,
    own_turn_stiffness,
    placed,
    pole_distance_from,
    rod_correction,
    step_from_tip,
    stiffness_from,
    stiffness_share,
    turned,
)
from pcm_gym.kernels.statics.newton import CONVERGED, accept_correction

# Lanes that one vector instruction serves where vectors are longest. A block is filled up to a multiple of it with
# copies of its last lane, unless a single lane is left over: the lanes behind the last vector are computed one by one.
_VECTOR = 8
# Nearer than this to a pole of a rod's stiffness a lane is left to the scalar code. The condensed system multiplies
# rounding errors there, so a lane is also left if the errors of its equilibrium are larger than this in the end.
_POLE_LIMIT = 1e-11
_RESIDUAL_LIMIT = 1e-12
# Least and largest part of a step that is refused, for its next trial: what lanes know of such a step is little.
_LEAST_LEFT, _MOST_LEFT = 0.25, 0.5
# Newton iterations before a lane is left to the scalar code, which may take more.
_MOST_ITERATIONS = 5


@kernel
def step_block(legs: Array, block: Block, count: int, dof: int) -> int:
    """Move the first `count` lanes from their equilibria to their new inputs; return how many are computed.

    Set are the loads at the tips, inputs, new inputs, pose and load. Afterwards the lanes in which `is_sound` is 1 are
    at the equilibrium that a natural step of `track` over the whole way accepts; the others are to be tracked alone.
    """
    return _work_out(legs, block, count, dof, True)


@kernel
def rest_block(legs: Array, block: Block, count: int, dof: int) -> int:
    """Evaluate and judge the first `count` lanes where they are; return how many are computed.

    Set are the loads at the tips, inputs, as inputs to move to the same ones, pose and load. Afterwards the lanes in
    which `is_sound` is 1 are told as after a step that ends there; the others are left to the scalar code.
    """
    return _work_out(legs, block, count, dof, False)


@shared_kernel
def _work_out(legs: Array, block: Block, count: int, dof: int, is_step: bool) -> int:
    """Do what `step_block` or `rest_block` does. All that goes in lock-step goes through here: compiled once."""
    computed = _fill_up(block, count)
    if is_step:
        _step_lanes(legs, block, computed, dof)
    else:
        _rest_lanes(legs, block, computed, dof)
    return computed


@kernel
def evaluate_block(legs: Array, block: Block, count: int, dof: int) -> int:
    """Evaluate the first `count` lanes where they are, as for `rest_block`, but judge nothing except whether it can."""
    computed = _fill_up(block, count)
    block.common[0].is_sound[:computed] = 1.0
    _place_clamps(legs, block, computed, 1.0)
    _evaluate(legs, block, computed, dof)
    return computed


@formula
def growth_of_lane(common: CommonLanes, lane: int) -> float:
    """Return how many times longer the next step of a lane is to be, from what became of this one."""
    factor = growth(relative_defect(common.defect[lane], common.length[lane]))
    return factor if common.is_sound[lane] > 0.0 else min(max(factor, _LEAST_LEFT), _MOST_LEFT)


@kernel
def _fill_up(block: Block, count: int) -> int:
    """Copy the last lane behind itself where that saves time; return the number of lanes to be computed."""
    common, left_over = block.common[0], count % _VECTOR
    if left_over < 2:
        return count
    filled, last = count - left_over + _VECTOR, count - 1
    for lane in range(count, filled):
        for i in range(block.legs.shape[0]):
            leg = block.legs[i]
            set_pair(leg.g, lane, pair(leg.g, last))
            leg.input[lane], leg.target[lane] = leg.input[last], leg.target[last]
        set_triple(common.pose, lane, triple(common.pose, last))
        set_triple(common.load, lane, triple(common.load, last))
    return filled


@kernel
def _rest_lanes(legs: Array, block: Block, count: int, dof: int) -> None:
    block.common[0].is_sound[:count] = 1.0
    _place_clamps(legs, block, count, 1.0)
    _finish(legs, block, count, dof)
    set_margins(legs, block, count, dof)


@kernel
def _step_lanes(legs: Array, block: Block, count: int, dof: int) -> None:
    common = block.common[0]
    common.is_sound[:count] = 1.0
    _place_clamps(legs, block, count, 0.0)
    _evaluate(legs, block, count, dof)
    set_index(block, count)
    common.index_before[:count] = common.index[:count]
    _set_rates(legs, block, count)
    _solve(block, count)
    _keep_tangent(block, count, dof)
    common.is_moving[:count] = 1.0
    _add_step(block, count)
    _place_clamps(legs, block, count, 1.0)
    common.previous[:count] = math.inf
    for iteration in range(_MOST_ITERATIONS):
        _evaluate(legs, block, count, dof)
        _set_residual(block, count)
        _solve(block, count)
        _add_step(block, count)
        if _close_iteration(common, count, iteration == 0) == 0:
            break
    _finish(legs, block, count, dof)
    for lane in range(count):
        keep_if(common, lane, (common.index[lane] == common.index_before[lane]) & (common.is_moving[lane] == 0.0))
    _refuse_uneven(legs, block, count)
    set_margins(legs, block, count, dof)
    for lane in range(count):
        is_as_told = is_as_foreseen(common.foreseen[lane], common.greatest[lane], common.yielding[lane])
        keep_if(common, lane, is_as_told & (common.is_clear[lane] > 0.0))


@kernel
def _finish(legs: Array, block: Block, count: int, dof: int) -> None:
    """Evaluate and judge the lanes at the state that they have come to; refuse those that are no equilibria."""
    common = block.common[0]
    _evaluate(legs, block, count, dof)
    _set_residual(block, count)
    judge_block(block, count, dof)
    for lane in range(count):
        common.error[lane] = residual(common, lane)
        keep_if(common, lane, common.error[lane] < _RESIDUAL_LIMIT)


@kernel
def _place_clamps(legs: Array, block: Block, count: int, fraction: float) -> None:
    """Set the clamps to the inputs at a fraction, 0 or 1, of the step."""
    for i in range(legs.shape[0]):
        _place_clamp(actuator_of(legs, i), block.legs[i], block.common[0], count, fraction)


@kernel
def _place_clamp(actuator: Actuator, leg: LegLanes, common: CommonLanes, count: int, fraction: float) -> None:
    for lane in range(count):
        value = leg.input[lane] + fraction * (leg.target[lane] - leg.input[lane])
        angle = clamp_angle(actuator, value)
        set_pair(leg.clamp, lane, clamp_point(actuator, value))
        set_pair(leg.direction, lane, _cosine_and_sine(angle))
        keep_if(common, lane, abs(angle) <= LARGEST_ANGLE)


@formula
def _cosine_and_sine(angle: float) -> Pair:
    sine, cosine = sine_and_cosine(angle)
    return cosine, sine


@kernel
def _evaluate(legs: Array, block: Block, count: int, dof: int) -> None:
    """Fill all that follows from loads at the tips, clamps and pose: rods and stiffness."""
    common = block.common[0]
    start = Symmetric(0.0, 0.0, 0.0, 0.0, 0.0, own_turn_stiffness(dof))
    for lane in range(count):
        angle = common.pose[2, lane]
        set_pair(common.turn, lane, _cosine_and_sine(angle))
        set_symmetric(common.stiffness, lane, start)
        keep_if(common, lane, abs(angle) <= LARGEST_ANGLE)
    for i in range(legs.shape[0]):
        length = legs[i, LENGTH]
        _evaluate_leg(block.legs[i], common, count, length, force_unit(length, legs[i, STIFFNESS]))
        _add_stiffness(block.legs[i], common, count, pair_of_row(legs[i], ATTACH_X))


@kernel
def _evaluate_leg(leg: LegLanes, common: CommonLanes, count: int, length: float, unit_force: float) -> None:
    for lane in range(count):
        unit, functions, holds = rod_in_lanes(leg.g[0, lane], leg.g[1, lane])
        point = placed(unit, length, unit_force, pair(leg.direction, lane))
        tip_g = (point.tip_x_gx, point.tip_x_gy, point.tip_y_gx, point.tip_y_gy)
        force_g = (point.force_x_gx, point.force_x_gy, point.force_y_gx, point.force_y_gy)
        set_pair(leg.tip, lane, (point.tip_x, point.tip_y))
        set_pair(leg.force, lane, (point.force_x, point.force_y))
        set_derivatives(leg.tip_g, lane, tip_g)
        set_derivatives(leg.force_g, lane, force_g)
        leg.dead_load_index[lane] = point.dead_load_index
        leg.half_periods[lane] = point.half_periods
        set_functions(leg, lane, functions)
        set_triple(leg.stiffness, lane, stiffness_from(tip_g, force_g))
        keep_if(common, lane, holds & (pole_distance_from(tip_g) > _POLE_LIMIT))


@kernel
def _add_stiffness(leg: LegLanes, common: CommonLanes, count: int, attachment: Pair) -> None:
    for lane in range(count):
        arm = turned(pair(common.turn, lane), attachment)
        set_pair(leg.arm, lane, arm)
        share = stiffness_share(triple(leg.stiffness, lane), arm, pair(leg.force, lane))
        set_symmetric(common.stiffness, lane, added(symmetric(common.stiffness, lane), share))


@kernel
def _set_rates(legs: Array, block: Block, count: int) -> None:
    """Fill the right-hand side with the derivative of the residual along the step."""
    common = block.common[0]
    common.right[:, :count] = 0.0
    for i in range(legs.shape[0]):
        _add_rate(actuator_of(legs, i), block.legs[i], common, count)


@kernel
def _add_rate(actuator: Actuator, leg: LegLanes, common: CommonLanes, count: int) -> None:
    for lane in range(count):
        rate = leg.target[lane] - leg.input[lane]
        hinge, pull = input_rate(actuator, rate, pair(leg.tip, lane), pair(leg.force, lane))
        set_pair(leg.right, lane, hinge)
        add_triple(common.right, lane, (pull[0], pull[1], moment(pair(leg.arm, lane), pull)))


@kernel
def _set_residual(block: Block, count: int) -> None:
    """Fill the right-hand side with the residual, and with what `residual` needs."""
    common = block.common[0]
    for lane in range(count):
        load = triple(common.load, lane)
        set_triple(common.right, lane, (-load[0], -load[1], -load[2]))
        common.closure_error[lane] = 0.0
        common.largest_force[lane] = 0.0
    for i in range(block.legs.shape[0]):
        leg = block.legs[i]
        for lane in range(count):
            arm, force = pair(leg.arm, lane), pair(leg.force, lane)
            gap = hinge_gap(pair(leg.clamp, lane), pair(leg.tip, lane), pair(common.pose, lane), arm)
            set_pair(leg.right, lane, gap)
            add_triple(common.right, lane, (force[0], force[1], moment(arm, force)))
            common.closure_error[lane] = larger(common.closure_error[lane], gap)
            common.largest_force[lane] = larger(common.largest_force[lane], force)
            keep_if(common, lane, are_finite(gap, force))


@kernel
def _solve(block: Block, count: int) -> None:
    """Solve the condensed system for the step, J step = -right-hand side."""
    common = block.common[0]
    for lane in range(count):
        right = triple(common.right, lane)
        set_triple(common.pull, lane, (-right[0], -right[1], -right[2]))
    for i in range(block.legs.shape[0]):
        leg = block.legs[i]
        for lane in range(count):
            pull = condensed_pull(triple(leg.stiffness, lane), pair(leg.arm, lane), pair(leg.right, lane))
            add_triple(common.pull, lane, pull)
    for lane in range(count):
        pull = triple(common.pull, lane)
        move = solve_symmetric(symmetric(common.stiffness, lane), pull[0], pull[1], pull[2])
        set_triple(common.move, lane, move)
        common.size[lane] = max(abs(move[0]), abs(move[1]), abs(move[2]))
    for i in range(block.legs.shape[0]):
        _set_step(block.legs[i], common, count)


@kernel
def _set_step(leg: LegLanes, common: CommonLanes, count: int) -> None:
    """Fill the step of a rod's load from the move of the end-effector."""
    for lane in range(count):
        move, right = triple(common.move, lane), pair(leg.right, lane)
        hinge = hinge_move(move, pair(leg.arm, lane))
        tip_g, force_g = derivatives(leg.tip_g, lane), derivatives(leg.force_g, lane)
        step = step_from_tip(tip_g, (hinge[0] - right[0], hinge[1] - right[1]))
        set_pair(leg.step, lane, step)
        common.size[lane] = max(common.size[lane], rod_correction(tip_g, force_g, pair(leg.force, lane), step))
        keep_if(common, lane, are_finite(step, (move[2], 0.0)))


@kernel
def _keep_tangent(block: Block, count: int, dof: int) -> None:
    """Keep the step as the tangent at the start, so that `bow` becomes what is added to it; keep the compliance."""
    common, of_own_turn = block.common[0], own_turn_stiffness(dof)  # a compliance of 1, or none
    for i in range(block.legs.shape[0]):
        leg = block.legs[i]
        for lane in range(count):
            step = pair(leg.step, lane)
            set_pair(leg.tangent, lane, step)
            set_pair(leg.bow, lane, (-step[0], -step[1]))
    for lane in range(count):
        move = triple(common.move, lane)
        set_triple(common.tangent, lane, move)
        set_triple(common.bow, lane, (-move[0], -move[1], -move[2]))
        common.yielding[lane] = trace_of_inverse(symmetric(common.stiffness, lane)) - of_own_turn


@kernel
def _refuse_uneven(legs: Array, block: Block, count: int) -> None:
    """Refuse the lanes whose tangents at both ends do not agree with the chord, as `unevenness` tells."""
    common = block.common[0]
    _set_rates(legs, block, count)
    _solve(block, count)
    for lane in range(count):
        first, last, bow = triple(common.tangent, lane), triple(common.move, lane), triple(common.bow, lane)
        length = defect = 0.0
        for n in range(3):
            length = max(length, abs(0.5 * (first[n] + last[n])))
            defect = max(defect, abs(bow[n] + 0.5 * (first[n] - last[n])))
        common.length[lane], common.defect[lane] = length, defect
    for i in range(block.legs.shape[0]):
        _measure_rod(block.legs[i], common, count)
    for lane in range(count):
        keep_if(common, lane, relative_defect(common.defect[lane], common.length[lane]) <= 1.0)


@kernel
def _measure_rod(leg: LegLanes, common: CommonLanes, count: int) -> None:
    for lane in range(count):
        first, last, bow = pair(leg.tangent, lane), pair(leg.step, lane), pair(leg.bow, lane)
        tip_g, force_g, force = derivatives(leg.tip_g, lane), derivatives(leg.force_g, lane), pair(leg.force, lane)
        mean = 0.5 * (first[0] + last[0]), 0.5 * (first[1] + last[1])
        off = bow[0] + first[0] - mean[0], bow[1] + first[1] - mean[1]
        common.length[lane] = max(common.length[lane], rod_correction(tip_g, force_g, force, mean))
        common.defect[lane] = max(common.defect[lane], rod_correction(tip_g, force_g, force, off))


@kernel
def _add_step(block: Block, count: int) -> None:
    """Add the step where the lane still moves."""
    common = block.common[0]
    for i in range(block.legs.shape[0]):
        leg = block.legs[i]
        for lane in range(count):
            is_moving, step = common.is_moving[lane] > 0.0, pair(leg.step, lane)
            added_step = step[0] if is_moving else 0.0, step[1] if is_moving else 0.0
            add_pair(leg.g, lane, added_step)
            add_pair(leg.bow, lane, added_step)
    for lane in range(count):
        is_moving, move = common.is_moving[lane] > 0.0, triple(common.move, lane)
        added_move = move[0] if is_moving else 0.0, move[1] if is_moving else 0.0, move[2] if is_moving else 0.0
        add_triple(common.pose, lane, added_move)
        add_triple(common.bow, lane, added_move)


@kernel
def _close_iteration(common: CommonLanes, count: int, is_first: bool) -> int:
    """Refuse or stop the lanes that `solve_forward_locally` would; return how many still move."""
    moving = 0
    for lane in range(count):
        size, previous, was_moving = common.size[lane], common.previous[lane], common.is_moving[lane] > 0.0
        verdict = accept_correction(size, previous, is_first, STEP_RULES)
        is_sound = (common.is_sound[lane] > 0.0) & ((verdict <= CONVERGED) | (not was_moving))
        is_moving = was_moving & is_sound & (verdict != CONVERGED)
        common.is_sound[lane] = 1.0 if is_sound else 0.0
        common.is_moving[lane] = 1.0 if is_moving else 0.0
        common.previous[lane] = size
        moving += 1 if is_moving else 0
    return moving
