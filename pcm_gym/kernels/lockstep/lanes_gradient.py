"""Derivatives by the inputs of a weighted sum of what is known of each row, in lock-step: those of `sensitivity`.

The weights are carried back: those of forces, efforts and of the least eigenvalue become one on each tip and one on the
end-effector, and a single solution with the stiffness, whatever the number of inputs, takes them to the inputs.
"""

import math

import numpy as np

from pcm_gym.arrays import Array, Integers
from pcm_gym.kernels.lockstep.lanes import evaluate_block
from pcm_gym.kernels.lockstep.lanes_margin import differentiate, set_curvature
from pcm_gym.kernels.lockstep.layout import (
    LANES,
    Block,
    CommonLanes,
    LegLanes,
    add_triple,
    derivatives,
    keep_if,
    make_block,
    pair,
    set_pair,
    set_triple,
    set_vector,
    symmetric,
    triple,
    vector,
)
from pcm_gym.kernels.lockstep.rows import load_lane
from pcm_gym.kernels.lockstep.verdicts import judge_block
from pcm_gym.kernels.numerics.compilation import formula, kernel
from pcm_gym.kernels.numerics.linear import solve_symmetric
from pcm_gym.kernels.statics.closure import LENGTH, STIFFNESS, actuator_of
from pcm_gym.kernels.statics.formulas import (
    Actuator,
    Pair,
    force_unit,
    hinge_move,
    input_rate,
    moment,
    pole_distance_from,
    pull_of,
)
from pcm_gym.kernels.statics.sensitivity import Quantities, pull_back
from pcm_gym.kernels.statics.states import States

# Nearer than this to a pole of a rod's stiffness a lane is left to the scalar code: no iteration corrects errors here.
_POLE_LIMIT = 1e-4


@kernel
def pull_back_in_lanes(
    legs: Array, states: States, effects: Array, weights: Quantities, with_margin: bool, out: Array
) -> None:
    """Do what `pull_back` of `sensitivity` does for the inputs, whose effects these are: fill `out` (n, legs)."""
    block, dof = make_block(legs.shape[0]), states.load.shape[1]
    left, left_count = np.empty(states.x.shape[0], np.int64), 0
    for first in range(0, states.x.shape[0], LANES):
        count = min(LANES, states.x.shape[0] - first)
        for lane in range(count):
            load_lane(states, first + lane, states.inputs[first + lane], block, lane)
            _load_weights(weights, first + lane, with_margin, block, lane)
        computed = evaluate_block(legs, block, count, dof)
        _pull_back_block(legs, block, computed, dof, with_margin)
        for lane in range(count):
            is_sound = block.common[0].is_sound[lane] > 0.0
            for i in range(legs.shape[0]):
                out[first + lane, i] = block.legs[i].slope[lane]
                is_sound = is_sound and math.isfinite(out[first + lane, i])
            if not is_sound:
                left[left_count] = first + lane
                left_count += 1
    if left_count > 0:
        _pull_back_alone(legs, states, left[:left_count], effects, weights, with_margin, out)


@kernel
def _pull_back_alone(
    legs: Array, states: States, rows: Integers, effects: Array, weights: Quantities, with_margin: bool, out: Array
) -> None:
    """Fill the rows that lanes are too near to poles for."""
    own = Quantities(weights.pose[rows], weights.forces[rows], weights.efforts[rows], weights.margin[rows])
    found = np.empty((rows.shape[0], legs.shape[0]))
    pull_back(legs, states.x[rows], states.inputs[rows], effects, own, with_margin, found)
    for n in range(rows.shape[0]):
        out[rows[n]] = found[n]


@formula
def _load_weights(weights: Quantities, row: int, with_margin: bool, block: Block, lane: int) -> None:
    """Put the weights of a row into a lane; those on the pose are the first part of what moves the end-effector."""
    common, dof = block.common[0], weights.pose.shape[1]
    for d in range(3):
        common.right[d, lane] = weights.pose[row, d] if d < dof else 0.0
    common.margin_weight[lane] = weights.margin[row] if with_margin else 0.0
    for i in range(block.legs.shape[0]):
        set_pair(block.legs[i].force_weight, lane, (weights.forces[row, i, 0], weights.forces[row, i, 1]))
        block.legs[i].effort_weight[lane] = weights.efforts[row, i]


