"""Closure and equilibrium of any planar parallel continuum mechanism, and the linear systems they lead to.

A mechanism is a table with one row per leg (columns below); a revolute and a prismatic leg differ only in numbers.
All quantities are dimensionless: lengths in a reference length, forces in reference stiffness / length^2.

State vector x (2 n + d): per leg the load g seen from its tip (see `rod`), then the pose: (x, y) of a point
end-effector (d = 2) or (x, y, phi) of a platform (d = 3). Rows of the residual: per leg the two of
closure, B_i + p_i - (x, y) - Rot(phi) c_i, then the equilibrium of the end-effector, sum f_i - F, and about its
origin, sum (Rot(phi) c_i) x f_i - M.
"""

import math
from typing import NamedTuple

import numpy as np

from pcm_gym.arrays import Array
from pcm_gym.kernels.numerics.compilation import formula, kernel
from pcm_gym.kernels.numerics.linear import Symmetric, solve_linear, solve_symmetric
from pcm_gym.kernels.rods.rod import rod
from pcm_gym.kernels.statics.formulas import (
    Actuator,
    Derivatives,
    LegStiffness,
    Pair,
    added,
    balance_error,
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
    step_from_tip,
    stiffness_from,
    stiffness_share,
    turned,
)

# Columns of the leg table. The clamp is at base + input * axis and points along clamp_angle + input * turn.
BASE_X, BASE_Y, AXIS_X, AXIS_Y, CLAMP_ANGLE, TURN, LENGTH, STIFFNESS, ATTACH_X, ATTACH_Y, LOWER, UPPER = range(12)
LEG_COLUMNS = 12

# Columns of the rod table: tip from base and tip force, world frame; their derivatives by g (row by row); the rod's own
# index and mode; its arm Rot(phi) c, from the end-effector's origin to the hinge.
TIP_X, TIP_Y, FORCE_X, FORCE_Y, TIP_G, FORCE_G = 0, 1, 2, 3, 4, 8
DEAD_LOAD_INDEX, HALF_PERIODS, ARM_X, ARM_Y = range(12, 16)
_ROD_COLUMNS = 16

# Columns of the table of clamps: point, and cosine and sine of its angle.
CLAMP_X, CLAMP_Y, CLAMP_COS, CLAMP_SIN = range(4)
_CLAMP_COLUMNS = 4

# Columns of the legs' stiffness, d force / d tip.
STIFF_XX, STIFF_XY, STIFF_YY = range(3)
_STIFFNESS_COLUMNS = 3

# Nearer than this to a pole of its stiffness a rod is not condensed: rounding errors of its tip would come back as
# forces, multiplied by 1000.
CONDENSATION_LIMIT = 1e-6


class Workspace(NamedTuple):
    """Scratch arrays of one mechanism; a kernel that is called in a loop gets one from outside the loop."""

    clamps: Array  # (legs, 4): the table of clamps
    rods: Array  # (legs, 16): the rod table
    residual: Array  # (2 legs + d,)
    step: Array  # (2 legs + d,): solution of the last linear system
    matrix: Array  # (2 legs + d + 1, 2 legs + d + 1)
    vector: Array  # (2 legs + d + 1,)
    leg_stiffness: Array  # (legs, 3): d force / d tip


def new_workspace(leg_count: int, size: int) -> Workspace:
    """Return scratch arrays for `leg_count` legs and a state of `size` = 2 legs + d numbers."""
    return Workspace(
        np.zeros((leg_count, _CLAMP_COLUMNS)),
        np.zeros((leg_count, _ROD_COLUMNS)),
        np.zeros(size),
        np.zeros(size),
        np.zeros((size + 1, size + 1)),
        np.zeros(size + 1),
        np.zeros((leg_count, _STIFFNESS_COLUMNS)),
    )


# The same for kernels. Python must not ask a kernel for a named tuple: Numba cannot hand one over while a signal waits.
make_workspace = kernel(new_workspace)


