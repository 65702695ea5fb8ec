"""How equilibria change along their branch with the inputs and with the numbers of the legs, in closed form.

By the implicit function theorem a state moves by -J^-1 r, J the Jacobian of the residual by the state and r its
derivative by the parameter. Whatever changes in a leg comes to few numbers, its row in a table of effects: how far its
clamp is moved and turned, how much longer and stiffer its rod is, by parts, and how its hinge and its axis are moved.

The least eigenvalue k of the stiffness changes by v' dK v, v its eigenvector: the third derivative of the energy along
(v, v, motion), as in `margin`, and what the parameter itself does to v' K v with rods and pose held. A rod's own
stiffness grows as EI / L^3, its force as EI / L^2, and a hinge that is moved is on another arm.
"""

import math
from typing import NamedTuple

import numpy as np

from pcm_gym.arrays import Array
from pcm_gym.kernels.numerics.compilation import formula, kernel
from pcm_gym.kernels.numerics.linear import diagonalize
from pcm_gym.kernels.statics.closure import (
    ARM_X,
    AXIS_X,
    AXIS_Y,
    FORCE_G,
    FORCE_X,
    TIP_G,
    TIP_X,
    TURN,
    Workspace,
    derivatives,
    make_workspace,
    pair,
    place,
    solve_whole_system,
)
from pcm_gym.kernels.statics.formulas import Pair, applied, moment, turned
from pcm_gym.kernels.statics.margin import set_motion_along, set_slopes, set_yielding

# Columns of a table of effects: rates of the clamped point, of the clamp's angle, of the logarithms of the rod's length
# and stiffness, of the hinge in the end-effector's frame, and of the actuator's axis.
CLAMP_X, CLAMP_Y, CLAMP_TURN, STRETCH, STIFFENING, HINGE_X, HINGE_Y, TILT_X, TILT_Y = range(9)
EFFECTS = 9


class Quantities(NamedTuple):
    """What is differentiated, one row each: of a state, its rates with one parameter, or weights of these."""

    pose: Array  # (n, d)
    forces: Array  # (n, legs, 2): on the tips, world frame
    efforts: Array  # (n, legs): what actuators give, dU/dq
    margin: Array  # (n,): least eigenvalue of the stiffness


class Scratch(NamedTuple):
    """Room for the rates of one state with m parameters."""

    rates: Quantities  # of m rows
    driven: Array  # (m, size): motions of the state
    right: Array  # (size,)
    yielding: Array  # (d, size)
    compliance: Array  # (d, d)
    axes: Array  # (d, d)
    motion: Array  # (size,)
    by_clamp: Array  # (legs,)


@kernel
def make_scratch(count: int, leg_count: int, size: int) -> Scratch:
    """Return room for the rates with `count` parameters."""
    dof = size - 2 * leg_count
    return Scratch(
        Quantities(
            np.empty((count, dof)), np.empty((count, leg_count, 2)), np.empty((count, leg_count)), np.empty(count)
        ),
        np.empty((count, size)),
        np.empty(size),
        np.empty((dof, size)),
        np.empty((dof, dof)),
        np.empty((dof, dof)),
        np.empty(size),
        np.empty(leg_count),
    )


@formula
def _direct_rates(effect: Array, tip: Pair, force: Pair) -> tuple[Pair, Pair]:
    """Return the rates of tip and force of a leg with its load as its tip sees it held."""
    turn, stretch, own = effect[CLAMP_TURN], effect[STRETCH], effect[STIFFENING] - 2.0 * effect[STRETCH]
    return (
        (stretch * tip[0] - turn * tip[1], stretch * tip[1] + turn * tip[0]),
        (own * force[0] - turn * force[1], own * force[1] + turn * force[0]),
    )


@formula
def _turn_of(x: Array, leg_count: int) -> Pair:
    """Return cosine and sine of the end-effector's angle."""
    angle = x[2 * leg_count + 2] if x.shape[0] - 2 * leg_count == 3 else 0.0
    return math.cos(angle), math.sin(angle)


@kernel
def _set_residual_rate(legs: Array, x: Array, turn: Pair, effects: Array, work: Workspace, out: Array) -> None:
    """Fill `out` with the derivative of the residual by a parameter with these effects (legs, `EFFECTS`)."""
    pose = 2 * legs.shape[0]
    out[:] = 0.0
    for i in range(legs.shape[0]):
        row, effect = work.rods[i], effects[i]
        force = pair(row, FORCE_X)
        tip_rate, pull = _direct_rates(effect, pair(row, TIP_X), force)
        arm_rate = turned(turn, pair(effect, HINGE_X))
        out[2 * i] = effect[CLAMP_X] + tip_rate[0] - arm_rate[0]
        out[2 * i + 1] = effect[CLAMP_Y] + tip_rate[1] - arm_rate[1]
        out[pose] += pull[0]
        out[pose + 1] += pull[1]
        if x.shape[0] - pose == 3:
            out[pose + 2] += moment(pair(row, ARM_X), pull) + moment(arm_rate, force)


