"""A proof that one branch of equilibria leads along straight lines in inputs and load from one state to another.

Each line is divided into pieces, each with a tube around the branch (see `tube`). Where two tubes meet, the equilibrium
of the first is proved to lie so near to a node, a state corrected by Newton's method, that it is inside of the second
tube too: so they hold one and the same curve. In the same way the tubes at the ends of a line hold the states that are
given there. The matrix of the equations is regular in all tubes, so the Morse index is the same everywhere on the
curve. Pieces that cannot be proved are halved; where they become too short the proof ends, at a fold for one.
"""

import math
from typing import NamedTuple

import numpy as np

from pcm_gym.arrays import Array, Integers
from pcm_gym.kernels.numerics.compilation import kernel
from pcm_gym.kernels.proofs.krawczyk import CARTESIAN, CARTESIAN_RHO, POLAR
from pcm_gym.kernels.proofs.rod_cells import SLACK
from pcm_gym.kernels.proofs.tube import Tube, bound_error, new_tube, prove_tube, set_error, set_values
from pcm_gym.kernels.statics.closure import (
    Workspace,
    make_workspace,
    place,
    set_path_derivative,
    set_residual,
    solve_equilibrium_system,
)
from pcm_gym.kernels.statics.newton import CONVERGED, NewtonRules, solve_forward_locally
from pcm_gym.kernels.statics.stability import assess_stability
from pcm_gym.kernels.statics.states import States

# Where a proof stands: it goes on; all is proved; a given state is not the equilibrium that the branch comes to there;
# the branch could not be proved any further; it was proved regular, and yet its index seemed to change.
GOES_ON, PROVED, WRONG_STATE, STOPPED, WRONG_INDEX = range(5)

_RULES = NewtonRules(first_correction=0.3, contraction=0.5, iterations=12)
# The shortest piece, as a fraction of the line.
_LEAST_PIECE = 1e-10
# A piece is as long as brings this part of a radius back, and at most so many times as long as the one before.
_WANTED_PART, _GROWTH, _LEAST_CUT = 0.45, 3.0, 0.1
# After a piece that failed the next ones are that much longer, and so much more each time.
_FIRST_GROWTH, _MORE_GROWTH = 1.0, 1.3
# A given state is right if no component of it is farther than the first from what Newton's method makes of it, and
# none is proved to be wrong by no more than the second, relative to 1 + its size.
LARGEST_GAP, _LARGEST_ERROR = 1e-9, 1e-5
# A start from which Newton's method fails is singular, if its residual is below this, or no equilibrium.
_LARGEST_RESIDUAL = 1e-8


class Line(NamedTuple):
    """One of the lines, at the fraction t in [0, 1]."""

    first: Array  # (legs + d,): inputs and load at its start
    change: Array  # (legs + d,)


class Node(NamedTuple):
    """An equilibrium on the line, as Newton's method finds it."""

    t: Array  # (1,)
    x: Array  # (size,): the state
    x_t: Array  # (size,): its derivative by t
    inputs: Array  # (legs,)
    load: Array  # (d,)


class Progress(NamedTuple):
    """How far a proof has come."""

    line: Integers  # (1,): the line that it is on; the branch is proved up to a node of it
    tubes: Integers  # (1,)
    morse_index: Integers  # (1,): the Morse index at the start
    step: Array  # (2,): length of the next piece, and how much longer than it the one after it may be
    errors: Array  # (m,): bounds of the errors of the given states, relative to 1 + their size


class Proof(NamedTuple):
    """A proof on its way; all that it keeps from one piece to the next."""

    progress: Progress
    line: Line
    nodes: tuple[Node, Node]  # the last one that is proved, and the one after it
    tube: Tube
    point: Tube  # for the values at a node
    error: Array  # (size,): bound of the error of the first node
    own_error: Array  # (size,): the same in the charts of the tube
    charts: Integers  # (legs,): of the tube before


def new_node(leg_count: int, size: int) -> Node:
    """Return a node with nothing in it."""
    return Node(np.zeros(1), np.zeros(size), np.zeros(size), np.zeros(leg_count), np.zeros(size - 2 * leg_count))


