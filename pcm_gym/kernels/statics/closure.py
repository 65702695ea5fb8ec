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
from pcm_gym.kernels.rods.rod import RodPoint, rod

# Derivatives of a vector (x, y) by g: of x by g_x and g_y, of y by g_x and g_y.
Derivatives = tuple[float, float, float, float]

# Columns of the leg table. The clamp is at base + input * axis and points along clamp_angle + input * turn.
BASE_X, BASE_Y, AXIS_X, AXIS_Y, CLAMP_ANGLE, TURN, LENGTH, STIFFNESS, ATTACH_X, ATTACH_Y, LOWER, UPPER = range(12)
LEG_COLUMNS = 12

# Columns of the rod table: tip from base and tip force, world frame; their derivatives by g (row by row); the rod's own
# index and mode; its arm Rot(phi) c, from the end-effector's origin to the hinge.
TIP_X, TIP_Y, FORCE_X, FORCE_Y, TIP_G, FORCE_G = 0, 1, 2, 3, 4, 8
DEAD_LOAD_INDEX, HALF_PERIODS, ARM_X, ARM_Y = range(12, 16)
_ROD_COLUMNS = 16

# Nearer than this to a pole of its stiffness a rod is not condensed: rounding errors of its tip would come back as
# forces, multiplied by 1000.
CONDENSATION_LIMIT = 1e-6


class Workspace(NamedTuple):
    """Scratch arrays of one mechanism; a kernel that is called in a loop gets one from outside the loop."""

    clamps: Array  # (legs, 4): clamp point and cosine, sine of the clamp's angle
    rods: Array  # (legs, 16): the rod table
    residual: Array  # (2 legs + d,)
    step: Array  # (2 legs + d,): solution of the last linear system
    matrix: Array  # (2 legs + d + 1, 2 legs + d + 1)
    vector: Array  # (2 legs + d + 1,)
    leg_stiffness: Array  # (legs, 3): xx, xy, yy of d force / d tip


@kernel
def make_workspace(leg_count: int, size: int) -> Workspace:
    """Return scratch arrays for `leg_count` legs and a state of `size` = 2 legs + d numbers."""
    return Workspace(
        np.zeros((leg_count, 4)),
        np.zeros((leg_count, _ROD_COLUMNS)),
        np.zeros(size),
        np.zeros(size),
        np.zeros((size + 1, size + 1)),
        np.zeros(size + 1),
        np.zeros((leg_count, 3)),
    )


@kernel
def set_inputs(legs: Array, inputs: Array, work: Workspace) -> None:
    """Place the clamps for these actuator inputs."""
    clamps = work.clamps
    for i in range(legs.shape[0]):
        angle = legs[i, CLAMP_ANGLE] + legs[i, TURN] * inputs[i]
        clamps[i, 0] = legs[i, BASE_X] + legs[i, AXIS_X] * inputs[i]
        clamps[i, 1] = legs[i, BASE_Y] + legs[i, AXIS_Y] * inputs[i]
        clamps[i, 2] = math.cos(angle)
        clamps[i, 3] = math.sin(angle)


@kernel
def evaluate_rods(legs: Array, x: Array, work: Workspace) -> None:
    """Fill the rod table for the state `x`; the clamps must be set."""
    clamps, rods, pose = work.clamps, work.rods, 2 * legs.shape[0]
    turn_c, turn_s = 1.0, 0.0
    if x.shape[0] - pose == 3:
        turn_c, turn_s = math.cos(x[pose + 2]), math.sin(x[pose + 2])
    for i in range(legs.shape[0]):
        rods[i, ARM_X] = turn_c * legs[i, ATTACH_X] - turn_s * legs[i, ATTACH_Y]
        rods[i, ARM_Y] = turn_s * legs[i, ATTACH_X] + turn_c * legs[i, ATTACH_Y]
        length = legs[i, LENGTH]
        unit_force = legs[i, STIFFNESS] / (length * length)
        point = placed(rod(x[2 * i], x[2 * i + 1]), length, unit_force, clamps[i, 2], clamps[i, 3])
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


