"""The whole rods of a mechanism in overdamped motion, discretised: their energy, and implicit steps down it.

A rod is the angle of its tangent at the Gauss points of its arc: a polynomial that starts at the clamp's angle. It
moves through a viscous medium that resists each piece of it alike, in all directions; it has no mass, and the
end-effector neither mass nor drag. Time is in units of drag times L^4 / EI. A step of the implicit Euler method over
the time 1 / hardness is the minimum, under the constraints of closure, of the functional

    energy + hardness / 2 times the integral over all rods of |r - r_start|^2,    r: the points of the rods,

found by Newton's method on its Lagrangian. So the energy falls in every step, however long.
"""

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.polynomial import legendre

from pcm_gym.arrays import Array
from pcm_gym.kernels.numerics.compilation import kernel
from pcm_gym.kernels.numerics.linear import Symmetric, solve_symmetric
from pcm_gym.kernels.rods.rod import rod
from pcm_gym.kernels.statics.closure import (
    ARM_X,
    ARM_Y,
    ATTACH_X,
    CLAMP_COS,
    CLAMP_X,
    DEAD_LOAD_INDEX,
    FORCE_X,
    FORCE_Y,
    LENGTH,
    STIFF_XX,
    STIFF_XY,
    STIFF_YY,
    STIFFNESS,
    Workspace,
    evaluate_rods,
    pair,
    stiffness_of,
)
from pcm_gym.kernels.statics.formulas import (
    condensed_pull,
    force_unit,
    hinge_gap,
    hinge_move,
    moment,
    pull_of,
    scaled,
    turned,
)
from pcm_gym.kernels.statics.newton import contracts
from pcm_gym.kernels.statics.stability import Stability, judge_stiffness

# Rows of the table of a rod's nodes: the tangent's angle from the clamp's, its cosine and sine in the world; all three
# at the start of the step; drag and tip force on the rod beyond the node, times the node's weight; the bending matrix
# times the angles; the rate of the angle; and the angle's part in a direction of interest.
ANGLE, COSINE, SINE, START_ANGLE, START_COSINE, START_SINE, PULL_X, PULL_Y, MOMENT, RATE, DIRECTION = range(11)
_NODE_ROWS = 11
# Rows of the tables of forces and poses: the present ones, those at the start of the step, their change.
NOW, START, CHANGE = range(3)

_MOST_CORRECTIONS, _LAST_CORRECTION = 8, 1e-6
# A correction of an angle, rad, and its ratio to the one before, beyond which Newton's method is given up. It may rise
# once: the first correction also has to find the forces. Of small corrections the ratio says nothing.
_LARGEST_CORRECTION, _LARGEST_RISE, _SMALL_CORRECTION = 0.5, 2.0, 0.01


class Grid(NamedTuple):
    """Calculus on the Gauss points of the unit interval."""

    nodes: Array  # (n,)
    weights: Array  # (n,)
    integral: Array  # (n, n): from 0 to each node
    drag: Array  # (n, n): integral' weights integral
    bending: Array  # (n, n): the integral of the squared slope of a polynomial that is 0 at 0
    end: Array  # (n,): value at 1 of a polynomial that is 0 at 0


class MovingRods(NamedTuple):
    """A mechanism's rods in motion: scratch arrays."""

    grid: Grid
    rods: Array  # (legs, 11, n): the table of the nodes
    forces: Array  # (3, legs, 2): of the end-effector on the tips
    pose: Array  # (3, d)
    gaps: Array  # (legs, 2): tip less hinge
    matrix: Array  # (legs, n, n): second derivative of the functional by the angles, then its factors
    right: Array  # (legs, 3, n): right sides, then solutions: of the motion, of a tip force along x, along y
    x: Array  # (size,): a state
    energies: Array  # (steps + 1,): at the start and after each step


