"""Tracing curves of equilibria in (state, inputs): of singular ones, or of all along a line, through folds and cusps.

A curve is what the residual, the linear conditions of the problem and, for singular states, their condition leave of
the unknowns y = (x, inputs). It is followed by pseudo-arclength steps: predictor along the unit tangent, Newton
corrector on the plane across it, the step's length governed by the tangent's turn and the corrector's contraction. In
these unknowns it is smooth also where its projection to inputs or poses folds or has a cusp.
"""

import math
from typing import NamedTuple

import numpy as np

from pcm_gym.arrays import Array, Integers, Mask
from pcm_gym.kernels.branches.singularity import (
    FORWARD,
    metric_length,
    set_normal,
    set_singularity_gradient,
    set_unknowns,
    singularity,
)
from pcm_gym.kernels.numerics.compilation import kernel
from pcm_gym.kernels.numerics.linear import solve_linear
from pcm_gym.kernels.statics.closure import Workspace, add_input_derivative, make_workspace, set_matrix, set_residual
from pcm_gym.kernels.statics.newton import ROUNDING, NewtonRules, correction_size, is_last

# How a curve ended.
CLOSED, LARGEST_LOAD, OUT_OF_BOX, TOO_LONG, FAILED = range(5)
_GOES_ON = -1
# What may change its sign within a step: room in the box and under the largest load, the singularity of a state on a
# line, or the direction of a singular curve's projection.
_ROOM, _SINGULARITY, _DIRECTION = range(3)

_STEP_RULES = NewtonRules(first_correction=0.02, contraction=0.2, iterations=8)
_FIRST_ARC, _LEAST_ARC, _LARGEST_ARC = 1e-3, 1e-9, 0.1
_WANTED_TURN, _LARGEST_TURN = 0.1, 0.25  # of the tangent in one step, rad
_LEAST_GROWTH, _LARGEST_GROWTH = 0.3, 2.0
_LEAST_NORMAL_COSINE = 0.85
_ROOM_TOLERANCE = 1e-9
_MOST_BISECTIONS = 80
_ARC_TOLERANCE = 1e-13
_NEARBY = 2.0
_SAME_POINT = 1e-6
# Part of its speed elsewhere in the step that a projection has left at a cusp: rounding. One slower than the least
# speed all along is a point.
_CUSP_SPEED, _LEAST_SPEED = 1e-2, 1e-9


class Problem(NamedTuple):
    """Which curve is traced."""

    load: Array  # (d,)
    conditions: Array  # (k, size + legs): linear functions of the unknowns that stay constant
    box: Array  # (size + legs, 3): least and largest value of each unknown, and its period (0: none)
    rho_max: float
    kind: int  # of the singularity: FORWARD or INVERSE
    is_singular: bool  # whether its states are singular, or those of a line are watched for singular ones


class _Scratch(NamedTuple):
    y: Array  # (size + legs,): the last point
    tangent: Array  # unit tangent there
    border: Array  # metric times tangent
    trial: Array
    trial_tangent: Array
    gradient: Array
    beside: Array
    change: Array
    direction: Array  # of a projection, whose sign is watched
    normal: Array  # (legs,): normal of the projected curve at the last point
    trial_normal: Array
    matrix: Array  # (size + legs, size + legs)
    vector: Array


@kernel
def _make_scratch(count: int, leg_count: int) -> _Scratch:
    return _Scratch(
        np.zeros(count),
        np.zeros(count),
        np.zeros(count),
        np.zeros(count),
        np.zeros(count),
        np.zeros(count),
        np.zeros(count),
        np.zeros(count),
        np.zeros(count),
        np.zeros(leg_count),
        np.zeros(leg_count),
        np.zeros((count, count)),
        np.zeros(count),
    )