@formula
def turned(c: float, s: float, x: float, y: float) -> tuple[float, float]:
    """Return the vector (x, y) turned by the angle with cosine c and sine s, or the scaled vector if c, s are."""
    return c * x - s * y, s * x + c * y


@formula
def placed(point: RodPoint, length: float, unit_force: float, c: float, s: float) -> RodPoint:
    """Return what a rod does in the world frame and its units, clamped at the angle with cosine c and sine s."""
    tip_c, tip_s, force_c, force_s = length * c, length * s, unit_force * c, unit_force * s
    tip_x, tip_y = turned(tip_c, tip_s, point.tip_x, point.tip_y)
    force_x, force_y = turned(force_c, force_s, point.force_x, point.force_y)
    tip_x_gx, tip_y_gx = turned(tip_c, tip_s, point.tip_x_gx, point.tip_y_gx)
    tip_x_gy, tip_y_gy = turned(tip_c, tip_s, point.tip_x_gy, point.tip_y_gy)
    force_x_gx, force_y_gx = turned(force_c, force_s, point.force_x_gx, point.force_y_gx)
    force_x_gy, force_y_gy = turned(force_c, force_s, point.force_x_gy, point.force_y_gy)
    return RodPoint(
        tip_x,
        tip_y,
        force_x,
        force_y,
        tip_x_gx,
        tip_x_gy,
        tip_y_gx,
        tip_y_gy,
        force_x_gx,
        force_x_gy,
        force_y_gx,
        force_y_gy,
        point.dead_load_index,
        point.half_periods,
    )


@kernel
def set_residual(legs: Array, x: Array, load: Array, work: Workspace) -> tuple[float, float]:
    """Fill `work.residual` from the rod table; return the largest closure error and the largest relative force error.

    The force error is relative to 1 + the largest rod force.
    """
    leg_count, pose = legs.shape[0], 2 * legs.shape[0]
    dof = x.shape[0] - pose
    residual, rods, clamps = work.residual, work.rods, work.clamps
    closure_error, largest_force = 0.0, 0.0
    for d in range(dof):
        residual[pose + d] = -load[d]
    for i in range(leg_count):
        arm_x, arm_y = work.rods[i, ARM_X], work.rods[i, ARM_Y]
        force_x, force_y = rods[i, FORCE_X], rods[i, FORCE_Y]
        residual[2 * i] = clamps[i, 0] + rods[i, TIP_X] - x[pose] - arm_x
        residual[2 * i + 1] = clamps[i, 1] + rods[i, TIP_Y] - x[pose + 1] - arm_y
        residual[pose] += force_x
        residual[pose + 1] += force_y
        if dof == 3:
            residual[pose + 2] += arm_x * force_y - arm_y * force_x
        closure_error = max(closure_error, abs(residual[2 * i]), abs(residual[2 * i + 1]))
        largest_force = max(largest_force, abs(force_x), abs(force_y))
    force_error = 0.0
    for d in range(dof):
        force_error = max(force_error, abs(residual[pose + d]))
    if not math.isfinite(residual.sum()):  # max() drops a nan
        return math.inf, math.inf
    return closure_error, force_error / (1.0 + largest_force)


@kernel
def set_leg_stiffness(legs: Array, work: Workspace) -> float:
    """Fill d force / d tip of each leg; return how far from a pole it is (see `pole_distance`), at the nearest leg."""
    nearest, leg_stiffness = math.inf, work.leg_stiffness
    for i in range(legs.shape[0]):
        tip_g, force_g = derivatives(work.rods[i], TIP_G), derivatives(work.rods[i], FORCE_G)
        nearest = min(nearest, pole_distance_from(tip_g))
        leg_stiffness[i, 0], leg_stiffness[i, 1], leg_stiffness[i, 2] = stiffness_from(tip_g, force_g)
    return nearest


