"""Where a mechanism falls from a fold or from an unstable equilibrium: the overdamped motion of its whole rods.

A rod is the angle of its tangent at the Gauss points of its arc: a polynomial that starts at the clamp's angle. It
moves through a viscous medium that resists each piece of it alike, in all directions; it has no mass, and the
end-effector neither mass nor drag. Time is in units of drag times L^4 / EI. A step tau of the implicit Euler method is
the minimum, under the constraints of closure, of

    energy + sum over the rods of the integral of |r - r_start|^2 / (2 tau),    r: the points of the rod,

found by Newton's method on its Lagrangian. So the energy falls in every step, however long, and the steps may grow as
the motion settles. The pull of a hinge is its multiplier: minus the force of the end-effector on the rod's tip.
"""

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray

from pcm_gym.kernels.closure import (
    ATTACH_X,
    ATTACH_Y,
    FORCE_X,
    FORCE_Y,
    LENGTH,
    STIFFNESS,
    Workspace,
    evaluate_rods,
    set_inputs,
)
from pcm_gym.kernels.compilation import kernel
from pcm_gym.kernels.equilibrium import total_energy
from pcm_gym.kernels.linear import Symmetric, eigenvalues_2, eigenvalues_3, solve_symmetric
from pcm_gym.kernels.newton import CONVERGED, NewtonRules, solve_forward_locally
from pcm_gym.kernels.rod import rod
from pcm_gym.kernels.stability import assess_stability

Array = NDArray[np.float64]

# How a relaxation ended; the last two are used inside alone.
LANDED, STAYED, NOT_RESOLVED, NOT_SETTLED, NOT_POLISHED, _MOVING, _AT_SADDLE = range(7)

# Rows of the table of a rod's nodes: the tangent's angle from the clamp's, its cosine and sine in the world; all three at
# the start of the step; the pull on the rod beyond the node, times the node's weight, and its moment; the rate of the
# angle; and the angle's share in the softest direction.
_ANGLE, _COSINE, _SINE, _START_ANGLE, _START_COSINE, _START_SINE, _PULL_X, _PULL_Y, _MOMENT, _RATE, _SOFT = range(11)
_NODE_ROWS = 11
# Rows of the table of the hinges: pull, pull at the start of the step, change of the pull, error of closure, arm.
_PULL, _START_PULL, _PULL_CHANGE, _GAP, _ARM = range(5)
_HINGE_ROWS = 5
# Rows of the table of poses: the present one, that at the start of the step, right side and then change.
_NOW, _START, _CHANGE = range(3)

_NODES = 20
_LAST_CORRECTION = 1e-6
_MOST_CORRECTIONS = 8
# A correction of an angle, rad, and its ratio to the one before, beyond which Newton's method is given up. It may rise
# once: the first correction also has to find the pulls.
_LARGEST_CORRECTION, _LARGEST_RISE = 0.5, 2.0
# Size of the first and of the last disturbance, the root mean square of the rods' displacement, and the trials in all.
_LEAST_DISTURBANCE, LARGEST_DISTURBANCE, _DISTURBANCES = 0.004, 0.016, 10
# Largest error of the energy of the start, relative to 1 + energy, with which the nodes still stand for the rods.
_RESOLUTION = 1e-5
# Differences of energy below this are rounding.
_ENERGY_TOLERANCE = 1e-12
# Energies on both sides whose falls differ by less than this part count as equal.
_TIE = 1e-6
_STIFFEST, _SOFTEST, _SHIFT_GROWTH = 1e6, 1e-3, 4.0
_BISECTIONS, _INVERSE_ITERATIONS = 5, 12
_FIRST_STEP, _LEAST_STEP, _LARGEST_GROWTH = 1e-3, 1e-12, 4.0
# Movement in one step, rad, below which an equilibrium may be near, and below which the motion has ended.
_SLOW, _AT_REST = 0.1, 1e-6
_MOST_ESCAPES = 4
# The tip load of a taut rod is exponentially sensitive: Newton's method is given its way, and what it finds is judged
# by how far from the rods it is: pose, and forces relative to 1 + force.
_POLISH_RULES = NewtonRules(first_correction=math.inf, contraction=100.0, iterations=20)
_NEAR = 0.02