@kernel
def _pull_back_block(legs: Array, block: Block, count: int, dof: int, with_margin: bool) -> None:
    common = block.common[0]
    common.pull[:, :count] = 0.0
    for i in range(legs.shape[0]):
        _refuse_near_poles(block.legs[i], common, count)
    if with_margin:
        judge_block(block, count, dof)
        _choose_least(common, count, dof)
    for i in range(legs.shape[0]):
        leg, length = block.legs[i], legs[i, LENGTH]
        if with_margin:
            set_curvature(leg, count)
            differentiate(leg, common, count, 0, length, force_unit(length, legs[i, STIFFNESS]))
        else:
            leg.by_tip[:, :count] = 0.0
            leg.by_clamp[:count] = 0.0
    for lane in range(count):
        pull, weight = triple(common.pull, lane), common.margin_weight[lane]
        right = triple(common.right, lane)
        set_triple(common.pull, lane, (weight * pull[0], weight * pull[1], weight * pull[2]))
        add_triple(common.pull, lane, right)
    for i in range(legs.shape[0]):
        _gather(actuator_of(legs, i), block.legs[i], common, count)
    for lane in range(count):
        pull = triple(common.pull, lane)
        set_triple(common.move, lane, solve_symmetric(symmetric(common.stiffness, lane), pull[0], pull[1], pull[2]))
    for i in range(legs.shape[0]):
        _set_slope(actuator_of(legs, i), block.legs[i], common, count)


@kernel
def _refuse_near_poles(leg: LegLanes, common: CommonLanes, count: int) -> None:
    """Leave lanes to the scalar code, which does not condense the rods, where that would cost too many digits."""
    for lane in range(count):
        keep_if(common, lane, pole_distance_from(derivatives(leg.tip_g, lane)) > _POLE_LIMIT)


@kernel
def _choose_least(common: CommonLanes, count: int, dof: int) -> None:
    """Put the eigenvector of the least eigenvalue first."""
    for lane in range(count):
        first, second, third = vector(common.axes, 0, lane), vector(common.axes, 1, lane), vector(common.axes, 2, lane)
        own, other = common.eigenvalues[0, lane], common.eigenvalues[2, lane]
        last = common.eigenvalues[5, lane] if dof == 3 else math.inf
        is_other, is_last = other < own, last < min(own, other)
        least = (
            third[0] if is_last else (second[0] if is_other else first[0]),
            third[1] if is_last else (second[1] if is_other else first[1]),
            third[2] if is_last else (second[2] if is_other else first[2]),
        )
        set_vector(common.axes, 0, lane, least)


@formula
def _weights_on(actuator: Actuator, leg: LegLanes, lane: int) -> tuple[Pair, Pair]:
    """Return the weights on the rates of a rod's tip and of its force: an effort is -axis . f - turn (p x f)."""
    weight, on_force, tip, force = (
        leg.effort_weight[lane],
        pair(leg.force_weight, lane),
        pair(leg.tip, lane),
        pair(leg.force, lane),
    )
    turning = weight * actuator.turn
    on_pull = (
        on_force[0] - weight * actuator.axis[0] + turning * tip[1],
        on_force[1] - weight * actuator.axis[1] - turning * tip[0],
    )
    return (-turning * force[1], turning * force[0]), on_pull


@kernel
def _gather(actuator: Actuator, leg: LegLanes, common: CommonLanes, count: int) -> None:
    """Bring all weights of a leg onto the motion of its tip at a held clamp, and from there to the end-effector."""
    for lane in range(count):
        on_tip, on_pull = _weights_on(actuator, leg, lane)
        through, weight = pull_of(triple(leg.stiffness, lane), on_pull), common.margin_weight[lane]
        gathered, by_tip = (on_tip[0] + through[0], on_tip[1] + through[1]), pair(leg.by_tip, lane)
        add_triple(common.pull, lane, (gathered[0], gathered[1], moment(pair(leg.arm, lane), gathered)))
        set_pair(leg.by_tip, lane, (gathered[0] + weight * by_tip[0], gathered[1] + weight * by_tip[1]))


@kernel
def _set_slope(actuator: Actuator, leg: LegLanes, common: CommonLanes, count: int) -> None:
    """Fill the derivative by the input of one leg: directly, and by the motion of the end-effector."""
    for lane in range(count):
        hinge, turn = hinge_move(triple(common.move, lane), pair(leg.arm, lane)), actuator.turn
        tip, by_tip = pair(leg.tip, lane), pair(leg.by_tip, lane)
        rate, turned_force = input_rate(actuator, 1.0, tip, pair(leg.force, lane))
        pull = pull_of(triple(leg.stiffness, lane), rate)
        on_tip, on_pull = _weights_on(actuator, leg, lane)
        slope = hinge[0] * (pull[0] - turned_force[0]) + hinge[1] * (pull[1] - turned_force[1])
        slope += on_pull[0] * turned_force[0] + on_pull[1] * turned_force[1] - by_tip[0] * rate[0] - by_tip[1] * rate[1]
        slope += turn * (on_tip[1] * tip[0] - on_tip[0] * tip[1] + common.margin_weight[lane] * leg.by_clamp[lane])
        leg.slope[lane] = slope
