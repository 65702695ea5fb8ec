"""A proof that one branch of equilibria leads along a straight line in inputs and load from one state to another.

The line is divided into pieces, each with a tube around the branch (see `tube`). Where two tubes meet, the equilibrium
of the first is proved to lie so near to a node, a state corrected by Newton's method, that it is inside of the second
tube too: so they hold one and the same curve. In the same way the first and the last tube hold the states at both ends
of the line. The matrix of the equations is regular in all tubes, so the Morse index is the same everywhere on the
curve. Pieces that cannot be proved are halved; where they become too short the proof ends, at a fold for one.
"""

import math
from typing import NamedTuple

import numpy as np

from pcm_gym.arrays import Array, Integers
from pcm_gym.kernels.enumeration.found import POLISH_RULES
from pcm_gym.kernels.numerics.compilation import kernel
from pcm_gym.kernels.proofs.krawczyk import CARTESIAN, CARTESIAN_RHO, POLAR
from pcm_gym.kernels.proofs.rod_cells import SLACK
from pcm_gym.kernels.proofs.tube import Tube, bound_error, make_tube, prove_tube, set_error, set_values
from pcm_gym.kernels.statics.closure import (
    Workspace,
    make_workspace,
    place,
    set_path_derivative,
    solve_equilibrium_system,
)
from pcm_gym.kernels.statics.newton import CONVERGED, NewtonRules, solve_forward_locally
from pcm_gym.kernels.statics.stability import assess_stability
from pcm_gym.kernels.statics.states import Point

# How a proof ends: all is proved; the state at the start, or that at the end, is not the equilibrium that was found
# there; the branch could not be proved any further; there were too many pieces.
PROVED, WRONG_START, WRONG_END, STOPPED, TOO_LONG = range(5)

_RULES = NewtonRules(first_correction=0.3, contraction=0.5, iterations=12)
# The shortest piece, as a fraction of the line.
_LEAST_PIECE = 1e-10
# A piece is as long as brings this part of a radius back, and at most so many times as long as the one before.
_WANTED_PART, _GROWTH, _LEAST_CUT = 0.45, 3.0, 0.1
# A given state is right if no component of it is farther than the first from what Newton's method makes of it, and
# none is proved to be wrong by no more than the second, relative to 1 + its size.
_LARGEST_GAP, _LARGEST_ERROR = 1e-9, 1e-5


class Line(NamedTuple):
    """A straight line in inputs and load, at the fraction t in [0, 1]."""

    first: Array  # (legs + d,): inputs and load at its start
    change: Array  # (legs + d,)
    leg_count: int


class Node(NamedTuple):
    """An equilibrium on the line, as Newton's method finds it."""

    t: Array  # (1,)
    x: Array  # (size,): the state
    x_t: Array  # (size,): its derivative by t
    inputs: Array  # (legs,)
    load: Array  # (d,)


@kernel
def _make_node(leg_count: int, size: int) -> Node:
    return Node(np.zeros(1), np.zeros(size), np.zeros(size), np.zeros(leg_count), np.zeros(size - 2 * leg_count))


@kernel
def _copy_node(node: Node, out: Node) -> None:
    for source, target in zip(node, out):
        target[:] = source


@kernel
def _set_node(legs: Array, line: Line, t: float, node: Node, work: Workspace) -> bool:
    """Correct the node's state to the equilibrium near it at t; return whether that is found and regular."""
    n = line.leg_count
    node.t[0] = t
    for k in range(line.first.shape[0]):
        value = line.first[k] + t * line.change[k]
        if k < n:
            node.inputs[k] = value
        else:
            node.load[k - n] = value
    if solve_forward_locally(legs, node.inputs, node.load, node.x, _RULES, work) != CONVERGED:
        return False
    place(legs, node.x, node.inputs, work)
    set_path_derivative(legs, node.x, line.change[:n], line.change[n:], work, work.residual)
    if not solve_equilibrium_system(legs, node.x, work.residual, work):
        return False
    node.x_t[:] = work.step
    return True


@kernel
def _least_rho(first: Node, second: Node, leg: int) -> float:
    """Return the least load of a rod on the straight way between two nodes."""
    x, y = first.x[2 * leg], first.x[2 * leg + 1]
    way_x, way_y = second.x[2 * leg] - x, second.x[2 * leg + 1] - y
    square = way_x * way_x + way_y * way_y
    part = min(1.0, max(0.0, -(x * way_x + y * way_y) / square)) if square > 0.0 else 0.0
    return math.sqrt(math.hypot(x + part * way_x, y + part * way_y))