@kernel
def _set_system(legs: Array, y: Array, problem: Problem, s: _Scratch, work: Workspace) -> None:
    """Fill `s.matrix` and the right side `s.vector` of Newton's method, but for the last entry; sets the rod table."""
    leg_count, count = legs.shape[0], y.shape[0]
    size, row = count - leg_count, count - leg_count
    if problem.is_singular:
        set_singularity_gradient(legs, y, problem.kind, s.beside, work, s.gradient)
    set_unknowns(legs, y, work)
    if problem.is_singular:
        s.matrix[row], s.vector[row] = s.gradient, -singularity(legs, y, problem.kind, work)
        row += 1
    for condition in problem.conditions:
        s.matrix[row] = condition
        s.vector[row] = 0.0
        for j in range(count):
            s.vector[row] -= condition[j] * (y[j] - s.y[j])
        row += 1
    s.matrix[row] = s.border
    set_residual(legs, y[:size], problem.load, work)
    set_matrix(legs, y[:size], work)
    s.matrix[:size, :size] = work.matrix[:size, :size]
    for i in range(leg_count):
        work.vector[:] = 0.0
        add_input_derivative(legs, y[:size], work, i, 1.0, work.vector)
        s.matrix[:size, size + i] = work.vector[:size]
    for j in range(size):
        s.vector[j] = -work.residual[j]


@kernel
def _correct(legs: Array, arc: float, problem: Problem, s: _Scratch, work: Workspace) -> bool:
    """Find the point of the curve at `arc` along `s.tangent` from `s.y`, on the plane across it; fill `s.trial`."""
    count = s.y.shape[0]
    size = count - legs.shape[0]
    for j in range(count):
        s.trial[j] = s.y[j] + arc * s.tangent[j]
    previous = math.inf
    for iteration in range(_STEP_RULES.iterations):
        _set_system(legs, s.trial, problem, s, work)
        gap = -arc
        for j in range(count):
            gap += s.border[j] * (s.trial[j] - s.y[j])
        s.vector[count - 1] = -gap
        if not solve_linear(s.matrix, s.vector, count):
            return False
        work.step[:] = s.vector[:size]
        correction = correction_size(legs, s.trial[:size], work)
        for j in range(size, count):
            correction = max(correction, abs(s.vector[j]))
        if iteration == 0 and correction > _STEP_RULES.first_correction:
            return False
        if not correction <= max(_STEP_RULES.contraction * previous, ROUNDING) or correction == math.inf:
            return False
        s.trial[:] += s.vector
        if is_last(correction, previous):
            return True
        previous = correction
    return False


@kernel
def _set_tangent(legs: Array, y: Array, problem: Problem, s: _Scratch, work: Workspace, tangent: Array) -> bool:
    """Fill `tangent` with the unit tangent at `y` on the side of `s.border`; leaves the rod table of `y`."""
    count = y.shape[0]
    _set_system(legs, y, problem, s, work)
    s.vector[:] = 0.0
    s.vector[count - 1] = 1.0
    if not solve_linear(s.matrix, s.vector, count):
        return False
    tangent[:] = s.vector
    length = metric_length(legs, tangent, s.vector, work)
    tangent /= length
    return length > 0.0 and math.isfinite(length)


@kernel
def _go_on(legs: Array, y: Array, tangent: Array, problem: Problem, s: _Scratch, work: Workspace) -> None:
    """Make `y` with its `tangent` the last point, and set its rod table."""
    s.y[:] = y
    s.tangent[:] = tangent
    set_unknowns(legs, y, work)
    metric_length(legs, tangent, s.border, work)
    if problem.is_singular:
        set_normal(legs, y, problem.kind, work, s.normal)


@kernel
def _start(legs: Array, y: Array, sign: float, problem: Problem, s: _Scratch, work: Workspace) -> bool:
    for j in range(y.shape[0]):
        s.border[j] = math.cos(1.0 + 3.0 * j)  # any direction that is not across the tangent
    s.y[:] = y
    if not _set_tangent(legs, y, problem, s, work, s.trial_tangent):
        return False
    s.trial_tangent[:] *= sign
    _go_on(legs, y, s.trial_tangent, problem, s, work)
    return True


@kernel
def _room(legs: Array, y: Array, problem: Problem) -> float:
    """Return how far the unknowns are from the edge of the box or a rod from the largest load; negative outside."""
    room = math.inf
    for i in range(legs.shape[0]):
        room = min(room, problem.rho_max - math.sqrt(math.hypot(y[2 * i], y[2 * i + 1])))
    for k in range(2 * legs.shape[0], y.shape[0]):
        room = min(room, y[k] - problem.box[k, 0], problem.box[k, 1] - y[k])
    return room + _ROOM_TOLERANCE