@kernel
def set_rates(legs: Array, x: Array, effects: Array, with_margin: bool, work: Workspace, scratch: Scratch) -> bool:
    """Fill the rates of the state `x`, whose rod table is set, with parameters of these effects (m, legs, `EFFECTS`).

    Return False where the state is singular. The rates of the margin are filled where they are asked for.
    """
    pose, driven, right, regular = 2 * legs.shape[0], scratch.driven, scratch.right, True
    by_pose, forces, efforts = scratch.rates.pose, scratch.rates.forces, scratch.rates.efforts
    turn, rods, moved = _turn_of(x, legs.shape[0]), work.rods, work.step
    for k in range(effects.shape[0]):
        _set_residual_rate(legs, x, turn, effects[k], work, right)
        regular = solve_whole_system(legs, x, right, work) and regular
        for j in range(x.shape[0]):
            driven[k, j] = moved[j]
        for d in range(x.shape[0] - pose):
            by_pose[k, d] = moved[pose + d]
        for i in range(legs.shape[0]):
            row, effect, step = rods[i], effects[k, i], pair(moved, 2 * i)
            tip, force = pair(row, TIP_X), pair(row, FORCE_X)
            tip_rate, pull = _direct_rates(effect, tip, force)
            own_tip, own_pull = applied(derivatives(row, TIP_G), step), applied(derivatives(row, FORCE_G), step)
            tip_rate = tip_rate[0] + own_tip[0], tip_rate[1] + own_tip[1]
            pull = pull[0] + own_pull[0], pull[1] + own_pull[1]
            forces[k, i, 0], forces[k, i, 1] = pull
            along = legs[i, AXIS_X] * pull[0] + legs[i, AXIS_Y] * pull[1]
            along += effect[TILT_X] * force[0] + effect[TILT_Y] * force[1]
            efforts[k, i] = -along - legs[i, TURN] * (moment(tip_rate, force) + moment(tip, pull))
    if with_margin:
        regular = _set_margin_rates(legs, x, effects, work, scratch) and regular
    return regular


@kernel
def _set_margin_rates(legs: Array, x: Array, effects: Array, work: Workspace, scratch: Scratch) -> bool:
    """Fill the rates of the least eigenvalue of the stiffness from the motions with the parameters."""
    if not set_yielding(legs, x, work, scratch.yielding):
        return False
    compliance, motion, rates = scratch.compliance, scratch.motion, scratch.rates.margin
    compliance[:] = scratch.yielding[:, 2 * legs.shape[0] :]
    diagonalize(compliance, scratch.axes)
    least = 0
    for k in range(1, compliance.shape[0]):
        if 1.0 / compliance[k, k] < 1.0 / compliance[least, least]:
            least = k
    # a motion by the compliance c along the eigenvector: second derivatives along it are c^2 times those along that
    set_motion_along(scratch.axes[:, least], scratch.yielding, motion)
    set_slopes(legs, x, motion, scratch.driven, work, rates, scratch.by_clamp)
    turn_rate = motion[2 * legs.shape[0] + 2] if x.shape[0] - 2 * legs.shape[0] == 3 else 0.0
    turn, own = _turn_of(x, legs.shape[0]), compliance[least, least]
    for i in range(legs.shape[0]):
        row, step = work.rods[i], pair(motion, 2 * i)
        arm, force = pair(row, ARM_X), pair(row, FORCE_X)
        tip, pull = applied(derivatives(row, TIP_G), step), applied(derivatives(row, FORCE_G), step)
        bending = tip[0] * pull[0] + tip[1] * pull[1]
        hanging = turn_rate * turn_rate * (arm[0] * force[0] + arm[1] * force[1])
        for k in range(effects.shape[0]):
            effect = effects[k, i]
            arm_rate = turned(turn, pair(effect, HINGE_X))
            rates[k] += effect[CLAMP_TURN] * scratch.by_clamp[i]
            rates[k] += effect[STRETCH] * (2.0 * hanging - 3.0 * bending) + effect[STIFFENING] * (bending - hanging)
            rates[k] += 2.0 * turn_rate * moment(arm_rate, pull)
            rates[k] -= turn_rate * turn_rate * (arm_rate[0] * force[0] + arm_rate[1] * force[1])
    rates /= own * own
    return True


@kernel
def set_rates_at(legs: Array, x: Array, inputs: Array, effects: Array, out: Quantities) -> bool:
    """Fill the rates of one equilibrium with parameters of these effects; return False where it is singular."""
    work = make_workspace(legs.shape[0], x.shape[0])
    place(legs, x, inputs, work)
    scratch = make_scratch(effects.shape[0], legs.shape[0], x.shape[0])
    regular = set_rates(legs, x, effects, True, work, scratch)
    rates = scratch.rates
    out.pose[:], out.forces[:], out.efforts[:], out.margin[:] = rates.pose, rates.forces, rates.efforts, rates.margin
    return regular


@kernel
def pull_back(
    legs: Array, states: Array, inputs: Array, effects: Array, weights: Quantities, with_margin: bool, out: Array
) -> None:
    """Fill `out` (n, m) with the derivatives of the weighted sum of each row's quantities by m parameters.

    The `states` (n, size) are equilibria at `inputs` (n, legs). It is not a number where a state is singular.
    """
    work = make_workspace(legs.shape[0], states.shape[1])
    scratch = make_scratch(effects.shape[0], legs.shape[0], states.shape[1])
    pose, forces, efforts, margin = scratch.rates
    by_pose, by_forces, by_efforts, by_margin = weights
    for n in range(states.shape[0]):
        place(legs, states[n], inputs[n], work)
        if not set_rates(legs, states[n], effects, with_margin, work, scratch):
            out[n] = math.nan
            continue
        for k in range(effects.shape[0]):
            total = by_margin[n] * margin[k] if with_margin else 0.0
            for d in range(pose.shape[1]):
                total += by_pose[n, d] * pose[k, d]
            for i in range(legs.shape[0]):
                total += by_forces[n, i, 0] * forces[k, i, 0] + by_forces[n, i, 1] * forces[k, i, 1]
                total += by_efforts[n, i] * efforts[k, i]
            out[n, k] = total