@lru_cache(maxsize=8)
def make_grid(count: int) -> Grid:
    """Return the calculus on `count` Gauss points, in arrays that cannot be written."""
    points, weights = legendre.leggauss(count)
    weights = 0.5 * weights
    scale = np.sqrt(2.0 * np.arange(count) + 1.0)  # of the polynomials that are orthonormal on (0, 1)
    values = legendre.legvander(points, count - 1) * scale
    antiderivatives = 0.5 * scale[:, None] * np.array([legendre.legint(row, lbnd=-1.0) for row in np.eye(count)])
    integrals = legendre.legval(np.append(points, 1.0), antiderivatives.T).T
    integral = integrals[:-1] @ (values.T * weights)
    inverse = np.linalg.inv(integrals[:-1])
    grid = Grid(
        nodes=0.5 * (points + 1.0),
        weights=weights,
        integral=integral,
        drag=integral.T @ (weights[:, None] * integral),
        bending=inverse.T @ inverse,
        end=integrals[-1] @ inverse,
    )
    for array in grid:
        array.setflags(write=False)
    return grid


@kernel
def make_moving_rods(grid: Grid, leg_count: int, size: int, steps: int) -> MovingRods:
    """Return scratch arrays for `leg_count` legs, a state of `size` = 2 legs + d numbers and this many steps."""
    nodes = grid.nodes.shape[0]
    return MovingRods(
        grid,
        np.zeros((leg_count, _NODE_ROWS, nodes)),
        np.zeros((3, leg_count, 2)),
        np.zeros((3, size - 2 * leg_count)),
        np.zeros((leg_count, 2)),
        np.zeros((leg_count, nodes, nodes)),
        np.zeros((leg_count, 3, nodes)),
        np.zeros(size),
        np.zeros(steps + 1),
    )


@kernel
def set_rods(legs: Array, x: Array, moving: MovingRods, work: Workspace) -> None:
    """Put the rods, forces and pose of the state `x` into the tables, at rest; the clamps must be set.

    A rod's curvature is the moment of its tip force. The part beyond a cut is itself a rod, see `rod.rod_shape`.
    """
    evaluate_rods(legs, x, work)
    moving.pose[NOW] = x[2 * legs.shape[0] :]
    count = moving.grid.nodes.shape[0]
    for i in range(legs.shape[0]):
        moving.forces[NOW, i, 0], moving.forces[NOW, i, 1] = work.rods[i, FORCE_X], work.rods[i, FORCE_Y]
        angle = moving.rods[i, ANGLE]
        angle[:] = 0.0
        for q in range(count):
            part = 1.0 - moving.grid.nodes[q]
            cut = rod(part * part * x[2 * i], part * part * x[2 * i + 1])
            curvature = (cut.tip_x * cut.force_y - cut.tip_y * cut.force_x) / part
            for p in range(count):
                angle[p] += moving.grid.integral[p, q] * curvature
        moving.rods[i, RATE] = 0.0


@kernel
def tip_angle(moving: MovingRods, leg: int, row: int) -> float:
    """Return the value at a rod's tip of what a row of the table holds at its nodes, 0 at the clamp."""
    value = 0.0
    for q in range(moving.grid.end.shape[0]):
        value += moving.grid.end[q] * moving.rods[leg, row, q]
    return value


@kernel
def tip_load(legs: Array, leg: int, moving: MovingRods, work: Workspace) -> tuple[float, float]:
    """Return the load g that a rod's tip sees, the rod's state in `rod`."""
    turn = tip_angle(moving, leg, ANGLE)
    c, s = turned(pair(work.clamps[leg], CLAMP_COS), (math.cos(turn), math.sin(turn)))
    unit = 1.0 / force_unit(legs[leg, LENGTH], legs[leg, STIFFNESS])
    return turned((c, -s), scaled(unit, pair(moving.forces[NOW, leg], 0)))


@kernel
def energy_of(legs: Array, load: Array, moving: MovingRods) -> float:
    """Return the rods' bending energy less the work of the load on the end-effector."""
    energy = 0.0
    for i in range(legs.shape[0]):
        rods = moving.rods[i]
        _multiply(moving.grid.bending, rods[ANGLE], rods[MOMENT])
        for q in range(rods.shape[1]):
            energy += 0.5 * legs[i, STIFFNESS] / legs[i, LENGTH] * rods[ANGLE, q] * rods[MOMENT, q]
    for d in range(load.shape[0]):
        energy -= load[d] * moving.pose[NOW, d]
    return energy


@kernel
def start_step(legs: Array, time: float, moving: MovingRods, work: Workspace) -> None:
    """Keep the present state as the start of a step, and move the rods on as they moved before."""
    _copy_tip_forces_and_pose(moving, NOW, START)
    for i in range(legs.shape[0]):
        _set_tangents(legs, i, moving, work)
        rods = moving.rods[i]
        for q in range(rods.shape[1]):
            rods[START_ANGLE, q] = rods[ANGLE, q]
            rods[START_COSINE, q], rods[START_SINE, q] = rods[COSINE, q], rods[SINE, q]
            rods[ANGLE, q] += time * rods[RATE, q]


