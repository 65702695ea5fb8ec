"""Where a mechanism snaps to from a fold or an unstable equilibrium: down the energy of its whole rods, overdamped."""

import math
from typing import NamedTuple

from pcm_gym.arrays import Array
from pcm_gym.kernels.numerics.compilation import kernel
from pcm_gym.kernels.snaps.moving_rods import (
    ANGLE,
    CHANGE,
    DIRECTION,
    NOW,
    MovingRods,
    energy_of,
    factorise_at,
    find_minimum,
    measure_step,
    scale_direction,
    set_rate,
    set_rods,
    solve_factorised,
    start_step,
    tip_angle,
    tip_load,
    undo_step,
)
from pcm_gym.kernels.statics.closure import FORCE_X, FORCE_Y, Workspace, evaluate_rods, set_inputs
from pcm_gym.kernels.statics.equilibrium import total_energy
from pcm_gym.kernels.statics.newton import CONVERGED, NewtonRules, solve_forward_locally
from pcm_gym.kernels.statics.stability import assess_stability
from pcm_gym.kernels.statics.states import Point

# How a relaxation ended; the last two are used inside alone.
LANDED, STAYED, NOT_RESOLVED, NOT_SETTLED, NOT_POLISHED, _MOVING, _AT_SADDLE = range(7)

# Size of the first and of the largest disturbance, the root mean square of the rods' displacement in mean lengths, and
# the number of trials in all.
_FIRST_DISTURBANCE, LARGEST_DISTURBANCE, _DISTURBANCES = 0.004, 0.016, 14
# The smallest one of an unstable equilibrium: hardly beyond a pitchfork, all else is lower only very near to it.
_LEAST_DISTURBANCE = 0.0001
# Largest error of the energy of the start, relative to 1 + energy, with which the nodes still stand for the rods.
_RESOLUTION = 1e-5
# Differences of energy below this are rounding.
_ENERGY_TOLERANCE = 1e-12
# Energies on both sides whose falls differ by less than this part count as equal.
_TIE = 1e-6
# The softest direction: the hardnesses tried, and the iterations.
_LEAST_HARDNESS, _LARGEST_HARDNESS, _BISECTIONS, _INVERSE_ITERATIONS = 1e-3, 1e6, 5, 12
# A rod moves in the softest direction if its tip turns by more than this part of the most that any does.
_MOVES = 1e-3
# Hardness at which the rods of a disturbed mechanism give way to each other.
_DISTURBED_HARDNESS = 100.0
_FIRST_STEP, _LEAST_STEP, _LARGEST_GROWTH = 1e-3, 1e-12, 4.0
# A step that is refused is shortened, and the next one may not grow by much.
_SHORTENING, _GROWTH_AFTER_REFUSAL = 0.4, 1.3
# Movement in one step, rad, below which an equilibrium may be near, and below which the motion has ended.
_SLOW, _AT_REST = 0.1, 1e-6
# Unstable equilibria at which a motion that keeps a symmetry may come to rest on its way.
_MOST_ESCAPES = 4
# The tip load of a taut rod is exponentially sensitive: Newton's method is given its way, and what it finds is judged
# by how far from the rods it is: pose, and forces relative to 1 + force.
_POLISH_RULES = NewtonRules(first_correction=math.inf, contraction=100.0, iterations=20)
_NEAR = 0.02


class RelaxationRules(NamedTuple):
    """How closely the motion is followed, and for how long."""

    angle_error: float = 0.1  # error of a tangent's angle that a step aims at, rad
    steps: int = 400


@kernel
def relax(
    legs: Array, point: Point, rules: RelaxationRules, moving: MovingRods, work: Workspace
) -> tuple[int, int, float]:
    """Let the mechanism snap from an equilibrium, a fold or an unstable one, and put where it lands into the point.

    Returns a status, the steps of the motion and the energy released. Where the mechanism does not land, the point is
    left alone. `moving` must have room for the steps of the rules. The rod table belongs to no particular state
    afterwards.
    """
    x, load = point.x, point.load
    set_inputs(legs, point.inputs, work)
    moving.x[:] = x
    steps = 0
    for _ in range(_MOST_ESCAPES):
        status = _disturb(legs, load, moving, work)
        if status == _MOVING:
            status, steps = _descend(legs, point, rules, steps, moving, work)
        if status == LANDED:
            released = total_energy(legs, x, load) - total_energy(legs, moving.x, load)
            x[:] = moving.x
            return LANDED, steps, released
        if status != _AT_SADDLE:
            return status, steps, 0.0
    return NOT_SETTLED, steps, 0.0