class RelaxationRules(NamedTuple):
    """How closely the motion is followed, and for how long."""

    angle_error: float = 0.1  # error of a tangent's angle that a step aims at, rad
    steps: int = 400


class Grid(NamedTuple):
    """Calculus on the Gauss points of the unit interval."""

    nodes: Array  # (n,)
    weights: Array  # (n,)
    integral: Array  # (n, n): from 0 to each node
    drag: Array  # (n, n): integral' weights integral
    bending: Array  # (n, n): the integral of the squared slope of a polynomial that is 0 at 0
    end: Array  # (n,): value at 1 of a polynomial that is 0 at 0


class Relaxation(NamedTuple):
    """A mechanism's rods in motion: scratch arrays, made once outside the kernels by `make_relaxation`."""

    grid: Grid
    rods: Array  # (legs, 12, n): the table of the nodes
    hinges: Array  # (5, legs, 2): the table of the hinges
    pose: Array  # (3, d): the table of poses
    matrix: Array  # (legs, n, n): second derivative of the functional of a step, then its factors
    right: Array  # (legs, 3, n): right sides and then solutions: of the motion, of a tip force along x, along y
    leg_stiffness: Array  # (legs, 3): xx, xy, yy, of the rod as its hinge feels it
    x: Array  # (size,): trial state
    energies: Array  # (steps + 1,): at the start and after each step


class Relaxed(NamedTuple):
    """How a relaxation ended."""

    status: int
    steps: int
    energy_released: float


@lru_cache(maxsize=8)
def make_grid(count: int) -> Grid:
    """Return the calculus on `count` Gauss points."""
    points, weights = legendre.leggauss(count)
    weights = 0.5 * weights
    scale = np.sqrt(2.0 * np.arange(count) + 1.0)  # of the polynomials that are orthonormal on (0, 1)
    values = legendre.legvander(points, count - 1) * scale
    antiderivatives = 0.5 * scale[:, None] * np.array([legendre.legint(row, lbnd=-1.0) for row in np.eye(count)])
    integrals = legendre.legval(np.append(points, 1.0), antiderivatives.T).T
    integral = integrals[:-1] @ (values.T * weights)
    inverse = np.linalg.inv(integrals[:-1])
    return Grid(
        nodes=0.5 * (points + 1.0),
        weights=weights,
        integral=integral,
        drag=integral.T @ (weights[:, None] * integral),
        bending=inverse.T @ inverse,
        end=integrals[-1] @ inverse,
    )


def make_relaxation(leg_count: int, size: int, rules: RelaxationRules, nodes: int = _NODES) -> Relaxation:
    """Return scratch arrays for `leg_count` legs and a state of `size` = 2 legs + d numbers."""
    return Relaxation(
        grid=make_grid(nodes),
        rods=np.zeros((leg_count, _NODE_ROWS, nodes)),
        hinges=np.zeros((_HINGE_ROWS, leg_count, 2)),
        pose=np.zeros((3, size - 2 * leg_count)),
        matrix=np.zeros((leg_count, nodes, nodes)),
        right=np.zeros((leg_count, 3, nodes)),
        leg_stiffness=np.zeros((leg_count, 3)),
        x=np.zeros(size),
        energies=np.zeros(rules.steps + 1),
    )


@kernel
def relax(
    legs: Array, x: Array, inputs: Array, load: Array, rules: RelaxationRules, work: Relaxation, closure: Workspace
) -> Relaxed:
    """Let the mechanism fall from the equilibrium `x`, a fold or an unstable one; `x` becomes where it lands.

    Where it does not land, `x` is left alone. The rod table belongs to no particular state afterwards.
    """
    set_inputs(legs, inputs, closure)
    work.x[:] = x
    steps = 0
    for _ in range(_MOST_ESCAPES):
        status = _disturb(legs, load, work, closure)
        if status == _MOVING:
            status, steps = _descend(legs, inputs, load, rules, steps, work, closure)
        if status == LANDED:
            released = total_energy(legs, x, load) - total_energy(legs, work.x, load)
            x[:] = work.x
            return Relaxed(LANDED, steps, released)
        if status != _AT_SADDLE:
            return Relaxed(status, steps, 0.0)
    return Relaxed(NOT_SETTLED, steps, 0.0)