@kernel
def undo_step(moving: MovingRods) -> None:
    """Go back to the start of the step."""
    _copy_tip_forces_and_pose(moving, START, NOW)
    for i in range(moving.rods.shape[0]):
        for q in range(moving.rods.shape[2]):
            moving.rods[i, ANGLE, q] = moving.rods[i, START_ANGLE, q]


@kernel
def _copy_tip_forces_and_pose(moving: MovingRods, source: int, target: int) -> None:
    for i in range(moving.forces.shape[1]):
        for d in range(2):
            moving.forces[target, i, d] = moving.forces[source, i, d]
    for d in range(moving.pose.shape[1]):
        moving.pose[target, d] = moving.pose[source, d]


@kernel
def set_rate(time: float, moving: MovingRods) -> None:
    """Fill the rate of the angles over the step."""
    for i in range(moving.rods.shape[0]):
        for q in range(moving.rods.shape[2]):
            moving.rods[i, RATE, q] = (moving.rods[i, ANGLE, q] - moving.rods[i, START_ANGLE, q]) / time


@kernel
def measure_step(time: float, moving: MovingRods) -> tuple[float, float]:
    """Return the step's error, half its difference from going on as before, and its movement, both in rad."""
    error, movement = 0.0, 0.0
    for i in range(moving.rods.shape[0]):
        rods = moving.rods[i]
        for q in range(rods.shape[1]):
            moved = rods[ANGLE, q] - rods[START_ANGLE, q]
            movement = max(movement, abs(moved))
            error = max(error, 0.5 * abs(moved - time * rods[RATE, q]))
    return error, movement


@kernel
def find_minimum(legs: Array, load: Array, hardness: float, moving: MovingRods, work: Workspace) -> bool:
    """Find the end of the step by Newton's method; return whether it is a minimum.

    Where the functional is not convex the step is too long: an unstable motion grows faster than that.
    """
    previous = math.inf
    for _ in range(_MOST_CORRECTIONS):
        verdict = factorise_at(legs, load, hardness, moving, work)
        if verdict.morse_index > 0:
            return False
        solve_factorised(legs, verdict.stiffness, moving, work)
        size = 0.0
        for i in range(legs.shape[0]):
            for q in range(moving.right.shape[2]):
                change = moving.right[i, 0, q]
                moving.rods[i, ANGLE, q] += change
                size = max(size, abs(change)) if math.isfinite(change) else math.inf
            moving.forces[NOW, i, 0] += moving.forces[CHANGE, i, 0]
            moving.forces[NOW, i, 1] += moving.forces[CHANGE, i, 1]
        for d in range(load.shape[0]):
            moving.pose[NOW, d] += moving.pose[CHANGE, d]
        if size < _LAST_CORRECTION:
            return True
        if size > _LARGEST_CORRECTION or not contracts(size, previous, _LARGEST_RISE, _SMALL_CORRECTION):
            return False
        previous = size
    return False


@kernel
def factorise_at(legs: Array, load: Array, hardness: float, moving: MovingRods, work: Workspace) -> Stability:
    """Assemble and factorise Newton's system of the functional; return the verdict on it.

    Its index is the number of directions, under the constraints, in which the functional is not convex: made up as in
    `stability`, from the rods' own, at free tips, and the stiffness of their tips.
    """
    right = moving.pose[CHANGE]
    right[:] = load
    for i in range(legs.shape[0]):
        _assemble(legs, i, hardness, moving, work)
        work.rods[i, DEAD_LOAD_INDEX] = _factorise(moving.matrix[i])
        _condense(legs, i, moving, work)
        force = pair(moving.forces[NOW, i], 0)
        right[0] -= force[0]
        right[1] -= force[1]
        if right.shape[0] == 3:
            right[2] -= moment(pair(work.rods[i], ARM_X), force)
    return judge_stiffness(legs, moving.x, work)