@kernel
def _disturb(legs: Array, load: Array, moving: MovingRods, work: Workspace) -> int:
    """Push the rods of the equilibrium `moving.x` along its softest direction, to the side where the energy falls.

    The smallest disturbance is taken that lowers the energy on one side; if on both, the lower one; if they are equal
    (a pitchfork), the side on which the first rod that moves turns its tip counter-clockwise. Where none lowers it,
    the equilibrium is stable, or nothing can tell.
    """
    evaluate_rods(legs, moving.x, work)
    is_unstable = assess_stability(legs, moving.x, work).morse_index > 0
    exact = total_energy(legs, moving.x, load)
    hardness = _DISTURBED_HARDNESS + 4.0 * _set_soft_direction(legs, load, moving, work)
    is_found = _push(legs, load, 0.0, hardness, moving, work)
    rest = energy_of(legs, load, moving)
    if not (is_found and abs(rest - exact) < _RESOLUTION * (1.0 + abs(exact))):
        return NOT_RESOLVED
    size = _FIRST_DISTURBANCE
    for _ in range(_DISTURBANCES):
        is_found = _push(legs, load, -size, hardness, moving, work)
        behind = energy_of(legs, load, moving)
        is_found = _push(legs, load, size, hardness, moving, work) and is_found
        ahead = energy_of(legs, load, moving)
        if not is_found:
            hardness *= 4.0
        elif min(ahead, behind) < rest - _ENERGY_TOLERANCE:
            if behind < ahead - _TIE * (abs(ahead - rest) + abs(behind - rest)) - _ENERGY_TOLERANCE:
                _push(legs, load, -size, hardness, moving, work)
            return _MOVING
        elif _FIRST_DISTURBANCE <= size < LARGEST_DISTURBANCE:
            size *= 2.0
        elif is_unstable and size > _LEAST_DISTURBANCE:
            size = 0.5 * min(size, _FIRST_DISTURBANCE)
        else:
            return STAYED
    return NOT_RESOLVED


@kernel
def _push(legs: Array, load: Array, size: float, hardness: float, moving: MovingRods, work: Workspace) -> bool:
    """Displace the rods of `moving.x` by `size` along the soft direction, close them and let all else give way."""
    set_rods(legs, moving.x, moving, work)
    for i in range(legs.shape[0]):
        for q in range(moving.rods.shape[2]):
            moving.rods[i, ANGLE, q] += size * moving.rods[i, DIRECTION, q]
    start_step(legs, 0.0, moving, work)
    return find_minimum(legs, load, hardness, moving, work)


@kernel
def _set_soft_direction(legs: Array, load: Array, moving: MovingRods, work: Workspace) -> float:
    """Fill the row `DIRECTION`: the motion of least stiffness, energy over drag, at `moving.x` under the constraints.

    Its root mean square displacement is 1. By inverse iteration, shifted by a hardness that makes the functional
    convex; returns that hardness.
    """
    set_rods(legs, moving.x, moving, work)
    start_step(legs, 0.0, moving, work)
    hardness = _least_convex_hardness(legs, load, moving, work)
    stiffness = factorise_at(legs, load, hardness, moving, work).stiffness
    for i in range(legs.shape[0]):
        moving.gaps[i] = 0.0
        for q in range(moving.rods.shape[2]):  # anything that no symmetry of a mechanism shares
            moving.rods[i, DIRECTION, q] = math.cos(1.0 + 3.0 * i + q * q)
    for _ in range(_INVERSE_ITERATIONS):
        scale_direction(legs, moving)
        moving.pose[CHANGE] = 0.0
        solve_factorised(legs, stiffness, moving, work)
        _take_direction(moving, 1.0)
    _take_direction(moving, _sign(moving))
    scale_direction(legs, moving)
    return hardness


@kernel
def _take_direction(moving: MovingRods, sign: float) -> None:
    """Put the last solution for the rods, times `sign`, into the row `DIRECTION`."""
    for i in range(moving.rods.shape[0]):
        for q in range(moving.rods.shape[2]):
            moving.rods[i, DIRECTION, q] = sign * moving.right[i, 0, q]