def new_proof(path: States) -> Proof:
    """Return a proof that has not begun."""
    (count, size), leg_count = path.x.shape, path.inputs.shape[1]
    progress = Progress(
        np.zeros(1, dtype=np.int64),
        np.zeros(1, dtype=np.int64),
        np.zeros(1, dtype=np.int64),
        np.array([1.0, _GROWTH]),
        np.full(count, np.inf),
    )
    return Proof(
        progress,
        Line(np.zeros(size - leg_count), np.zeros(size - leg_count)),
        (new_node(leg_count, size), new_node(leg_count, size)),
        new_tube(leg_count, size),
        new_tube(leg_count, size),
        np.zeros(size),
        np.zeros(size),
        np.zeros(leg_count, dtype=np.int64),
    )


@kernel
def _copy_node(node: Node, out: Node) -> None:
    out.t[:], out.x[:], out.x_t[:], out.inputs[:], out.load[:] = node.t, node.x, node.x_t, node.inputs, node.load


@kernel
def _set_line(path: States, number: int, line: Line) -> None:
    """Let the line lead from an equilibrium of the path to the next."""
    n = path.inputs.shape[1]
    for k in range(line.first.shape[0]):
        values, own = (path.inputs, k) if k < n else (path.load, k - n)
        line.first[k], line.change[k] = values[number, own], values[number + 1, own] - values[number, own]


@kernel
def _correct_node(legs: Array, line: Line, t: float, node: Node, work: Workspace) -> bool:
    """Correct the node's state to the equilibrium near it at t; return whether that is found."""
    n = node.inputs.shape[0]
    node.t[0] = t
    for k in range(line.first.shape[0]):
        value = line.first[k] + t * line.change[k]
        if k < n:
            node.inputs[k] = value
        else:
            node.load[k - n] = value
    return solve_forward_locally(legs, node.inputs, node.load, node.x, _RULES, work) == CONVERGED