@kernel
def _disturb(legs: Array, load: Array, work: Relaxation, closure: Workspace) -> int:
    """Push the rods of the equilibrium `work.x` along its softest direction, to the side where the energy falls.

    The smallest disturbance is taken that lowers the energy on one side; if on both, the lower one; if they are equal
    (a pitchfork), the side on which the first rod that moves turns its tip counter-clockwise. Where none lowers it,
    the equilibrium is stable.
    """
    exact = total_energy(legs, work.x, load)
    hardness = _set_soft_direction(legs, load, work, closure)
    is_found = _push(legs, load, 0.0, hardness, work, closure)
    rest = _energy(legs, load, work)
    if not (is_found and abs(rest - exact) < _RESOLUTION * (1.0 + abs(exact))):
        return NOT_RESOLVED
    size = _LEAST_DISTURBANCE
    for _ in range(_DISTURBANCES):
        is_found = _push(legs, load, -size, hardness, work, closure)
        behind = _energy(legs, load, work)
        is_found = _push(legs, load, size, hardness, work, closure) and is_found
        ahead = _energy(legs, load, work)
        if not is_found:
            hardness *= 4.0
        elif min(ahead, behind) < rest - _ENERGY_TOLERANCE:
            if behind < ahead - _TIE * (abs(ahead - rest) + abs(behind - rest)) - _ENERGY_TOLERANCE:
                _push(legs, load, -size, hardness, work, closure)
            return _MOVING
        else:
            size *= 2.0
        if size > LARGEST_DISTURBANCE:
            return STAYED
    return NOT_RESOLVED


@kernel
def _push(legs: Array, load: Array, size: float, hardness: float, work: Relaxation, closure: Workspace) -> bool:
    """Displace the rods of `work.x` by `size` along the soft direction, close them again and let the rest give way."""
    _set_rods(legs, work.x, work, closure)
    for i in range(legs.shape[0]):
        work.rods[i, _ANGLE] += size * work.rods[i, _SOFT]
    work.rods[:, _RATE] = 0.0
    _start_step(legs, 0.0, work, closure)
    return _minimise(legs, load, hardness, work, closure)


@kernel
def _set_soft_direction(legs: Array, load: Array, work: Relaxation, closure: Workspace) -> float:
    """Fill the row `_SOFT`: the motion of least stiffness (energy over drag) at `work.x` under the constraints.

    Its root mean square displacement is 1. By inverse iteration, shifted by a drag that makes the energy convex;
    returns a hardness at which a step is convex and slow motions stay.
    """
    _set_rods(legs, work.x, work, closure)
    _start_step(legs, 0.0, work, closure)
    low, high = 0.0, _SOFTEST
    while _factorise_at(legs, load, high, work, closure)[0] > 0 and high < _STIFFEST:
        low, high = high, _SHIFT_GROWTH * high
    for _ in range(_BISECTIONS if low > 0.0 else 0):
        middle = 0.5 * (low + high)
        if _factorise_at(legs, load, middle, work, closure)[0] > 0:
            low = middle
        else:
            high = middle
    _, stiffness = _factorise_at(legs, load, high, work, closure)
    for i in range(legs.shape[0]):
        for q in range(work.grid.nodes.shape[0]):  # anything that no symmetry of a mechanism shares
            work.rods[i, _SOFT, q] = math.cos(1.0 + 3.0 * i + q * q)
    work.hinges[_GAP] = 0.0
    for _ in range(_INVERSE_ITERATIONS):
        scale = _set_drag(legs, work)
        work.right[:, 0] /= scale
        work.pose[_CHANGE] = 0.0
        _solve(legs, stiffness, work)
        work.rods[:, _SOFT] = work.right[:, 0]
    scale = _set_drag(legs, work) * _sign(work)
    work.rods[:, _SOFT] /= scale
    return 100.0 + 4.0 * high


