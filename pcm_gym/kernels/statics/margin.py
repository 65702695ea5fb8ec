"""Singularity margin: about how far, in the space of the inputs, a state is from the nearest fold of its sheet.

Near a fold the square of an eigenvalue k of the stiffness is linear in the inputs. If it were so everywhere, it would
vanish at a distance of |k| / (2 |grad k|), the gradient taken along the sheet. The least of these distances over the
eigenvalues is the margin: zero exactly at a fold, ever better towards it, and cut to `FARTHEST` where no fold is near.
At a pole of the stiffness k grows beyond bounds within a short way, but without a fold. So the distances of stiff
directions count for more, by 1 + (k / `STIFF`)^2.

grad k is the third derivative of the reduced energy along (v, v, motion), v the eigenvector of k and motion that of the
mechanism with one input. Here all of it is had from motions of the rods, which are smooth where the stiffness has
poles: along v by a load, the mechanism yields by a compliance c = 1/k.
"""

import math

import numpy as np

from pcm_gym.arrays import Array
from pcm_gym.kernels.numerics.compilation import formula, kernel
from pcm_gym.kernels.numerics.linear import diagonalize
from pcm_gym.kernels.rods.rod import RodPoint, rod
from pcm_gym.kernels.statics.closure import (
    ARM_X,
    ARM_Y,
    FORCE_G,
    FORCE_X,
    FORCE_Y,
    LENGTH,
    STIFFNESS,
    TIP_G,
    TURN,
    Derivatives,
    Workspace,
    add_input_derivative,
    derivatives,
    placed,
    solve_equilibrium_system,
)
from pcm_gym.kernels.statics.newton import rod_correction

# Largest margin, in rad or lengths.
FARTHEST = 10.0
# Stiffness, in EI / L^3, that does not vanish within a short way.
STIFF = 500.0
# Step of the central differences, of fourth order, of a rod's derivatives: change of its tip, or of its force over
# 1 + |force|.
_DIFFERENCE = 1e-3


@kernel
def singularity_margin(legs: Array, x: Array, work: Workspace) -> float:
    """Return the margin of the state `x`, whose rod table is set and is left alone; 0 where it is singular."""
    leg_count, size = legs.shape[0], x.shape[0]
    pose, dof = 2 * leg_count, size - 2 * leg_count
    yielding, driven = np.empty((dof, size)), np.empty((leg_count, size))
    compliance, axes = np.empty((dof, dof)), np.empty((dof, dof))
    right, bends = np.zeros(size), np.empty((leg_count, 4))
    for k in range(dof):
        right[:] = 0.0
        right[pose + k] = -1.0
        if not solve_equilibrium_system(legs, x, right, work):
            return 0.0
        yielding[k] = work.step
        compliance[k] = work.step[pose:]
    for i in range(leg_count):
        right[:] = 0.0
        add_input_derivative(legs, x, work, i, 1.0, right)
        solve_equilibrium_system(legs, x, right, work)
        driven[i] = work.step
    diagonalize(compliance, axes)
    margin = FARTHEST
    for k in range(dof):
        right[:] = 0.0  # from here on the motion under a unit load along the axis
        for d in range(dof):
            right += axes[d, k] * yielding[d]
        for i in range(leg_count):
            _set_bend(legs, x, right, work, i, bends[i])
        squared = 0.0
        for i in range(leg_count):
            squared += _third_derivative(legs, right, driven[i], i, bends, work) ** 2
        soft = compliance[k, k] * compliance[k, k] + 1.0 / (STIFF * STIFF)
        slope = 2.0 * abs(compliance[k, k]) * math.sqrt(squared)
        margin = min(margin, soft / max(slope, soft / FARTHEST))
    return margin


@kernel
def _set_bend(legs: Array, x: Array, motion: Array, work: Workspace, leg: int, bend: Array) -> None:
    """Fill `bend` (4,) with the second derivatives of the rod's tip and force along the line of g in `motion`."""
    rod_row, step_x, step_y = work.rods[leg], motion[2 * leg], motion[2 * leg + 1]
    force = 1.0 + abs(rod_row[FORCE_X]) + abs(rod_row[FORCE_Y])
    size = rod_correction(derivatives(rod_row, TIP_G), derivatives(rod_row, FORCE_G), force, step_x, step_y)
    bend[:] = 0.0
    if size == 0.0:
        return
    width = _DIFFERENCE / size
    for place, weight in ((-2.0, 1.0), (-1.0, -8.0), (1.0, 8.0), (2.0, -1.0)):
        way = place * width
        point = _rod_at(legs, x[2 * leg] + way * step_x, x[2 * leg + 1] + way * step_y, work, leg)
        tip_x, tip_y = _times((point.tip_x_gx, point.tip_x_gy, point.tip_y_gx, point.tip_y_gy), step_x, step_y)
        force_x, force_y = _times(
            (point.force_x_gx, point.force_x_gy, point.force_y_gx, point.force_y_gy), step_x, step_y
        )
        share = weight / (12.0 * width)
        bend[0] += share * tip_x
        bend[1] += share * tip_y
        bend[2] += share * force_x
        bend[3] += share * force_y


@kernel
def _rod_at(legs: Array, g_x: float, g_y: float, work: Workspace, leg: int) -> RodPoint:
    length, clamp = legs[leg, LENGTH], work.clamps[leg]
    return placed(rod(g_x, g_y), length, legs[leg, STIFFNESS] / (length * length), clamp[2], clamp[3])


@formula
def _times(matrix: Derivatives, x: float, y: float) -> tuple[float, float]:
    return matrix[0] * x + matrix[1] * y, matrix[2] * x + matrix[3] * y


@kernel
def _third_derivative(legs: Array, motion: Array, driven: Array, driver: int, bends: Array, work: Workspace) -> float:
    """Return the third derivative of the energy along (motion, motion, driven), driven by the input of one leg."""
    pose = 2 * legs.shape[0]
    is_platform = motion.shape[0] - pose == 3
    turn, driven_turn = (motion[pose + 2], driven[pose + 2]) if is_platform else (0.0, 0.0)
    total = 0.0
    for j in range(legs.shape[0]):
        rod_row, bend = work.rods[j], bends[j]
        tip_g, force_g = derivatives(rod_row, TIP_G), derivatives(rod_row, FORCE_G)
        arm_x, arm_y, force_x, force_y = rod_row[ARM_X], rod_row[ARM_Y], rod_row[FORCE_X], rod_row[FORCE_Y]
        tip, pull = _times(tip_g, motion[2 * j], motion[2 * j + 1]), _times(force_g, motion[2 * j], motion[2 * j + 1])
        own_tip = _times(tip_g, driven[2 * j], driven[2 * j + 1])
        own_pull = _times(force_g, driven[2 * j], driven[2 * j + 1])
        clamp_turn = legs[j, TURN] if j == driver else 0.0
        total += bend[2] * own_tip[0] + bend[3] * own_tip[1] - bend[0] * own_pull[0] - bend[1] * own_pull[1]
        # the arm turns with the end-effector, the frame of the rod with its clamp
        total -= turn * turn * (arm_x * own_pull[0] + arm_y * own_pull[1])
        total -= 2.0 * turn * driven_turn * (arm_x * pull[0] + arm_y * pull[1])
        total -= 2.0 * clamp_turn * (pull[1] * tip[0] - pull[0] * tip[1])
        total -= turn * turn * (driven_turn - clamp_turn) * (arm_x * force_y - arm_y * force_x)
    return total