@kernel
def solve_factorised(legs: Array, stiffness: Symmetric, moving: MovingRods, work: Workspace) -> None:
    """Solve the factorised system, in place, for the right sides of the rods (row 0), gaps and pose (`CHANGE`)."""
    change, force = moving.pose[CHANGE], moving.forces[CHANGE]
    push_x, push_y, turning = change[0], change[1], (change[2] if change.shape[0] == 3 else 0.0)
    for i in range(legs.shape[0]):
        right, length = moving.right[i, 0], legs[i, LENGTH]
        _substitute(moving.matrix[i], right)
        gap_x, gap_y = moving.gaps[i, 0], moving.gaps[i, 1]
        for q in range(right.shape[0]):
            gap_x -= length * moving.grid.weights[q] * moving.rods[i, SINE, q] * right[q]
            gap_y += length * moving.grid.weights[q] * moving.rods[i, COSINE, q] * right[q]
        pull = condensed_pull(stiffness_of(work, i), pair(work.rods[i], ARM_X), (-gap_x, -gap_y))
        force[i, 0], force[i, 1] = pull[0], pull[1]
        push_x -= pull[0]
        push_y -= pull[1]
        turning -= pull[2]
    move = solve_symmetric(stiffness, push_x, push_y, turning)
    change[0], change[1] = move[0], move[1]
    if change.shape[0] == 3:
        change[2] = move[2]
    for i in range(legs.shape[0]):
        more = pull_of(stiffness_of(work, i), hinge_move(move, pair(work.rods[i], ARM_X)))
        force[i, 0] += more[0]
        force[i, 1] += more[1]
        for q in range(moving.right.shape[2]):
            moving.right[i, 0, q] += moving.right[i, 1, q] * force[i, 0] + moving.right[i, 2, q] * force[i, 1]


@kernel
def scale_direction(legs: Array, moving: MovingRods) -> None:
    """Scale the motion in the row `DIRECTION` to a root mean square of 1; put its drag on the right side."""
    squared, total = 0.0, 0.0
    count = moving.grid.nodes.shape[0]
    for i in range(legs.shape[0]):
        rods, right = moving.rods[i], moving.right[i, 0]
        cube = legs[i, LENGTH] ** 3
        for p in range(count):
            along, across = 0.0, 0.0
            for q in range(count):
                weight = moving.grid.drag[p, q] * rods[DIRECTION, q]
                along += weight * rods[COSINE, q]
                across += weight * rods[SINE, q]
            right[p] = cube * (along * rods[COSINE, p] + across * rods[SINE, p])
            squared += right[p] * rods[DIRECTION, p]
        total += legs[i, LENGTH]
    scale = math.sqrt(total / squared)
    for i in range(legs.shape[0]):
        for q in range(count):
            moving.rods[i, DIRECTION, q] *= scale
            moving.right[i, 0, q] *= scale


@kernel
def _set_tangents(legs: Array, leg: int, moving: MovingRods, work: Workspace) -> None:
    """Fill the tangents of a rod from its angles, its gap, and force and arm in the rod table."""
    rods, length, pose = moving.rods[leg], legs[leg, LENGTH], moving.pose[NOW]
    clamp = pair(work.clamps[leg], CLAMP_COS)
    tip_x, tip_y = 0.0, 0.0
    for q in range(rods.shape[1]):
        rods[COSINE, q], rods[SINE, q] = turned(clamp, (math.cos(rods[ANGLE, q]), math.sin(rods[ANGLE, q])))
        tip_x += length * moving.grid.weights[q] * rods[COSINE, q]
        tip_y += length * moving.grid.weights[q] * rods[SINE, q]
    turn = (math.cos(pose[2]), math.sin(pose[2])) if pose.shape[0] == 3 else (1.0, 0.0)
    arm = turned(turn, pair(legs[leg], ATTACH_X))
    work.rods[leg, ARM_X], work.rods[leg, ARM_Y] = arm
    work.rods[leg, FORCE_X], work.rods[leg, FORCE_Y] = moving.forces[NOW, leg, 0], moving.forces[NOW, leg, 1]
    gap = hinge_gap(pair(work.clamps[leg], CLAMP_X), (tip_x, tip_y), pair(pose, 0), arm)
    moving.gaps[leg, 0], moving.gaps[leg, 1] = gap


@kernel
def _multiply(matrix: Array, vector: Array, out: Array) -> None:
    """Fill `out` with a symmetric matrix times a vector, row by row, which the compiler can vectorise."""
    out[:] = 0.0
    for p in range(vector.shape[0]):
        for q in range(vector.shape[0]):
            out[q] += matrix[p, q] * vector[p]


