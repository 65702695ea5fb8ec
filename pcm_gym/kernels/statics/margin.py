"""Singularity margin: about how far, in the space of the inputs, a state is from the nearest fold of its sheet.

Near a fold the square of an eigenvalue k of the stiffness is linear in the inputs. If it were so everywhere, it would
vanish at a distance of |k| / (2 |grad k|), the gradient taken along the sheet. The least of these distances over the
eigenvalues is the margin: zero exactly at a fold, ever better towards it, and cut to `FARTHEST` where no fold is near.
At a pole of the stiffness k grows beyond bounds within a short way, but without a fold. So the distances of stiff
directions count for more, by 1 + (k / `STIFF`)^2.

grad k is the third derivative of the reduced energy along (v, v, motion), v the eigenvector of k and motion that of the
mechanism with one input. Here all of it is had from motions of the rods, which are smooth where the stiffness has
poles: along v by a load, the mechanism yields by a compliance c = 1/k. Lanes, which are away from poles, condense the
rods; the formulas are the same.
"""

import math
from typing import NamedTuple

import numpy as np

from pcm_gym.arrays import Array
from pcm_gym.kernels.numerics.compilation import formula, kernel
from pcm_gym.kernels.numerics.linear import diagonalize
from pcm_gym.kernels.rods.curvature import Bend, rod_bend
from pcm_gym.kernels.statics.closure import (
    ARM_X,
    CLAMP_COS,
    FORCE_G,
    FORCE_X,
    LENGTH,
    STIFFNESS,
    TIP_G,
    TURN,
    Workspace,
    add_input_derivative,
    derivatives,
    pair,
    solve_equilibrium_system,
)
from pcm_gym.kernels.statics.formulas import Pair, applied, force_unit, moment, scaled, turned

# Largest margin, in rad or lengths.
FARTHEST = 10.0
# Stiffness, in EI / L^3, that does not vanish within a short way.
STIFF = 500.0
# Keeps the ratio of two vanishing numbers finite.
_LEAST_SLOPE = 1e-300


class Yielding(NamedTuple):
    """What one leg does in a motion of the end-effector with the inputs held."""

    turn: float  # of the end-effector
    tip: Pair  # motion of the rod's tip
    pull: Pair  # that of its force
    bend: tuple[Pair, Pair]  # second derivatives of tip and force, world frame


class Cubic(NamedTuple):
    """What one leg adds to the derivatives of the energy's second derivative along a motion."""

    by_tip: Pair  # by the motion of the rod's tip
    by_pull: Pair  # by that of its force
    by_arm: Pair  # by that of its arm, a turn of the end-effector
    by_turn: float  # by that turn itself
    by_clamp: float  # by a turn of the clamp


@formula
def placed_bend(bend: Bend, length: float, unit_force: float, clamp: Pair) -> tuple[Pair, Pair]:
    """Return the second derivatives of a rod's tip and force in the world frame and its units."""
    tip = turned(scaled(length, clamp), (bend[0], bend[1]))
    return tip, turned(scaled(unit_force, clamp), (bend[2], bend[3]))


@formula
def cubic_share(motion: Yielding, arm: Pair, force: Pair) -> Cubic:
    """Return the share of one leg: the arm turns with the end-effector, the frame of the rod with its clamp."""
    turn, squared = motion.turn, motion.turn * motion.turn
    tip_bend, force_bend = motion.bend
    by_turn = squared * moment(arm, force)
    return Cubic(
        force_bend,
        (-(tip_bend[0] + squared * arm[0]), -(tip_bend[1] + squared * arm[1])),
        (2.0 * turn * motion.pull[1], -2.0 * turn * motion.pull[0]),
        -by_turn,
        by_turn - 2.0 * moment(motion.tip, motion.pull),
    )


@formula
def fold_distance(stiffness: float, compliance: float, slope: float) -> float:
    """Return the margin of one eigenvalue k, given as the ratio of a stiffness to a compliance, one of which is 1.

    `slope` is stiffness compliance |grad k| of them: of the eigenvalue if the compliance is 1, otherwise c^3 |grad k|.
    """
    ratio = stiffness / STIFF
    distance = 0.5 * stiffness * stiffness * (compliance * compliance + ratio * ratio)
    return distance / max(slope, distance / FARTHEST, _LEAST_SLOPE)