@formula
def pair(row: Array, column: int) -> Pair:
    """Return the vector that stands in a row of a table from `column` on."""
    return row[column], row[column + 1]


@formula
def derivatives(row: Array, column: int) -> Derivatives:
    """Return the derivatives by g that stand in a row of a table from `column` on."""
    return row[column], row[column + 1], row[column + 2], row[column + 3]


@formula
def actuator_of(legs: Array, leg: int) -> Actuator:
    """Return the actuator of one leg."""
    return Actuator(pair(legs[leg], BASE_X), pair(legs[leg], AXIS_X), legs[leg, CLAMP_ANGLE], legs[leg, TURN])


@formula
def stiffness_of(work: Workspace, leg: int) -> LegStiffness:
    """Return d force / d tip of one leg."""
    own = work.leg_stiffness[leg]
    return own[STIFF_XX], own[STIFF_XY], own[STIFF_YY]


@kernel
def set_inputs(legs: Array, inputs: Array, work: Workspace) -> None:
    """Place the clamps for these actuator inputs."""
    clamps = work.clamps
    for i in range(legs.shape[0]):
        actuator = actuator_of(legs, i)
        angle = clamp_angle(actuator, inputs[i])
        clamps[i, CLAMP_X], clamps[i, CLAMP_Y] = clamp_point(actuator, inputs[i])
        clamps[i, CLAMP_COS], clamps[i, CLAMP_SIN] = math.cos(angle), math.sin(angle)


@kernel
def evaluate_rods(legs: Array, x: Array, work: Workspace) -> None:
    """Fill the rod table for the state `x`; the clamps must be set."""
    rods, pose = work.rods, 2 * legs.shape[0]
    turn = (1.0, 0.0)
    if x.shape[0] - pose == 3:
        turn = (math.cos(x[pose + 2]), math.sin(x[pose + 2]))
    for i in range(legs.shape[0]):
        rods[i, ARM_X], rods[i, ARM_Y] = turned(turn, pair(legs[i], ATTACH_X))
        length = legs[i, LENGTH]
        unit_force = force_unit(length, legs[i, STIFFNESS])
        point = placed(rod(x[2 * i], x[2 * i + 1]), length, unit_force, pair(work.clamps[i], CLAMP_COS))
        rods[i, TIP_X], rods[i, TIP_Y] = point.tip_x, point.tip_y
        rods[i, FORCE_X], rods[i, FORCE_Y] = point.force_x, point.force_y
        rods[i, TIP_G], rods[i, TIP_G + 1] = point.tip_x_gx, point.tip_x_gy
        rods[i, TIP_G + 2], rods[i, TIP_G + 3] = point.tip_y_gx, point.tip_y_gy
        rods[i, FORCE_G], rods[i, FORCE_G + 1] = point.force_x_gx, point.force_x_gy
        rods[i, FORCE_G + 2], rods[i, FORCE_G + 3] = point.force_y_gx, point.force_y_gy
        rods[i, DEAD_LOAD_INDEX] = point.dead_load_index
        rods[i, HALF_PERIODS] = point.half_periods


@kernel
def place(legs: Array, x: Array, inputs: Array, work: Workspace) -> None:
    """Fill the rod table of `work` for the state `x` at these inputs, clamps included: all that follows reads it."""
    set_inputs(legs, inputs, work)
    evaluate_rods(legs, x, work)