@kernel
def _assemble(legs: Array, leg: int, hardness: float, moving: MovingRods, work: Workspace) -> None:
    """Fill matrix and right sides of a rod: the functional's second derivative and minus its first, by the angles."""
    _set_tangents(legs, leg, moving, work)
    rods, matrix, right, weights = moving.rods[leg], moving.matrix[leg], moving.right[leg], moving.grid.weights
    cosine, sine, pull_x, pull_y = rods[COSINE], rods[SINE], rods[PULL_X], rods[PULL_Y]
    length = legs[leg, LENGTH]
    bending, drag = legs[leg, STIFFNESS] / length, hardness * length**3
    for q in range(weights.shape[0]):  # rows of the solution as scratch: how the tangents changed
        right[1, q], right[2, q] = cosine[q] - rods[START_COSINE, q], sine[q] - rods[START_SINE, q]
    _multiply(moving.grid.drag, right[1], pull_x)
    _multiply(moving.grid.drag, right[2], pull_y)
    _multiply(moving.grid.bending, rods[ANGLE], rods[MOMENT])
    for p in range(weights.shape[0]):
        part = length * weights[p]
        pull_x[p] = drag * pull_x[p] - part * moving.forces[NOW, leg, 0]
        pull_y[p] = drag * pull_y[p] - part * moving.forces[NOW, leg, 1]
        right[0, p] = sine[p] * pull_x[p] - cosine[p] * pull_y[p] - bending * rods[MOMENT, p]
        right[1, p], right[2, p] = -part * sine[p], part * cosine[p]
        along, across = drag * cosine[p], drag * sine[p]
        for q in range(p, weights.shape[0]):
            turn = along * cosine[q] + across * sine[q]
            matrix[p, q] = bending * moving.grid.bending[p, q] + moving.grid.drag[p, q] * turn
        matrix[p, p] -= cosine[p] * pull_x[p] + sine[p] * pull_y[p]


@kernel
def _condense(legs: Array, leg: int, moving: MovingRods, work: Workspace) -> None:
    """Solve for the rod's answers to tip forces along x and y; fill its `leg_stiffness` from them."""
    rods, right = moving.rods[leg], moving.right[leg]
    _substitute(moving.matrix[leg], right[1])
    _substitute(moving.matrix[leg], right[2])
    c_xx = c_xy = c_yy = 0.0
    for q in range(rods.shape[1]):
        part = legs[leg, LENGTH] * moving.grid.weights[q]
        c_xx -= part * rods[SINE, q] * right[1, q]
        c_xy -= part * rods[SINE, q] * right[2, q]
        c_yy += part * rods[COSINE, q] * right[2, q]
    inverse = 1.0 / (c_xx * c_yy - c_xy * c_xy)
    work.leg_stiffness[leg, STIFF_XX] = c_yy * inverse
    work.leg_stiffness[leg, STIFF_XY] = -c_xy * inverse
    work.leg_stiffness[leg, STIFF_YY] = c_xx * inverse


@kernel
def _factorise(matrix: Array) -> int:
    """Turn the upper triangle of a symmetric matrix into U with matrix = U' D^-1 U, D = diag(U), in place.

    Returns the number of negative eigenvalues, that of negative pivots. Without pivoting: a pivot near zero costs
    digits, which the next correction of Newton's method makes good.
    """
    size, negative = matrix.shape[0], 0
    for j in range(size):
        negative += 0 if matrix[j, j] > 0.0 else 1
        inverse = 1.0 / matrix[j, j]
        for i in range(j + 1, size):
            factor = matrix[j, i] * inverse
            for k in range(i, size):
                matrix[i, k] -= factor * matrix[j, k]
    return negative


@kernel
def _substitute(matrix: Array, right: Array) -> None:
    """Solve in place with the factors that `_factorise` left."""
    size = matrix.shape[0]
    for j in range(size):
        factor = right[j] / matrix[j, j]
        for i in range(j + 1, size):
            right[i] -= factor * matrix[j, i]
    for j in range(size - 1, -1, -1):
        total = right[j]
        for k in range(j + 1, size):
            total -= matrix[j, k] * right[k]
        right[j] = total / matrix[j, j]