@kernel
def _sign(work: Relaxation) -> float:
    """Return the sign of the tip's turn of the first rod that moves in the soft direction."""
    largest = np.abs(work.rods[:, _SOFT]).max()
    for i in range(work.rods.shape[0]):
        turn = 0.0
        for q in range(work.grid.end.shape[0]):
            turn += work.grid.end[q] * work.rods[i, _SOFT, q]
        if abs(turn) > 1e-3 * largest:
            return math.copysign(1.0, turn)
    return 1.0


@kernel
def _set_drag(legs: Array, work: Relaxation) -> float:
    """Put drag times the soft direction on the right side; return the direction's root mean square displacement."""
    squared, total = 0.0, 0.0
    count = work.grid.nodes.shape[0]
    for i in range(legs.shape[0]):
        rods, right = work.rods[i], work.right[i, 0]
        cosine, sine, soft = rods[_COSINE], rods[_SINE], rods[_SOFT]
        cube = legs[i, LENGTH] ** 3
        for p in range(count):
            along, across = 0.0, 0.0
            for q in range(count):
                weight = work.grid.drag[p, q] * soft[q]
                along += weight * cosine[q]
                across += weight * sine[q]
            right[p] = cube * (along * cosine[p] + across * sine[p])
            squared += right[p] * soft[p]
        total += legs[i, LENGTH]
    return math.sqrt(squared / total)


@kernel
def _descend(
    legs: Array, inputs: Array, load: Array, rules: RelaxationRules, steps: int, work: Relaxation, closure: Workspace
) -> tuple[int, int]:
    """Follow the motion until it rests, put the equilibrium there into `work.x`; return a status and the steps."""
    tau, growth, energy = _FIRST_STEP, _LARGEST_GROWTH, _energy(legs, load, work)
    work.rods[:, _RATE] = 0.0
    work.energies[steps] = energy
    while steps < rules.steps and tau > _LEAST_STEP:
        _start_step(legs, tau, work, closure)
        is_found = _minimise(legs, load, 1.0 / tau, work, closure)
        error, movement = _measure_step(tau, work)
        end_energy = _energy(legs, load, work)
        is_accepted = is_found and error <= 2.0 * rules.angle_error and end_energy <= energy
        if is_accepted:
            steps, energy = steps + 1, end_energy
            work.energies[steps] = energy
            for i in range(legs.shape[0]):
                work.rods[i, _RATE] = (work.rods[i, _ANGLE] - work.rods[i, _START_ANGLE]) / tau
        else:
            _undo_step(work)
        # a step that is short though it might be long says nothing: near a fold all motion is slow
        is_longest = not is_accepted or growth < _LARGEST_GROWTH
        is_at_rest = is_found and is_longest and movement < _AT_REST
        if is_at_rest or (is_accepted and movement < _SLOW):
            index = _polish(legs, inputs, load, energy, is_at_rest, work, closure)
            if index >= 0:
                return (LANDED if index == 0 else _AT_SADDLE), steps
            if is_at_rest:
                return NOT_POLISHED, steps
        if is_accepted:
            tau *= min(max(0.9 * math.sqrt(rules.angle_error / (error + 1e-100)), 0.5), growth)
            growth = _LARGEST_GROWTH
        else:
            tau, growth = 0.4 * tau, 1.3
    return NOT_SETTLED, steps