@kernel
def set_residual(legs: Array, x: Array, load: Array, work: Workspace) -> tuple[float, float]:
    """Fill `work.residual` from the rod table; return the largest closure error and the largest relative force error.

    The force error is relative to 1 + the largest rod force.
    """
    pose = 2 * legs.shape[0]
    dof = x.shape[0] - pose
    residual, rods, clamps = work.residual, work.rods, work.clamps
    closure_error, largest_force = 0.0, 0.0
    for d in range(dof):
        residual[pose + d] = -load[d]
    for i in range(legs.shape[0]):
        arm, force = pair(rods[i], ARM_X), pair(rods[i], FORCE_X)
        gap = hinge_gap(pair(clamps[i], CLAMP_X), pair(rods[i], TIP_X), pair(x, pose), arm)
        residual[2 * i], residual[2 * i + 1] = gap
        residual[pose] += force[0]
        residual[pose + 1] += force[1]
        if dof == 3:
            residual[pose + 2] += moment(arm, force)
        closure_error = larger(closure_error, gap)
        largest_force = larger(largest_force, force)
    if not math.isfinite(residual.sum()):  # max() drops a nan
        return math.inf, math.inf
    balance = (residual[pose], residual[pose + 1], residual[pose + 2] if dof == 3 else 0.0)
    return closure_error, balance_error(balance, largest_force)


@kernel
def set_leg_stiffness(legs: Array, work: Workspace) -> float:
    """Fill d force / d tip of each leg; return how far from a pole it is (see `pole_distance`), at the nearest leg."""
    nearest, own = math.inf, work.leg_stiffness
    for i in range(legs.shape[0]):
        tip_g, force_g = derivatives(work.rods[i], TIP_G), derivatives(work.rods[i], FORCE_G)
        nearest = min(nearest, pole_distance_from(tip_g))
        own[i, STIFF_XX], own[i, STIFF_XY], own[i, STIFF_YY] = stiffness_from(tip_g, force_g)
    return nearest


@kernel
def pole_distance(work: Workspace, leg: int) -> float:
    """Return how far a rod is from a pole of its stiffness, see `pole_distance_from`."""
    return pole_distance_from(derivatives(work.rods[leg], TIP_G))


@kernel
def stiffness(legs: Array, x: Array, work: Workspace) -> Symmetric:
    """Return the stiffness K of the end-effector from the legs' stiffness; of a point its upper left corner."""
    rods = work.rods
    found = Symmetric(0.0, 0.0, 0.0, 0.0, 0.0, own_turn_stiffness(x.shape[0] - 2 * legs.shape[0]))
    for i in range(legs.shape[0]):
        share = stiffness_share(stiffness_of(work, i), pair(rods[i], ARM_X), pair(rods[i], FORCE_X))
        found = added(found, share)
    return found


@kernel
def solve_equilibrium_system(legs: Array, x: Array, right: Array, work: Workspace) -> bool:
    """Solve J step = -right for the Jacobian J of the residual by x at the rod table; fill `work.step`.

    The rods are condensed onto the end-effector, so that its stiffness K is the only matrix. Where a rod's own
    stiffness has a pole (a straight rod, for one), K does not exist though J is regular: there the full system is
    solved. Returns False where the matrix is singular.
    """
    if set_leg_stiffness(legs, work) > CONDENSATION_LIMIT:
        return _solve_condensed(legs, x, right, work)
    return solve_whole_system(legs, x, right, work)


@kernel
def solve_whole_system(legs: Array, x: Array, right: Array, work: Workspace) -> bool:
    """Do the same without condensing the rods, which costs digits of their forces where they are stiff."""
    size = x.shape[0]
    set_matrix(legs, x, work)
    for row in range(size):
        work.vector[row] = -right[row]
    regular = solve_linear(work.matrix, work.vector, size)
    work.step[:] = work.vector[:size]
    return regular


@kernel
def _solve_condensed(legs: Array, x: Array, right: Array, work: Workspace) -> bool:
    pose = 2 * legs.shape[0]
    is_platform = x.shape[0] - pose == 3
    step, rods = work.step, work.rods
    force_x, force_y = -right[pose], -right[pose + 1]
    turning = -right[pose + 2] if is_platform else 0.0
    for i in range(legs.shape[0]):
        pull = condensed_pull(stiffness_of(work, i), pair(rods[i], ARM_X), pair(right, 2 * i))
        force_x += pull[0]
        force_y += pull[1]
        turning += pull[2]
    move = solve_symmetric(stiffness(legs, x, work), force_x, force_y, turning)
    step[pose], step[pose + 1] = move[0], move[1]
    if is_platform:
        step[pose + 2] = move[2]
    for i in range(legs.shape[0]):
        hinge = hinge_move(move, pair(rods[i], ARM_X))
        tip = (hinge[0] - right[2 * i], hinge[1] - right[2 * i + 1])
        step[2 * i], step[2 * i + 1] = step_from_tip(derivatives(rods[i], TIP_G), tip)
    return math.isfinite(move[0] + move[1] + move[2])