@kernel
def singularity_margin(legs: Array, x: Array, work: Workspace) -> float:
    """Return the margin of the state `x`, whose rod table is set and is left alone; 0 where it is singular."""
    leg_count, size = legs.shape[0], x.shape[0]
    dof = size - 2 * leg_count
    yielding, driven = np.empty((dof, size)), np.empty((leg_count, size))
    if not set_yielding(legs, x, work, yielding):
        return 0.0
    _set_driven(legs, x, work, driven)
    compliance, axes = yielding[:, 2 * leg_count :].copy(), np.empty((dof, dof))
    diagonalize(compliance, axes)
    margin, motion = FARTHEST, np.empty(size)
    by_driven, by_clamp = np.empty(leg_count), np.empty(leg_count)
    for k in range(dof):
        set_motion_along(axes[:, k], yielding, motion)
        set_slopes(legs, x, motion, driven, work, by_driven, by_clamp)
        squared_slope = 0.0
        for i in range(leg_count):
            squared_slope += (by_driven[i] + legs[i, TURN] * by_clamp[i]) ** 2
        own = compliance[k, k]
        margin = min(margin, fold_distance(1.0, own, abs(own) * math.sqrt(squared_slope)))
    return margin


@kernel
def set_yielding(legs: Array, x: Array, work: Workspace, yielding: Array) -> bool:
    """Fill the motions under a unit load along each axis (d, size); return False where the state is singular.

    Their pose parts are the compliance.
    """
    right, pose = np.zeros(x.shape[0]), 2 * legs.shape[0]
    for k in range(yielding.shape[0]):
        right[:] = 0.0
        right[pose + k] = -1.0
        if not solve_equilibrium_system(legs, x, right, work):
            return False
        yielding[k] = work.step
    return True


@kernel
def _set_driven(legs: Array, x: Array, work: Workspace, driven: Array) -> None:
    """Fill the motions with each input (legs, size)."""
    right = np.zeros(x.shape[0])
    for i in range(legs.shape[0]):
        right[:] = 0.0
        add_input_derivative(legs, x, work, i, 1.0, right)
        solve_equilibrium_system(legs, x, right, work)
        driven[i] = work.step


@kernel
def set_motion_along(axis: Array, yielding: Array, motion: Array) -> None:
    """Fill the motion (size,) under a unit load along an axis (d,)."""
    motion[:] = 0.0
    for d in range(axis.shape[0]):
        motion += axis[d] * yielding[d]


@kernel
def set_slopes(
    legs: Array, x: Array, motion: Array, driven: Array, work: Workspace, by_driven: Array, by_clamp: Array
) -> None:
    """Fill the derivatives of the energy's second derivative along a motion, which is held.

    `by_driven` (m,) are those by the motions `driven` (m, size) of the state, `by_clamp` (legs,) by a clamp's turn.
    """
    pose = 2 * legs.shape[0]
    is_platform = x.shape[0] - pose == 3
    turn = motion[pose + 2] if is_platform else 0.0
    by_driven[:] = 0.0
    for j in range(legs.shape[0]):
        rod_row, length = work.rods[j], legs[j, LENGTH]
        tip_g, force_g, arm = derivatives(rod_row, TIP_G), derivatives(rod_row, FORCE_G), pair(rod_row, ARM_X)
        step = pair(motion, 2 * j)
        bend = rod_bend(x[2 * j], x[2 * j + 1], step[0], step[1])
        bends = placed_bend(bend, length, force_unit(length, legs[j, STIFFNESS]), pair(work.clamps[j], CLAMP_COS))
        yielding = Yielding(turn, applied(tip_g, step), applied(force_g, step), bends)
        share = cubic_share(yielding, arm, pair(rod_row, FORCE_X))
        by_turn = moment(arm, share.by_arm) + share.by_turn
        for i in range(driven.shape[0]):
            tip, pull = applied(tip_g, pair(driven[i], 2 * j)), applied(force_g, pair(driven[i], 2 * j))
            by_driven[i] += share.by_tip[0] * tip[0] + share.by_tip[1] * tip[1]
            by_driven[i] += share.by_pull[0] * pull[0] + share.by_pull[1] * pull[1]
            by_driven[i] += by_turn * (driven[i, pose + 2] if is_platform else 0.0)
        by_clamp[j] = share.by_clamp