@kernel
def _polish(
    legs: Array, inputs: Array, load: Array, energy: float, is_at_rest: bool, work: Relaxation, closure: Workspace
) -> int:
    """Put the exact equilibrium near the moving rods into `work.x`; return its index, or -1 if it is not their goal.

    A stable one is the goal if the energy is convex where the rods are and falls on the way there; an unstable one
    only if the rods are at rest.
    """
    if not is_at_rest and _factorise_at(legs, load, 0.0, work, closure)[0] > 0:
        return -1
    pose = 2 * legs.shape[0]
    for i in range(legs.shape[0]):
        turn = 0.0
        for q in range(work.grid.end.shape[0]):
            turn += work.grid.end[q] * work.rods[i, _ANGLE, q]
        clamp_c, clamp_s = closure.clamps[i, 2], closure.clamps[i, 3]
        c = clamp_c * math.cos(turn) - clamp_s * math.sin(turn)
        s = clamp_s * math.cos(turn) + clamp_c * math.sin(turn)
        scale = legs[i, LENGTH] ** 2 / legs[i, STIFFNESS]
        force_x, force_y = -scale * work.hinges[_PULL, i, 0], -scale * work.hinges[_PULL, i, 1]
        work.x[2 * i] = c * force_x + s * force_y
        work.x[2 * i + 1] = c * force_y - s * force_x
    work.x[pose:] = work.pose[_NOW]
    if solve_forward_locally(legs, inputs, load, work.x, _POLISH_RULES, closure) != CONVERGED:
        return -1
    evaluate_rods(legs, work.x, closure)
    if not _is_near(work, closure) or total_energy(legs, work.x, load) > energy + _ENERGY_TOLERANCE:
        return -1
    index = assess_stability(legs, work.x, closure).morse_index
    return index if index == 0 or is_at_rest else -1


@kernel
def _is_near(work: Relaxation, closure: Workspace) -> bool:
    """Return whether the equilibrium `work.x`, whose rod table is set, is near the moving rods."""
    apart, leg_count = 0.0, work.rods.shape[0]
    for d in range(work.pose.shape[1]):
        apart = max(apart, abs(work.x[2 * leg_count + d] - work.pose[_NOW, d]))
    for i in range(leg_count):
        force_x, force_y = closure.rods[i, FORCE_X], closure.rods[i, FORCE_Y]
        change = math.hypot(force_x + work.hinges[_PULL, i, 0], force_y + work.hinges[_PULL, i, 1])
        apart = max(apart, change / (1.0 + math.hypot(force_x, force_y)))
    return apart < _NEAR


@kernel
def _set_rods(legs: Array, x: Array, work: Relaxation, closure: Workspace) -> None:
    """Put pose, pulls and rods of the state `x` into the tables; the clamps must be set.

    A rod's curvature is the moment of its tip force. The part beyond a cut is itself a rod, see `rod.rod_shape`.
    """
    evaluate_rods(legs, x, closure)
    work.pose[_NOW] = x[2 * legs.shape[0] :]
    count = work.grid.nodes.shape[0]
    for i in range(legs.shape[0]):
        work.hinges[_PULL, i, 0] = -closure.rods[i, FORCE_X]
        work.hinges[_PULL, i, 1] = -closure.rods[i, FORCE_Y]
        angle = work.rods[i, _ANGLE]
        angle[:] = 0.0
        for q in range(count):
            part = 1.0 - work.grid.nodes[q]
            cut = rod(part * part * x[2 * i], part * part * x[2 * i + 1])
            curvature = (cut.tip_x * cut.force_y - cut.tip_y * cut.force_x) / part
            for p in range(count):
                angle[p] += work.grid.integral[p, q] * curvature


@kernel
def _set_tangents(legs: Array, leg: int, work: Relaxation, closure: Workspace) -> None:
    """Fill the tangents of a rod from its angles, and its hinge's arm and error of closure."""
    rods, hinges, length = work.rods[leg], work.hinges, legs[leg, LENGTH]
    clamp_c, clamp_s = closure.clamps[leg, 2], closure.clamps[leg, 3]
    tip_x, tip_y = 0.0, 0.0
    for q in range(rods.shape[1]):
        c, s = math.cos(rods[_ANGLE, q]), math.sin(rods[_ANGLE, q])
        rods[_COSINE, q], rods[_SINE, q] = clamp_c * c - clamp_s * s, clamp_s * c + clamp_c * s
        tip_x += length * work.grid.weights[q] * rods[_COSINE, q]
        tip_y += length * work.grid.weights[q] * rods[_SINE, q]
    pose = work.pose[_NOW]
    c, s = (math.cos(pose[2]), math.sin(pose[2])) if pose.shape[0] == 3 else (1.0, 0.0)
    hinges[_ARM, leg, 0] = c * legs[leg, ATTACH_X] - s * legs[leg, ATTACH_Y]
    hinges[_ARM, leg, 1] = s * legs[leg, ATTACH_X] + c * legs[leg, ATTACH_Y]
    hinges[_GAP, leg, 0] = closure.clamps[leg, 0] + tip_x - pose[0] - hinges[_ARM, leg, 0]
    hinges[_GAP, leg, 1] = closure.clamps[leg, 1] + tip_y - pose[1] - hinges[_ARM, leg, 1]