@formula
def derivatives(rod_row: Array, column: int) -> Derivatives:
    """Return the derivatives by g that stand in a row of the rod table from `column` on."""
    return rod_row[column], rod_row[column + 1], rod_row[column + 2], rod_row[column + 3]


@formula
def stiffness_from(tip_g: Derivatives, force_g: Derivatives) -> tuple[float, float, float]:
    """Return d force / d tip of one rod, xx, xy, yy."""
    p_xx, p_xy, p_yx, p_yy = tip_g
    q_xx, q_xy, q_yx, q_yy = force_g
    inverse = 1.0 / (p_xx * p_yy - p_xy * p_yx)
    return (
        (q_xx * p_yy - q_xy * p_yx) * inverse,
        0.5 * (q_xy * p_xx - q_xx * p_xy + q_yx * p_yy - q_yy * p_yx) * inverse,
        (q_yy * p_xx - q_yx * p_xy) * inverse,
    )


@kernel
def pole_distance(work: Workspace, leg: int) -> float:
    """Return the squared sine of the angle between the two columns of d tip / d g; 0 at a pole of d force / d tip."""
    return pole_distance_from(derivatives(work.rods[leg], TIP_G))


@formula
def pole_distance_from(tip_g: Derivatives) -> float:
    """Return `pole_distance` from the derivatives of the tip."""
    p_xx, p_xy, p_yx, p_yy = tip_g
    determinant = p_xx * p_yy - p_xy * p_yx
    first, second = p_xx * p_xx + p_yx * p_yx, p_xy * p_xy + p_yy * p_yy
    # a column of rounding errors has a direction of its own: it counts as at least a 1e-8 of the other
    least = 1e-16 * max(first, second)
    columns = max(first, least) * max(second, least)
    return determinant * determinant / columns if columns > 0.0 else 0.0


@kernel
def stiffness(legs: Array, x: Array, work: Workspace) -> Symmetric:
    """Return K = sum D' A D - diag(0, 0, sum (Rot(phi) c) . f) from the legs' stiffness A.

    A point end-effector, which cannot turn, is given a turn of its own with stiffness 1.
    """
    rods, leg_stiffness = work.rods, work.leg_stiffness
    xx = xy = yy = xz = yz = 0.0
    zz = 0.0 if x.shape[0] - 2 * legs.shape[0] == 3 else 1.0
    for i in range(legs.shape[0]):
        own = (leg_stiffness[i, 0], leg_stiffness[i, 1], leg_stiffness[i, 2])
        share = stiffness_share(own, rods[i, ARM_X], rods[i, ARM_Y], rods[i, FORCE_X], rods[i, FORCE_Y])
        xx += share.xx
        xy += share.xy
        yy += share.yy
        xz += share.xz
        yz += share.yz
        zz += share.zz
    return Symmetric(xx, xy, yy, xz, yz, zz)


@formula
def stiffness_share(
    leg_stiffness: tuple[float, float, float], arm_x: float, arm_y: float, force_x: float, force_y: float
) -> Symmetric:
    """Return what one leg adds to the stiffness of the end-effector."""
    a_xx, a_xy, a_yy = leg_stiffness
    turn_x, turn_y = a_xy * arm_x - a_xx * arm_y, a_yy * arm_x - a_xy * arm_y
    zz = arm_x * turn_y - arm_y * turn_x - arm_x * force_x - arm_y * force_y
    return Symmetric(a_xx, a_xy, a_yy, turn_x, turn_y, zz)