@kernel
def _projected(tangent: Array, other: Array, legs: Array, kind: int) -> float:
    """Return the product of two tangents' projections: to inputs for forward singularities, else to poses."""
    pose, size = 2 * legs.shape[0], tangent.shape[0] - legs.shape[0]
    first, last = (size, tangent.shape[0]) if kind == FORWARD else (pose, size)
    product = 0.0
    for k in range(first, last):
        product += tangent[k] * other[k]
    return product


@kernel
def _watched(legs: Array, watch: int, problem: Problem, s: _Scratch, work: Workspace) -> float:
    """Return the value at `s.trial` whose sign is watched."""
    if watch == _ROOM:
        return _room(legs, s.trial, problem)
    if watch == _SINGULARITY:
        set_unknowns(legs, s.trial, work)
        return singularity(legs, s.trial, problem.kind, work)
    return _projected(s.trial_tangent, s.direction, legs, problem.kind)


@kernel
def _move(legs: Array, arc: float, problem: Problem, s: _Scratch, work: Workspace) -> bool:
    """Put the point at `arc` from the last one into `s.trial`, with its tangent; return whether that succeeded."""
    return _correct(legs, arc, problem, s, work) and _set_tangent(legs, s.trial, problem, s, work, s.trial_tangent)


@kernel
def _locate(
    legs: Array, watch: int, arc: float, first: float, second: float, problem: Problem, s: _Scratch, work: Workspace
) -> float:
    """Move to where the watched value, `first` at the last point and `second` at `arc`, changes its sign.

    Returns the arc there, or 0 if the curve could not be followed. Regula falsi with Illinois' halving.
    """
    low, high, middle, kept = 0.0, arc, arc, 0
    for iteration in range(_MOST_BISECTIONS):
        part = first / (first - second) if iteration % 4 < 3 else 0.5
        middle = low + min(max(part, 1e-3), 1.0 - 1e-3) * (high - low)
        if not _move(legs, middle, problem, s, work):
            return 0.0
        value = _watched(legs, watch, problem, s, work)
        if (value > 0.0) == (first > 0.0):
            low, first = middle, value
            second *= 0.5 if kept > 0 else 1.0
            kept = 1
        else:
            high, second = middle, value
            first *= 0.5 if kept < 0 else 1.0
            kept = -1
        if high - low < _ARC_TOLERANCE or value == 0.0:
            break
    return middle


@kernel
def _set_change(legs: Array, y: Array, other: Array, problem: Problem, out: Array) -> None:
    """Fill `out` with the way from `y` to `other`, of angles the shorter one."""
    for k in range(y.shape[0]):
        out[k] = other[k] - y[k]
        if problem.box[k, 2] > 0.0:
            out[k] -= problem.box[k, 2] * round(out[k] / problem.box[k, 2])


@kernel
def _meets(legs: Array, other: Array, reach: float, problem: Problem, s: _Scratch, work: Workspace) -> bool:
    """Move to `other` if it lies on the curve at most `reach` after the last point; return whether it does."""
    count, pose = s.y.shape[0], 2 * legs.shape[0]
    _set_change(legs, s.y, other, problem, s.change)
    arc = 0.0
    for j in range(count):
        if j >= pose and abs(s.change[j]) > 2.0 * reach:
            return False
        arc += s.border[j] * s.change[j]
    if not -_SAME_POINT < arc <= reach * (1.0 + _SAME_POINT) + _SAME_POINT:
        return False
    if not _move(legs, arc, problem, s, work):
        return False
    for j in range(count):
        s.change[j] += s.y[j] - s.trial[j]
    return metric_length(legs, s.change, s.vector, work) < _SAME_POINT


@kernel
def _step(legs: Array, arc: float, problem: Problem, s: _Scratch, work: Workspace) -> tuple[float, float]:
    """Move by `arc`, or as much of it as is safe; return how far, 0 if not at all, and the tangent's turn."""
    while arc > _LEAST_ARC:
        if _move(legs, arc, problem, s, work):
            metric_length(legs, s.trial_tangent, s.vector, work)
            cosine = 0.0  # as the metrics of both ends see it: one alone would take its own change for a turn
            for j in range(s.y.shape[0]):
                cosine += 0.5 * (s.border[j] * s.trial_tangent[j] + s.vector[j] * s.tangent[j])
            turn = math.acos(min(max(cosine, -1.0), 1.0))
            if turn < _LARGEST_TURN and (not problem.is_singular or _sees_cusps(legs, arc, problem, s, work)):
                return arc, turn
        arc *= 0.5
    return 0.0, 0.0