@kernel
def _energy(legs: Array, load: Array, work: Relaxation) -> float:
    """Return the rods' bending energy less the work of the load on the end-effector."""
    energy = 0.0
    for i in range(legs.shape[0]):
        rods = work.rods[i]
        _multiply(work.grid.bending, rods[_ANGLE], rods[_MOMENT])
        for q in range(rods.shape[1]):
            energy += 0.5 * legs[i, STIFFNESS] / legs[i, LENGTH] * rods[_ANGLE, q] * rods[_MOMENT, q]
    for d in range(load.shape[0]):
        energy -= load[d] * work.pose[_NOW, d]
    return energy


@kernel
def _start_step(legs: Array, tau: float, work: Relaxation, closure: Workspace) -> None:
    """Keep the present state as the start of a step, and move the rods on as they moved before."""
    work.hinges[_START_PULL] = work.hinges[_PULL]
    work.pose[_START] = work.pose[_NOW]
    for i in range(legs.shape[0]):
        _set_tangents(legs, i, work, closure)
        rods = work.rods[i]
        for q in range(rods.shape[1]):
            rods[_START_ANGLE, q] = rods[_ANGLE, q]
            rods[_START_COSINE, q], rods[_START_SINE, q] = rods[_COSINE, q], rods[_SINE, q]
            rods[_ANGLE, q] += tau * rods[_RATE, q]


@kernel
def _undo_step(work: Relaxation) -> None:
    work.hinges[_PULL] = work.hinges[_START_PULL]
    work.pose[_NOW] = work.pose[_START]
    for i in range(work.rods.shape[0]):
        work.rods[i, _ANGLE] = work.rods[i, _START_ANGLE]


@kernel
def _measure_step(tau: float, work: Relaxation) -> tuple[float, float]:
    """Return the step's error, half its difference from going on as before, and its movement, both in rad."""
    error, movement = 0.0, 0.0
    for i in range(work.rods.shape[0]):
        rods = work.rods[i]
        for q in range(rods.shape[1]):
            moved = rods[_ANGLE, q] - rods[_START_ANGLE, q]
            movement = max(movement, abs(moved))
            error = max(error, 0.5 * abs(moved - tau * rods[_RATE, q]))
    return error, movement


@kernel
def _minimise(legs: Array, load: Array, hardness: float, work: Relaxation, closure: Workspace) -> bool:
    """Find the end of the step, hardness = 1 / tau, by Newton's method; return whether it is a minimum.

    Where the functional is not convex the step is too long: an unstable motion grows faster than that.
    """
    previous = math.inf
    for _ in range(_MOST_CORRECTIONS):
        index, stiffness = _factorise_at(legs, load, hardness, work, closure)
        if index > 0:
            return False
        _solve(legs, stiffness, work)
        size = 0.0
        for i in range(legs.shape[0]):
            for q in range(work.right.shape[2]):
                change = work.right[i, 0, q]
                work.rods[i, _ANGLE, q] += change
                size = max(size, abs(change)) if math.isfinite(change) else math.inf
        work.hinges[_PULL] += work.hinges[_PULL_CHANGE]
        work.pose[_NOW] += work.pose[_CHANGE]
        if size < _LAST_CORRECTION:
            return True
        if size > min(_LARGEST_CORRECTION, _LARGEST_RISE * previous):
            return False
        previous = size
    return False