@kernel
def solve_equilibrium_system(legs: Array, x: Array, right: Array, work: Workspace) -> bool:
    """Solve J step = -right for the Jacobian J of the residual by x at the rod table; fill `work.step`.

    The rods are condensed onto the end-effector, so that its stiffness K is the only matrix. Where a rod's own
    stiffness has a pole (a straight rod, for one), K does not exist though J is regular: there the full system is
    solved. Returns False where the matrix is singular.
    """
    if set_leg_stiffness(legs, work) > CONDENSATION_LIMIT:
        return _solve_condensed(legs, x, right, work)
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
    step, rods, leg_stiffness = work.step, work.rods, work.leg_stiffness
    force_x, force_y = -right[pose], -right[pose + 1]
    moment = -right[pose + 2] if is_platform else 0.0
    for i in range(legs.shape[0]):
        own = (leg_stiffness[i, 0], leg_stiffness[i, 1], leg_stiffness[i, 2])
        pull = condensed_pull(own, rods[i, ARM_X], rods[i, ARM_Y], right[2 * i], right[2 * i + 1])
        force_x += pull[0]
        force_y += pull[1]
        moment += pull[2]
    matrix = stiffness(legs, x, work)
    move_x, move_y, turn = solve_symmetric(matrix, force_x, force_y, moment)
    step[pose], step[pose + 1] = move_x, move_y
    if is_platform:
        step[pose + 2] = turn
    for i in range(legs.shape[0]):
        tip_x = move_x - rods[i, ARM_Y] * turn - right[2 * i]
        tip_y = move_y + rods[i, ARM_X] * turn - right[2 * i + 1]
        step[2 * i], step[2 * i + 1] = step_from_tip(derivatives(rods[i], TIP_G), tip_x, tip_y)
    return math.isfinite(move_x + move_y + turn)


@formula
def condensed_pull(
    leg_stiffness: tuple[float, float, float], arm_x: float, arm_y: float, right_x: float, right_y: float
) -> tuple[float, float, float]:
    """Return the force and moment on the end-effector of one leg whose hinge is moved by (right_x, right_y)."""
    a_xx, a_xy, a_yy = leg_stiffness
    pull_x, pull_y = a_xx * right_x + a_xy * right_y, a_xy * right_x + a_yy * right_y
    return pull_x, pull_y, arm_x * pull_y - arm_y * pull_x


@formula
def step_from_tip(tip_g: Derivatives, tip_x: float, tip_y: float) -> tuple[float, float]:
    """Return the step of g that moves the tip by (tip_x, tip_y)."""
    p_xx, p_xy, p_yx, p_yy = tip_g
    inverse = 1.0 / (p_xx * p_yy - p_xy * p_yx)
    return (p_yy * tip_x - p_xy * tip_y) * inverse, (p_xx * tip_y - p_yx * tip_x) * inverse


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
    pose = 2 * legs.shape[0]
    arm_x, arm_y = work.rods[leg, ARM_X], work.rods[leg, ARM_Y]
    matrix, rods = work.matrix, work.rods
    for j in range(2):
        column = 2 * leg + j
        matrix[2 * leg, column] = rods[leg, TIP_G + j]
        matrix[2 * leg + 1, column] = rods[leg, TIP_G + 2 + j]
        matrix[pose, column] = rods[leg, FORCE_G + j]
        matrix[pose + 1, column] = rods[leg, FORCE_G + 2 + j]
        if x.shape[0] - pose == 3:
            matrix[pose + 2, column] = arm_x * rods[leg, FORCE_G + 2 + j] - arm_y * rods[leg, FORCE_G + j]


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
    pose = 2 * legs.shape[0]
    rods, turn = work.rods, rate * legs[leg, TURN]
    pull_x, pull_y = -turn * rods[leg, FORCE_Y], turn * rods[leg, FORCE_X]
    out[2 * leg] += rate * legs[leg, AXIS_X] - turn * rods[leg, TIP_Y]
    out[2 * leg + 1] += rate * legs[leg, AXIS_Y] + turn * rods[leg, TIP_X]
    out[pose] += pull_x
    out[pose + 1] += pull_y
    if x.shape[0] - pose == 3:
        arm_x, arm_y = work.rods[leg, ARM_X], work.rods[leg, ARM_Y]
        out[pose + 2] += arm_x * pull_y - arm_y * pull_x


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
