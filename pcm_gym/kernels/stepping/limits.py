"""Costs of states that break limits of the structure, after a step, from what is seen of them."""

from pcm_gym.arrays import Array, Integers
from pcm_gym.kernels.numerics.compilation import kernel
from pcm_gym.kernels.rods.elliptic import sine_and_cosine
from pcm_gym.kernels.statics.closure import (
    ARM_X,
    ARM_Y,
    ATTACH_X,
    CLAMP_COS,
    CLAMP_SIN,
    CLAMP_X,
    CLAMP_Y,
    FORCE_X,
    FORCE_Y,
    HALF_PERIODS,
    LENGTH,
    STIFFNESS,
    TIP_X,
    TIP_Y,
    Workspace,
    actuator_of,
    make_workspace,
    pair,
)
from pcm_gym.kernels.statics.formulas import clamp_angle, clamp_point, force_unit, scaled, turned
from pcm_gym.kernels.statics.states import States
from pcm_gym.kernels.stepping.features import ROD_FEATURES, columns_of, force_and_periods
from pcm_gym.kernels.stepping.report import Report
from pcm_gym.kernels.structure.limits import Bounds, judge, make_judge


@kernel
def judge_rows(legs: Array, states: States, rows: Integers, bounds: Bounds, report: Report) -> None:
    """Fill the costs of limits in some rows of a report that is filled otherwise."""
    leg_count, size = legs.shape[0], states.x.shape[1]
    work, scratch = make_workspace(leg_count, size), make_judge(leg_count, size)
    for row in rows:
        x = states.x[row]
        _place_seen(legs, x, states.inputs[row], report.features[row], work)
        stress, torque, contact = judge(legs, x, bounds, scratch, work)
        verdict = report.verdicts[row]
        verdict["cost_stress"] = 1.0 if stress else 0.0
        verdict["cost_torque"] = 1.0 if torque else 0.0
        verdict["cost_contact"] = 1.0 if contact else 0.0


@kernel
def _place_seen(legs: Array, x: Array, inputs: Array, features: Array, work: Workspace) -> None:
    """Fill what limits need of the rod table from the features of an equilibrium, without the elliptic functions.

    Tips are taken from the pose: at an equilibrium they are at their hinges.
    """
    pose, rods, clamps, turn = 2 * legs.shape[0], work.rods, work.clamps, (1.0, 0.0)
    column = columns_of(legs, x.shape[0] - pose).rods
    if x.shape[0] - pose == 3:
        sine, cosine = sine_and_cosine(x[pose + 2])
        turn = (cosine, sine)
    for i in range(legs.shape[0]):
        actuator, length = actuator_of(legs, i), legs[i, LENGTH]
        sine, cosine = sine_and_cosine(clamp_angle(actuator, inputs[i]))
        base, arm = clamp_point(actuator, inputs[i]), turned(turn, pair(legs[i], ATTACH_X))
        unit_force, half_periods = force_and_periods(pair(x, 2 * i), features, column + ROD_FEATURES * i)
        force = turned((cosine, sine), scaled(force_unit(length, legs[i, STIFFNESS]), unit_force))
        clamps[i, CLAMP_X], clamps[i, CLAMP_Y] = base
        clamps[i, CLAMP_COS], clamps[i, CLAMP_SIN] = cosine, sine
        rods[i, TIP_X], rods[i, TIP_Y] = x[pose] + arm[0] - base[0], x[pose + 1] + arm[1] - base[1]
        rods[i, FORCE_X], rods[i, FORCE_Y] = force
        rods[i, ARM_X], rods[i, ARM_Y] = arm
        rods[i, HALF_PERIODS] = half_periods