@kernel
def _set_own(node: Node, charts: Integers, z: Array, rates: Array) -> None:
    """Fill in the unknowns of a node in these charts, and their derivatives by t."""
    z[:], rates[:] = node.x, node.x_t
    for leg in range(charts.shape[0]):
        if charts[leg] == CARTESIAN:
            continue
        first, second = 2 * leg, 2 * leg + 1
        x, y, x_t, y_t = node.x[first], node.x[second], node.x_t[first], node.x_t[second]
        load = math.hypot(x, y)
        z[first], z[second] = math.sqrt(load), math.atan2(-y, x)
        rates[first] = 0.5 * (x * x_t + y * y_t) / (load * math.sqrt(load))
        rates[second] = (y * x_t - x * y_t) / (load * load)


@kernel
def _set_curve(line: Line, nodes: tuple[Node, Node], tube: Tube) -> None:
    """Lay the tube's curve through two nodes, with their slopes, and choose the charts."""
    first, second = nodes
    size = first.x.shape[0]
    for leg in range(line.leg_count):
        tube.charts[leg] = POLAR if _least_rho(first, second, leg) >= CARTESIAN_RHO else CARTESIAN
    start, start_rate, end, end_rate = np.empty(size), np.empty(size), np.empty(size), np.empty(size)
    _set_own(first, tube.charts, start, start_rate)
    _set_own(second, tube.charts, end, end_rate)
    middle, half = _middle_and_half(first.t[0], second.t[0])
    for k in range(size):
        if k < 2 * line.leg_count and k % 2 == 1 and tube.charts[k // 2] == POLAR:
            end[k] -= 2.0 * math.pi * math.floor((end[k] - start[k]) / (2.0 * math.pi) + 0.5)
        gap, slopes, bend = end[k] - start[k], half * (end_rate[k] + start_rate[k]), end_rate[k] - start_rate[k]
        tube.curve[k, 0] = 0.5 * (start[k] + end[k]) - 0.25 * half * bend
        tube.curve[k, 1] = 0.75 * gap - 0.25 * slopes
        tube.curve[k, 2] = 0.25 * half * bend
        tube.curve[k, 3] = 0.25 * (slopes - gap)
    _set_parameters(line, middle, half, tube)


@kernel
def _middle_and_half(start: float, end: float) -> tuple[float, float]:
    """Return the middle of a piece and half its length, rounded up: it holds both its ends."""
    middle = 0.5 * (start + end)
    return middle, max(end - middle, middle - start) * (1.0 + SLACK) + SLACK * abs(end)


@kernel
def _set_parameters(line: Line, middle: float, half: float, tube: Tube) -> None:
    for k in range(line.first.shape[0]):
        tube.parameters[k, 0] = line.first[k] + middle * line.change[k]
        tube.parameters[k, 1] = half * line.change[k]


@kernel
def _bound_error_at(legs: Array, line: Line, tube: Tube, node: Node, point: Tube, out: Array) -> None:
    """Bound how far the equilibrium of a proved tube is from a node at one of its ends; `point` is for the values."""
    charts, size = tube.charts, out.shape[0]
    point.charts[:] = POLAR
    _set_own(node, point.charts, point.curve[:, 0], point.radius)
    point.curve[:, 1:] = 0.0
    _set_parameters(line, node.t[0], 0.0, point)
    set_values(legs, point)
    tube.values[:] = point.values
    set_error(tube)
    for k in range(size):  # the curve meets the node but for rounding errors
        size_of_all = abs(tube.curve[k, 0]) + abs(tube.curve[k, 1]) + abs(tube.curve[k, 2]) + abs(tube.curve[k, 3])
        tube.error[k] += 10.0 * SLACK * size_of_all
    bound_error(tube, out)


@kernel
def _in_charts(node: Node, error: Array, charts: Integers, others: Integers, out: Array) -> None:
    """Bound the error of a node's loads, known in `charts`, in other charts."""
    out[:] = error
    for leg in range(charts.shape[0]):
        if charts[leg] == others[leg]:
            continue
        first, second = 2 * leg, 2 * leg + 1
        load = math.hypot(node.x[first], node.x[second])
        rho = math.sqrt(load)
        if charts[leg] == POLAR:
            largest = (rho + error[first]) ** 2
            reach = (largest - load + largest * error[second]) * (1.0 + SLACK) + SLACK * largest
            out[first] = out[second] = reach
            continue
        reach = math.hypot(error[first], error[second]) * (1.0 + SLACK) + SLACK * load
        out[first], out[second] = math.inf, math.inf
        if reach < load:
            out[first], out[second] = reach / rho * (1.0 + SLACK), math.asin(reach / load) * (1.0 + SLACK) + SLACK


@kernel
def _fits(error: Array, tube: Tube) -> bool:
    """Return whether what is up to `error` from the end of a tube's curve lies in the tube."""
    for k in range(error.shape[0]):
        c = tube.curve[k]
        rounding = 10.0 * SLACK * (abs(c[0]) + abs(c[1]) + abs(c[2]) + abs(c[3]))
        if not error[k] + rounding <= tube.radius[k] * (1.0 - SLACK):
            return False
    return True


@kernel
def _state_error(node: Node, error: Array, charts: Integers, x: Array) -> float:
    """Bound how far a given state is from the equilibrium that is within `error` of a node, relative to 1 + its size.

    Returns inf if it is not the node.
    """
    own, cartesian = np.empty(error.shape[0]), np.full(charts.shape[0], CARTESIAN)
    _in_charts(node, error, charts, cartesian, own)
    largest = 0.0
    for k in range(x.shape[0]):
        gap = abs(x[k] - node.x[k])
        if k == 2 * charts.shape[0] + 2:  # a platform's angle is known up to full turns
            gap = abs(gap - 2.0 * math.pi * math.floor(gap / (2.0 * math.pi) + 0.5)) + SLACK * gap
        size = 1.0 + abs(x[k])
        if not (gap <= _LARGEST_GAP * size and own[k] < math.inf):
            return math.inf
        largest = max(largest, (gap + own[k]) / size * (1.0 + SLACK))
    return largest


class _Way(NamedTuple):
    """What a proof along a line keeps."""

    nodes: tuple[Node, Node]
    tube: Tube
    point: Tube
    error: Array
    own_error: Array
    charts: Integers  # those of the tube before


@kernel
def _prove_piece(legs: Array, line: Line, way: _Way, is_first: bool) -> tuple[bool, float, float]:
    """Prove a tube between the nodes, and that it goes on from the one before.

    Returns whether that is proved, how much of a radius comes back, and the error bound of the first node.
    """
    tube = way.tube
    _set_curve(line, way.nodes, tube)
    is_proved, part = prove_tube(legs, tube)
    if not is_proved:
        return False, part, math.inf
    if is_first:
        _bound_error_at(legs, line, tube, way.nodes[0], way.point, way.own_error)
    else:
        _in_charts(way.nodes[0], way.error, way.charts, tube.charts, way.own_error)
    return _fits(way.own_error, tube), part, 0.0


@kernel
def prove_line(
    legs: Array, start: Point, end: Point, most_pieces: int
) -> tuple[int, float, int, int, float, float]:
    """Prove that one branch leads along the straight line between two states, and that they are on it.

    Returns how that ended, the fraction up to which it is proved, the number of tubes, the Morse index at the start,
    and bounds of the errors of both states, relative to 1 + their size.
    """
    leg_count, size = legs.shape[0], start.x.shape[0]
    work = make_workspace(leg_count, size)
    line = Line(np.empty(size - leg_count), np.empty(size - leg_count), leg_count)
    for k in range(size - leg_count):
        first = start.inputs[k] if k < leg_count else start.load[k - leg_count]
        last = end.inputs[k] if k < leg_count else end.load[k - leg_count]
        line.first[k], line.change[k] = first, last - first
    nodes = (_make_node(leg_count, size), _make_node(leg_count, size))
    charts = np.zeros(leg_count, dtype=np.int64)
    way = _Way(nodes, make_tube(leg_count, size), make_tube(leg_count, size), np.zeros(size), np.zeros(size), charts)
    nodes[0].x[:] = start.x
    if not _set_node(legs, line, 0.0, nodes[0], work):
        return WRONG_START, 0.0, 0, -1, math.inf, math.inf
    index = assess_stability(legs, nodes[0].x, work).morse_index
    t, step, pieces, start_error = 0.0, 1.0, 0, math.inf
    for _ in range(most_pieces):
        goal = t + step if step < (1.0 - t) * (1.0 - 1e-6) else 1.0
        for j in range(size):
            nodes[1].x[j] = nodes[0].x[j] + (goal - t) * nodes[0].x_t[j]
        is_proved, part = False, math.inf
        if _set_node(legs, line, goal, nodes[1], work):
            is_proved, part, _ = _prove_piece(legs, line, way, pieces == 0)
        if not is_proved:
            step = (goal - t) * max(_LEAST_CUT, min(0.5, _WANTED_PART / part))
            if step < _LEAST_PIECE:
                return STOPPED, t, pieces, index, start_error, math.inf
            continue
        if pieces == 0:
            start_error = _state_error(nodes[0], way.own_error, way.tube.charts, start.x)
            if not start_error < _LARGEST_ERROR:
                return WRONG_START, 0.0, 0, index, start_error, math.inf
        pieces += 1
        _bound_error_at(legs, line, way.tube, nodes[1], way.point, way.error)
        way.charts[:] = way.tube.charts
        if goal == 1.0:
            end_error = _state_error(nodes[1], way.error, way.charts, end.x)
            ending = PROVED if end_error < _LARGEST_ERROR else WRONG_END
            return ending, 1.0, pieces, index, start_error, end_error
        t, step = goal, (goal - t) * min(_GROWTH, _WANTED_PART / part)
        _copy_node(nodes[1], nodes[0])
    return TOO_LONG, t, pieces, index, start_error, math.inf