@kernel
def _least_convex_hardness(legs: Array, load: Array, moving: MovingRods, work: Workspace) -> float:
    """Return a hardness not far above the least one at which the functional is convex: the rate of the instability."""
    low, high = 0.0, _LEAST_HARDNESS
    while factorise_at(legs, load, high, moving, work).morse_index > 0 and high < _LARGEST_HARDNESS:
        low, high = high, 4.0 * high
    for _ in range(_BISECTIONS if low > 0.0 else 0):
        middle = 0.5 * (low + high)
        if factorise_at(legs, load, middle, moving, work).morse_index > 0:
            low = middle
        else:
            high = middle
    return high


@kernel
def _sign(moving: MovingRods) -> float:
    """Return the sign of the tip's turn of the first rod that moves in the row `DIRECTION`."""
    largest = 0.0
    for i in range(moving.rods.shape[0]):
        largest = max(largest, abs(tip_angle(moving, i, DIRECTION)))
    for i in range(moving.rods.shape[0]):
        turn = tip_angle(moving, i, DIRECTION)
        if abs(turn) > _MOVES * largest:
            return math.copysign(1.0, turn)
    return 1.0


@kernel
def _descend(
    legs: Array, point: Point, rules: RelaxationRules, steps: int, moving: MovingRods, work: Workspace
) -> tuple[int, int]:
    """Follow the motion until it rests, put the equilibrium there into `moving.x`; return a status and the steps."""
    load = point.load
    time, growth, energy = _FIRST_STEP, _LARGEST_GROWTH, energy_of(legs, load, moving)
    moving.energies[steps] = energy
    while steps < rules.steps and time > _LEAST_STEP:
        start_step(legs, time, moving, work)
        is_found = find_minimum(legs, load, 1.0 / time, moving, work)
        error, movement = measure_step(time, moving)
        end_energy = energy_of(legs, load, moving)
        is_accepted = is_found and error <= 2.0 * rules.angle_error and end_energy <= energy
        if is_accepted:
            steps, energy = steps + 1, end_energy
            moving.energies[steps] = energy
            set_rate(time, moving)
        else:
            undo_step(moving)
        # a step that is short though it might be long says nothing: near a fold all motion is slow
        is_longest = not is_accepted or growth < _LARGEST_GROWTH
        is_at_rest = is_found and is_longest and movement < _AT_REST
        if is_at_rest or (is_accepted and movement < _SLOW):
            index = _polish(legs, point, energy, is_at_rest, moving, work)
            if index >= 0:
                return (LANDED if index == 0 else _AT_SADDLE), steps
            if is_at_rest:
                return NOT_POLISHED, steps
        if is_accepted:
            time *= min(max(0.9 * math.sqrt(rules.angle_error / (error + 1e-100)), 0.5), growth)
            growth = _LARGEST_GROWTH
        else:
            time, growth = _SHORTENING * time, _GROWTH_AFTER_REFUSAL
    return NOT_SETTLED, steps


@kernel
def _polish(legs: Array, point: Point, energy: float, is_at_rest: bool, moving: MovingRods, work: Workspace) -> int:
    """Put the exact equilibrium near the moving rods into `moving.x`; return its index, or -1 if it is not their goal.

    A stable one is the goal if the energy is convex where the rods are and falls on the way there; an unstable one
    only if the rods are at rest.
    """
    if not is_at_rest and factorise_at(legs, point.load, 0.0, moving, work).morse_index > 0:
        return -1
    x = moving.x
    for i in range(legs.shape[0]):
        x[2 * i], x[2 * i + 1] = tip_load(legs, i, moving, work)
    x[2 * legs.shape[0] :] = moving.pose[NOW]
    if solve_forward_locally(legs, point.inputs, point.load, x, _POLISH_RULES, work) != CONVERGED:
        return -1
    evaluate_rods(legs, x, work)
    if not _is_near(moving, work) or total_energy(legs, x, point.load) > energy + _ENERGY_TOLERANCE:
        return -1
    index = assess_stability(legs, x, work).morse_index
    return index if index == 0 or is_at_rest else -1


@kernel
def _is_near(moving: MovingRods, work: Workspace) -> bool:
    """Return whether the equilibrium `moving.x`, whose rod table is set, is near the moving rods."""
    apart, leg_count = 0.0, moving.rods.shape[0]
    for d in range(moving.pose.shape[1]):
        apart = max(apart, abs(moving.x[2 * leg_count + d] - moving.pose[NOW, d]))
    for i in range(leg_count):
        force_x, force_y = work.rods[i, FORCE_X], work.rods[i, FORCE_Y]
        change = math.hypot(force_x - moving.forces[NOW, i, 0], force_y - moving.forces[NOW, i, 1])
        apart = max(apart, change / (1.0 + math.hypot(force_x, force_y)))
    return apart < _NEAR