@kernel
def _sees_cusps(legs: Array, arc: float, problem: Problem, s: _Scratch, work: Workspace) -> bool:
    """Return whether the step to `s.trial` is so short that a cusp on it shows in the tangents at its ends.

    The projected curve's normal turns little then: both tangents are along it, one this way, one that.
    """
    set_normal(legs, s.trial, problem.kind, work, s.trial_normal)
    cosine = 0.0
    for k in range(legs.shape[0]):
        cosine += s.normal[k] * s.trial_normal[k]
    return arc < _FIRST_ARC or not abs(cosine) < _LEAST_NORMAL_COSINE


@kernel
def _end_step(
    legs: Array, arc: float, start: Array, may_close: bool, problem: Problem, s: _Scratch, work: Workspace
) -> tuple[float, int]:
    """Cut the step of `arc` where the curve ends; return its length and how it ended, `_GOES_ON` if it did not."""
    room = _room(legs, s.trial, problem)
    if room < 0.0:
        arc = _locate(legs, _ROOM, arc, max(_room(legs, s.y, problem), 0.0), room, problem, s, work)
        for i in range(legs.shape[0]):
            if problem.rho_max - math.sqrt(math.hypot(s.trial[2 * i], s.trial[2 * i + 1])) < _ROOM_TOLERANCE:
                return arc, LARGEST_LOAD
        return arc, OUT_OF_BOX
    if may_close and _meets(legs, start, arc, problem, s, work):
        return arc, CLOSED
    if may_close and not _move(legs, arc, problem, s, work):
        return 0.0, FAILED
    return arc, _GOES_ON


@kernel
def _mark_step(
    legs: Array, arc: float, value: float, problem: Problem, s: _Scratch, work: Workspace
) -> tuple[bool, float]:
    """Move to the singular state of a line, or to the cusp, within the step of `arc`; return whether there is one.

    `value` is the singularity before the step, the second result that at its end.
    """
    if not problem.is_singular:
        after = _watched(legs, _SINGULARITY, problem, s, work)
        if value * after >= 0.0:
            return False, after
        return _locate(legs, _SINGULARITY, arc, value, after, problem, s, work) > 0.0, after
    if _projected(s.tangent, s.trial_tangent, legs, problem.kind) >= 0.0:
        return False, value
    s.direction[:] = s.tangent - s.trial_tangent
    first = _projected(s.tangent, s.direction, legs, problem.kind)
    second = _projected(s.trial_tangent, s.direction, legs, problem.kind)
    speed = math.sqrt(_projected(s.direction, s.direction, legs, problem.kind))
    if speed < _LEAST_SPEED:
        return False, value
    found = _locate(legs, _DIRECTION, arc, first, second, problem, s, work) > 0.0
    left = math.sqrt(_projected(s.trial_tangent, s.trial_tangent, legs, problem.kind))
    return found and left < _CUSP_SPEED * speed, value


@kernel
def trace(
    legs: Array, y: Array, sign: float, problem: Problem, path: Array, tangents: Array, marks: Mask
) -> tuple[int, int]:
    """Trace the curve from its point `y` to one side; fill `path` and `tangents` (m, size + legs) and `marks` (m,).

    Marked are the singular states on a line and the cusps of a singular curve's projection. Returns the number of
    points, the first of which is `y`, and how the curve ended.
    """
    s, work = _make_scratch(y.shape[0], legs.shape[0]), make_workspace(legs.shape[0], y.shape[0] - legs.shape[0])
    path[0], marks[0] = y, False
    if not _start(legs, y, sign, problem, s, work):
        return 1, FAILED
    tangents[0] = s.tangent
    value = singularity(legs, y, problem.kind, work)
    count, arc = 1, _FIRST_ARC
    while count < path.shape[0] - 1:
        arc, turn = _step(legs, arc, problem, s, work)
        if arc == 0.0:
            return count, FAILED
        length, end = _end_step(legs, arc, y, count > 2, problem, s, work)
        if length == 0.0:
            return count, FAILED
        path[count + 1], tangents[count + 1] = s.trial, s.trial_tangent
        is_marked, value = _mark_step(legs, length, value, problem, s, work)
        if is_marked:
            path[count], tangents[count], marks[count] = s.trial, s.trial_tangent, True
            count += 1
        else:
            path[count], tangents[count] = path[count + 1], tangents[count + 1]
        marks[count] = False
        _go_on(legs, path[count], tangents[count], problem, s, work)
        count += 1
        if end != _GOES_ON:
            return count, end
        growth = _WANTED_TURN / max(turn, _WANTED_TURN / _LARGEST_GROWTH)
        arc = min(arc * max(growth, _LEAST_GROWTH), _LARGEST_ARC)
    return count, TOO_LONG