@kernel
def _factorise_at(
    legs: Array, load: Array, hardness: float, work: Relaxation, closure: Workspace
) -> tuple[int, Symmetric]:
    """Assemble and factorise Newton's system of the functional; return its index and the end-effector's stiffness.

    The index is the number of directions, under the constraints, in which the functional is not convex; as in
    `stability`, that of the end-effector plus, for each rod, its own at a free tip less that of its tip's stiffness.
    """
    dof, index = work.pose.shape[1], 0
    right = work.pose[_CHANGE]
    right[:] = load
    xx = xy = yy = xz = yz = 0.0
    zz = 0.0 if dof == 3 else 1.0  # a point cannot turn: it is given a turn of its own
    for i in range(legs.shape[0]):
        _assemble(legs, i, hardness, work, closure)
        index += _factorise(work.matrix[i]) - _condense(i, legs[i, LENGTH], work)
        a_xx, a_xy, a_yy = work.leg_stiffness[i, 0], work.leg_stiffness[i, 1], work.leg_stiffness[i, 2]
        arm_x, arm_y = work.hinges[_ARM, i, 0], work.hinges[_ARM, i, 1]
        pull_x, pull_y = work.hinges[_PULL, i, 0], work.hinges[_PULL, i, 1]
        turn_x, turn_y = a_xy * arm_x - a_xx * arm_y, a_yy * arm_x - a_xy * arm_y
        xx, xy, yy, xz, yz = xx + a_xx, xy + a_xy, yy + a_yy, xz + turn_x, yz + turn_y
        zz += arm_x * turn_y - arm_y * turn_x + arm_x * pull_x + arm_y * pull_y
        right[0] += pull_x
        right[1] += pull_y
        if dof == 3:
            right[2] += arm_x * pull_y - arm_y * pull_x
    stiffness = Symmetric(xx, xy, yy, xz, yz, zz)
    first, second, third = math.inf, math.inf, math.inf
    if dof == 3:
        first, second, third = eigenvalues_3(stiffness)
    else:
        first, second = eigenvalues_2(stiffness)
    # a nan counts as unstable
    index += (0 if first >= 0.0 else 1) + (0 if second >= 0.0 else 1) + (0 if third >= 0.0 else 1)
    return index, stiffness


@kernel
def _multiply(matrix: Array, vector: Array, out: Array) -> None:
    """Fill `out` with a symmetric matrix times a vector, row by row: that the compiler can vectorise."""
    out[:] = 0.0
    for p in range(vector.shape[0]):
        for q in range(vector.shape[0]):
            out[q] += matrix[p, q] * vector[p]


@kernel
def _assemble(legs: Array, leg: int, hardness: float, work: Relaxation, closure: Workspace) -> None:
    """Fill matrix and right sides of a rod: the functional's second derivative and minus its first, by the angles."""
    _set_tangents(legs, leg, work, closure)
    rods, matrix, right, weights = work.rods[leg], work.matrix[leg], work.right[leg], work.grid.weights
    cosine, sine, pull_x, pull_y = rods[_COSINE], rods[_SINE], rods[_PULL_X], rods[_PULL_Y]
    length = legs[leg, LENGTH]
    bending, drag = legs[leg, STIFFNESS] / length, hardness * length**3
    for q in range(weights.shape[0]):  # rows of the solution as scratch: how the tangents changed
        right[1, q], right[2, q] = cosine[q] - rods[_START_COSINE, q], sine[q] - rods[_START_SINE, q]
    _multiply(work.grid.drag, right[1], pull_x)
    _multiply(work.grid.drag, right[2], pull_y)
    _multiply(work.grid.bending, rods[_ANGLE], rods[_MOMENT])
    for p in range(weights.shape[0]):
        pull_x[p] = drag * pull_x[p] + length * weights[p] * work.hinges[_PULL, leg, 0]
        pull_y[p] = drag * pull_y[p] + length * weights[p] * work.hinges[_PULL, leg, 1]
        right[0, p] = sine[p] * pull_x[p] - cosine[p] * pull_y[p] - bending * rods[_MOMENT, p]
        right[1, p], right[2, p] = -length * weights[p] * sine[p], length * weights[p] * cosine[p]
        along, across = drag * cosine[p], drag * sine[p]
        for q in range(p, weights.shape[0]):
            turn = along * cosine[q] + across * sine[q]
            matrix[p, q] = bending * work.grid.bending[p, q] + work.grid.drag[p, q] * turn
        matrix[p, p] -= cosine[p] * pull_x[p] + sine[p] * pull_y[p]


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
def _solve_factorised(matrix: Array, right: Array) -> None:
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