@kernel
def set_matrix(legs: Array, x: Array, work: Workspace) -> None:
    """Fill `work.matrix` with the full Jacobian of the residual by x."""
    pose, size = 2 * legs.shape[0], x.shape[0]
    matrix = work.matrix
    matrix[:size, :size] = 0.0
    for i in range(legs.shape[0]):
        _set_rod_columns(legs, x, work, i)
        arm_x, arm_y = work.rods[i, ARM_X], work.rods[i, ARM_Y]
        matrix[2 * i, pose] = -1.0
        matrix[2 * i + 1, pose + 1] = -1.0
        if size - pose == 3:
            matrix[2 * i, pose + 2] = arm_y
            matrix[2 * i + 1, pose + 2] = -arm_x
            matrix[pose + 2, pose + 2] -= arm_x * work.rods[i, FORCE_X] + arm_y * work.rods[i, FORCE_Y]


@kernel
def _set_rod_columns(legs: Array, x: Array, work: Workspace, leg: int) -> None:
    pose, matrix, rods = 2 * legs.shape[0], work.matrix, work.rods
    for j in range(2):
        column, force = 2 * leg + j, (rods[leg, FORCE_G + j], rods[leg, FORCE_G + 2 + j])
        matrix[2 * leg, column] = rods[leg, TIP_G + j]
        matrix[2 * leg + 1, column] = rods[leg, TIP_G + 2 + j]
        matrix[pose, column], matrix[pose + 1, column] = force
        if x.shape[0] - pose == 3:
            matrix[pose + 2, column] = moment(pair(rods[leg], ARM_X), force)


@kernel
def set_inverse_matrix(legs: Array, x: Array, work: Workspace) -> None:
    """Fill `work.matrix` with the Jacobian of the residual by (rods, inputs), the pose held."""
    pose, size = 2 * legs.shape[0], x.shape[0]
    matrix = work.matrix
    matrix[:size, :size] = 0.0
    for i in range(legs.shape[0]):
        _set_rod_columns(legs, x, work, i)
        add_input_derivative(legs, x, work, i, 1.0, matrix[:, pose + i])


@kernel
def add_input_derivative(legs: Array, x: Array, work: Workspace, leg: int, rate: float, out: Array) -> None:
    """Add to `out` the derivative of the residual by the input of one leg, times `rate`."""
    pose, rod_row = 2 * legs.shape[0], work.rods[leg]
    hinge, pull = input_rate(actuator_of(legs, leg), rate, pair(rod_row, TIP_X), pair(rod_row, FORCE_X))
    out[2 * leg] += hinge[0]
    out[2 * leg + 1] += hinge[1]
    out[pose] += pull[0]
    out[pose + 1] += pull[1]
    if x.shape[0] - pose == 3:
        out[pose + 2] += moment(pair(rod_row, ARM_X), pull)


@kernel
def set_path_derivative(
    legs: Array, x: Array, input_rate: Array, load_rate: Array, work: Workspace, out: Array
) -> None:
    """Fill `out` with the derivative of the residual along a line in (inputs, load) at the rod table."""
    pose = 2 * legs.shape[0]
    out[:] = 0.0
    for i in range(legs.shape[0]):
        add_input_derivative(legs, x, work, i, input_rate[i], out)
    for d in range(x.shape[0] - pose):
        out[pose + d] -= load_rate[d]