@kernel
def is_on_path(legs: Array, y: Array, problem: Problem, path: Array, tangents: Array) -> bool:
    """Return whether the curve with these points and tangents passes through `y`."""
    s, work = _make_scratch(y.shape[0], legs.shape[0]), make_workspace(legs.shape[0], y.shape[0] - legs.shape[0])
    pose = 2 * legs.shape[0]
    for k in range(path.shape[0] - 1):
        reach = near = 0.0
        _set_change(legs, path[k], y, problem, s.change)
        for j in range(pose, y.shape[0]):
            reach = max(reach, abs(path[k + 1, j] - path[k, j]))
            near = max(near, abs(s.change[j]))
        if near > _NEARBY * reach + _LARGEST_ARC * _LARGEST_TURN:
            continue
        _go_on(legs, path[k], tangents[k], problem, s, work)
        _set_change(legs, path[k], path[k + 1], problem, s.change)
        arc = 0.0
        for j in range(y.shape[0]):
            arc += s.border[j] * s.change[j]
        if _meets(legs, y, arc, problem, s, work):
            return True
    return False


@kernel
def point_beside(
    legs: Array, y: Array, tangent: Array, arc: float, problem: Problem, beside: Array, tangent_beside: Array
) -> bool:
    """Fill `beside` and `tangent_beside` with the point of the curve at `arc` from `y`; return whether it was found."""
    s, work = _make_scratch(y.shape[0], legs.shape[0]), make_workspace(legs.shape[0], y.shape[0] - legs.shape[0])
    _go_on(legs, y, tangent, problem, s, work)
    found = _move(legs, arc, problem, s, work)
    beside[:], tangent_beside[:] = s.trial, s.trial_tangent
    return found


@kernel
def polish(legs: Array, y: Array, last_condition: Array, problem: Problem) -> bool:
    """Correct `y` in place to the point near it that meets the problem and a last linear condition."""
    s, work = _make_scratch(y.shape[0], legs.shape[0]), make_workspace(legs.shape[0], y.shape[0] - legs.shape[0])
    s.y[:] = y
    s.border[:] = last_condition
    found = _correct(legs, 0.0, problem, s, work)
    y[:] = s.trial
    return found


@kernel
def crossing_segments(first: Array, second: Array, periods: Array, is_same: bool, pairs: Integers) -> int:
    """Find the segments of two polylines (m, 2) in a plane, periodic where `periods` (2,) is not 0, that cross.

    Puts their numbers into `pairs` (k, 2) and returns how many there are, more than k if there is no room for all. Of
    one polyline with itself neighbouring segments are left out.
    """
    count, shift = 0, np.zeros(2)
    for k in range(first.shape[0] - 1):
        for n in range(k + 2 if is_same else 0, second.shape[0] - 1):
            is_near = True
            for d in range(2):
                gap = second[n, d] - first[k, d]
                shift[d] = periods[d] * round(gap / periods[d]) if periods[d] > 0.0 else 0.0
                reach = abs(first[k + 1, d] - first[k, d]) + abs(second[n + 1, d] - second[n, d])
                is_near = is_near and abs(gap - shift[d]) <= reach
            if is_near and _cross(first[k], first[k + 1], second[n] - shift, second[n + 1] - shift):
                if count < pairs.shape[0]:
                    pairs[count, 0], pairs[count, 1] = k, n
                count += 1
    return count


@kernel
def _cross(a: Array, b: Array, c: Array, d: Array) -> bool:
    return bool(_side(a, b, c) * _side(a, b, d) <= 0.0 and _side(c, d, a) * _side(c, d, b) <= 0.0)


@kernel
def _side(a: Array, b: Array, point: Array) -> float:
    return float((b[0] - a[0]) * (point[1] - a[1]) - (b[1] - a[1]) * (point[0] - a[0]))