@kernel
def _condense(leg: int, length: float, work: Relaxation) -> int:
    """Solve for the rod's answer to tip forces, fill its tip's stiffness; return how many negative eigenvalues it has."""
    rods, right = work.rods[leg], work.right[leg]
    _solve_factorised(work.matrix[leg], right[1])
    _solve_factorised(work.matrix[leg], right[2])
    c_xx = c_xy = c_yy = 0.0
    for q in range(rods.shape[1]):
        part = length * work.grid.weights[q]
        c_xx -= part * rods[_SINE, q] * right[1, q]
        c_xy -= part * rods[_SINE, q] * right[2, q]
        c_yy += part * rods[_COSINE, q] * right[2, q]
    determinant = c_xx * c_yy - c_xy * c_xy
    work.leg_stiffness[leg, 0] = c_yy / determinant
    work.leg_stiffness[leg, 1] = -c_xy / determinant
    work.leg_stiffness[leg, 2] = c_xx / determinant
    if determinant < 0.0:
        return 1
    return 2 if c_xx + c_yy < 0.0 else 0


@kernel
def _solve(legs: Array, stiffness: Symmetric, work: Relaxation) -> None:
    """Solve the factorised system for the right sides of rods (row 0), hinges (`_GAP`) and pose (`_CHANGE`), in place."""
    dof, hinges, change = work.pose.shape[1], work.hinges, work.pose[_CHANGE]
    force_x, force_y, moment = change[0], change[1], (change[2] if dof == 3 else 0.0)
    for i in range(legs.shape[0]):
        right, length = work.right[i, 0], legs[i, LENGTH]
        _solve_factorised(work.matrix[i], right)
        gap_x, gap_y = hinges[_GAP, i, 0], hinges[_GAP, i, 1]
        for q in range(right.shape[0]):
            gap_x -= length * work.grid.weights[q] * work.rods[i, _SINE, q] * right[q]
            gap_y += length * work.grid.weights[q] * work.rods[i, _COSINE, q] * right[q]
        a_xx, a_xy, a_yy = work.leg_stiffness[i, 0], work.leg_stiffness[i, 1], work.leg_stiffness[i, 2]
        pull_x, pull_y = a_xx * gap_x + a_xy * gap_y, a_xy * gap_x + a_yy * gap_y
        hinges[_PULL_CHANGE, i, 0], hinges[_PULL_CHANGE, i, 1] = pull_x, pull_y
        force_x += pull_x
        force_y += pull_y
        moment += hinges[_ARM, i, 0] * pull_y - hinges[_ARM, i, 1] * pull_x
    move_x, move_y, turn = solve_symmetric(stiffness, force_x, force_y, moment)
    change[0], change[1] = move_x, move_y
    if dof == 3:
        change[2] = turn
    for i in range(legs.shape[0]):
        a_xx, a_xy, a_yy = work.leg_stiffness[i, 0], work.leg_stiffness[i, 1], work.leg_stiffness[i, 2]
        away_x, away_y = move_x - hinges[_ARM, i, 1] * turn, move_y + hinges[_ARM, i, 0] * turn
        hinges[_PULL_CHANGE, i, 0] -= a_xx * away_x + a_xy * away_y
        hinges[_PULL_CHANGE, i, 1] -= a_xy * away_x + a_yy * away_y
        for q in range(work.right.shape[2]):
            work.right[i, 0, q] -= (
                work.right[i, 1, q] * hinges[_PULL_CHANGE, i, 0] + work.right[i, 2, q] * hinges[_PULL_CHANGE, i, 1]
            )