@kernel
def _set_rates(legs: Array, line: Line, node: Node, work: Workspace) -> bool:
    """Fill in the derivatives of a node's state along the line; return whether there are any."""
    n = node.inputs.shape[0]
    place(legs, node.x, node.inputs, work)
    set_path_derivative(legs, node.x, line.change[:n], line.change[n:], work, work.residual)
    is_regular = solve_equilibrium_system(legs, node.x, work.residual, work)
    node.x_t[:] = work.step
    return is_regular


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
    for leg in range(tube.charts.shape[0]):
        tube.charts[leg] = POLAR if _least_rho(first, second, leg) >= CARTESIAN_RHO else CARTESIAN
    start, start_rate, end, end_rate = np.empty(size), np.empty(size), np.empty(size), np.empty(size)
    _set_own(first, tube.charts, start, start_rate)
    _set_own(second, tube.charts, end, end_rate)
    middle, half = _middle_and_half(first.t[0], second.t[0])
    for k in range(size):
        if k < 2 * tube.charts.shape[0] and k % 2 == 1 and tube.charts[k // 2] == POLAR:
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
    size = out.shape[0]
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
        gap, size = abs(x[k] - node.x[k]), 1.0 + abs(x[k])
        if k == 2 * charts.shape[0] + 2:  # a platform's angle is known up to full turns
            gap = abs(gap - 2.0 * math.pi * math.floor(gap / (2.0 * math.pi) + 0.5)) + SLACK * gap
        if not (gap <= LARGEST_GAP * _fair_size(node.x, charts.shape[0], k) and own[k] < math.inf):
            return math.inf
        largest = max(largest, (gap + own[k]) / size * (1.0 + SLACK))
    return largest


@kernel
def _fair_size(x: Array, leg_count: int, k: int) -> float:
    """Return what a gap in a component of a state counts against: in taut rods the load across is small."""
    if k >= 2 * leg_count or k % 2 == 0:
        return float(1.0 + abs(x[k]))
    load = math.hypot(x[k - 1], x[k])
    return float((1.0 + load) * min(1.0, abs(math.atan2(-x[k], x[k - 1])) + math.exp(-math.sqrt(load))))


@kernel
def _prove_piece(legs: Array, proof: Proof) -> tuple[bool, float]:
    """Prove a tube between the nodes, and that it goes on from the one before.

    Returns whether that is proved, and how much of a radius comes back.
    """
    tube, first = proof.tube, proof.nodes[0]
    _set_curve(proof.line, proof.nodes, tube)
    is_proved, part = prove_tube(legs, tube)
    if not is_proved:
        return False, part
    if proof.progress.tubes[0] == 0:
        _bound_error_at(legs, proof.line, tube, first, proof.point, proof.own_error)
    else:
        _in_charts(first, proof.error, proof.charts, tube.charts, proof.own_error)
    return _fits(proof.own_error, tube), part


@kernel
def _take_piece(legs: Array, path: States, proof: Proof) -> int:
    """Keep what was proved of a piece, and check the given states at its ends; return where the proof stands."""
    progress, (first, second), tube = proof.progress, proof.nodes, proof.tube
    if progress.tubes[0] == 0:
        progress.errors[0] = _state_error(first, proof.own_error, tube.charts, path.x[0])
        if not progress.errors[0] < _LARGEST_ERROR:
            return WRONG_STATE
    progress.tubes[0] += 1
    _bound_error_at(legs, proof.line, tube, second, proof.point, proof.error)
    proof.charts[:] = tube.charts
    _copy_node(second, first)
    if first.t[0] < 1.0:
        return GOES_ON
    progress.line[0] += 1
    number = progress.line[0]
    progress.errors[number] = _state_error(first, proof.error, proof.charts, path.x[number])
    if not progress.errors[number] < _LARGEST_ERROR:
        return WRONG_STATE
    return PROVED if number == path.x.shape[0] - 1 else GOES_ON


@kernel
def _begin(legs: Array, path: States, proof: Proof, work: Workspace) -> int:
    """Set the first node; return where the proof stands."""
    node = proof.nodes[0]
    _set_line(path, 0, proof.line)
    place(legs, path.x[0], path.inputs[0], work)
    is_equilibrium = max(set_residual(legs, path.x[0], path.load[0], work)) < _LARGEST_RESIDUAL
    node.x[:] = path.x[0]
    if not (_correct_node(legs, proof.line, 0.0, node, work) and _set_rates(legs, proof.line, node, work)):
        return STOPPED if is_equilibrium else WRONG_STATE
    proof.progress.morse_index[0] = assess_stability(legs, node.x, work).morse_index
    return GOES_ON


@kernel
def _turn_into_line(legs: Array, path: States, proof: Proof, work: Workspace) -> int:
    """Go on along the next line from the last node, at its start now."""
    node = proof.nodes[0]
    _set_line(path, proof.progress.line[0], proof.line)
    node.t[0], proof.progress.step[0], proof.progress.step[1] = 0.0, 1.0, _GROWTH
    return GOES_ON if _set_rates(legs, proof.line, node, work) else STOPPED


@kernel
def _try_piece(legs: Array, path: States, proof: Proof, work: Workspace) -> int:
    """Try the next piece; return where the proof stands then."""
    progress, (first, second) = proof.progress, proof.nodes
    t, step = first.t[0], progress.step[0]
    goal = t + step if step < (1.0 - t) * (1.0 - 1e-6) else 1.0
    for j in range(first.x.shape[0]):
        second.x[j] = first.x[j] + (goal - t) * first.x_t[j]
    is_proved, part = False, math.inf
    if _correct_node(legs, proof.line, goal, second, work) and _set_rates(legs, proof.line, second, work):
        is_proved, part = _prove_piece(legs, proof)
    if not is_proved:
        progress.step[0] = (goal - t) * max(_LEAST_CUT, min(0.5, _WANTED_PART / part))
        progress.step[1] = _FIRST_GROWTH
        return GOES_ON if progress.step[0] >= _LEAST_PIECE else STOPPED
    progress.step[0] = (goal - t) * min(progress.step[1], _WANTED_PART / part)
    progress.step[1] = min(_GROWTH, _MORE_GROWTH * progress.step[1])
    ending = _take_piece(legs, path, proof)
    if ending == GOES_ON and goal == 1.0:
        return _turn_into_line(legs, path, proof, work)
    if ending == PROVED:
        place(legs, first.x, first.inputs, work)
        if assess_stability(legs, first.x, work).morse_index != progress.morse_index[0]:
            return WRONG_INDEX
    return ending


@kernel
def prove_pieces(legs: Array, path: States, proof: Proof, most: int) -> int:
    """Prove that one branch leads along the lines of a path and through its states, trying at most so many pieces.

    Returns where the proof stands; called again with the same `proof`, it goes on.
    """
    work = make_workspace(legs.shape[0], path.x.shape[1])
    standing = GOES_ON
    if proof.progress.tubes[0] == 0 and proof.progress.step[0] == 1.0:
        standing = _begin(legs, path, proof, work)
    for _ in range(most):
        if standing != GOES_ON:
            break
        standing = _try_piece(legs, path, proof, work)
    return standing
