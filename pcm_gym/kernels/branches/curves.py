"""Tracing curves of equilibria in (state, inputs): of singular ones, or of all along a line, through folds and cusps.

A curve is what the residual, the linear conditions of the problem and, for singular states, their condition leave of
the unknowns y = (x, p), the state and the inputs; or the state and the one parameter of a way, a straight line in
inputs and load. It is followed by the steps of `tracer`, whose length is governed by the tangent's turn. In these
unknowns it is smooth also where its projection to inputs, poses or parameter folds or has a cusp.
"""

import math
from typing import NamedTuple

import numpy as np

from pcm_gym.arrays import Array, Integers, Mask
from pcm_gym.kernels.branches.problem import Problem, make_tracer_of
from pcm_gym.kernels.branches.singularity import FORWARD, metric_length, set_normal, singularity
from pcm_gym.kernels.branches.tracer import (
    Bracket,
    BracketRules,
    Tracer,
    accept,
    correct,
    cosine_of_turn,
    move,
    narrowed,
    next_trial,
    place_at,
    start,
)
from pcm_gym.kernels.numerics.compilation import kernel
from pcm_gym.kernels.statics.closure import Workspace, make_workspace
from pcm_gym.kernels.statics.newton import NewtonRules
from pcm_gym.kernels.statics.stability import assess_stability

# How a curve ended, or that it did not.
CLOSED, LARGEST_LOAD, OUT_OF_BOX, FAILED = range(4)
GOES_ON = -1
# What may change its sign within a step: room in the box and under the largest load, the singularity of a state on a
# line, or the direction of a singular curve's projection or of a way's parameter.
_ROOM, _SINGULARITY, _DIRECTION = range(3)


class CurveRules(NamedTuple):
    """How the steps along a curve are chosen, and when points of it are taken for one."""

    first_arc: float = 1e-3
    least_arc: float = 1e-9
    largest_arc: float = 0.1
    wanted_turn: float = 0.1  # of the tangent in one step, rad
    largest_turn: float = 0.25
    least_growth: float = 0.3  # of the arc from one step to the next
    largest_growth: float = 2.0
    least_normal_cosine: float = 0.85  # of the turn of the projected curve's normal in one step
    room: float = 1e-9  # how far from the edge of the box, or the largest load, is at it
    same_point: float = 1e-6
    nearby: float = 2.0  # a point is looked for on segments that it is no further from than this times their length
    # Part of its speed elsewhere in the step that a projection has left at a cusp: rounding. One slower than the least
    # speed all along is a point.
    cusp_speed: float = 1e-2
    least_speed: float = 1e-9
    # Between two points of a way its parameter is foreseen to slow down to no less than this part of its speed there.
    least_slowdown: float = 0.25
    beside: float = 1e-5  # how far from a branch point its branch is followed in its stead


_STEP_RULES = NewtonRules(first_correction=0.02, contraction=0.2, iterations=8)
_RULES = CurveRules()
_SIGN_RULES = BracketRules(trials=80, bisect_every=4, least_part=1e-3, weight=0.5, tolerance=1e-13)


class _Curve(NamedTuple):
    """A curve, where its tracing is, and scratch arrays."""

    problem: Problem
    tracer: Tracer
    work: Workspace
    change: Array  # (size + m,)
    direction: Array  # (size + m,): of a projection, whose sign is watched
    normal: Array  # (legs,): normal of the projected curve at the last point
    trial_normal: Array
    morse_index: Integers  # (1,): at the last point of a way


@kernel
def _make_curve(legs: Array, problem: Problem) -> _Curve:
    leg_count, count = legs.shape[0], problem.box.shape[0]
    t = make_tracer_of(legs, problem)
    normals, index = np.zeros((2, leg_count)), np.zeros(1, dtype=np.int64)
    work = make_workspace(leg_count, t.trial_x.shape[0])
    return _Curve(problem, t, work, np.zeros(count), np.zeros(count), normals[0], normals[1], index)


@kernel
def _is_way(problem: Problem) -> bool:
    """Return whether the curve is of all equilibria along one way; what its parameter does is watched, too."""
    return bool(problem.parameters.input_rates.shape[0] == 1)


@kernel
def _go_on(legs: Array, y: Array, tangent: Array, curve: _Curve) -> None:
    """Make `y` with its `tangent` the last point, and set its rod table."""
    t = curve.tracer
    t.trial[:], t.trial_tangent[:] = y, tangent
    place_at(legs, y, t, curve.work)
    accept(legs, t, curve.work)
    if curve.problem.is_singular:
        set_normal(legs, y, curve.problem.kind, curve.work, curve.normal)
    elif _is_way(curve.problem):
        curve.morse_index[0] = assess_stability(legs, t.x, curve.work).morse_index


@kernel
def _start(legs: Array, y: Array, sign: float, curve: _Curve) -> bool:
    t = curve.tracer
    for j in range(y.shape[0]):
        t.border[j] = math.cos(1.0 + 3.0 * j)  # any direction that is not across the tangent
    t.y[:] = y
    if not start(legs, sign, t, curve.work):
        return False
    _go_on(legs, y, t.tangent, curve)
    return True


@kernel
def _load_room(legs: Array, y: Array, problem: Problem) -> float:
    """Return how much more load the rod that is nearest to the largest one could take."""
    room = math.inf
    for i in range(legs.shape[0]):
        room = min(room, problem.rho_max - math.sqrt(math.hypot(y[2 * i], y[2 * i + 1])))
    return room


@kernel
def _room(legs: Array, y: Array, problem: Problem) -> float:
    """Return how far the unknowns are from the edge of the box or a rod from the largest load; negative outside."""
    room = _load_room(legs, y, problem)
    for k in range(2 * legs.shape[0], y.shape[0]):
        room = min(room, y[k] - problem.box[k, 0], problem.box[k, 1] - y[k])
    return room + _RULES.room


@kernel
def _projected(tangent: Array, other: Array, problem: Problem) -> float:
    """Return the product of two tangents' projections: to parameters for forward singularities, else to poses."""
    pose = 2 * problem.parameters.inputs.shape[0]
    size = pose + problem.parameters.load.shape[0]
    first, last = (size, tangent.shape[0]) if problem.kind == FORWARD else (pose, size)
    product = 0.0
    for k in range(first, last):
        product += tangent[k] * other[k]
    return product


@kernel
def _watched(legs: Array, watch: int, curve: _Curve) -> float:
    """Return the value at the trial whose sign is watched."""
    t, problem = curve.tracer, curve.problem
    if watch == _ROOM:
        return _room(legs, t.trial, problem)
    if watch == _SINGULARITY:
        place_at(legs, t.trial, t, curve.work)
        return singularity(legs, t.trial_x, problem.kind, curve.work)
    return _projected(t.trial_tangent, curve.direction, problem)


@kernel
def _locate(legs: Array, watch: int, arc: float, first: float, second: float, curve: _Curve) -> float:
    """Move to where the watched value, `first` at the last point and `second` at `arc`, changes its sign.

    Returns the arc there, or 0 if the curve could not be followed.
    """
    bracket, middle, rules = Bracket(0.0, first, arc, second, 0), arc, _SIGN_RULES
    for number in range(rules.trials):
        middle = next_trial(bracket, number, rules)
        if not move(legs, middle, _STEP_RULES, curve.tracer, curve.work):
            return middle if _is_way(curve.problem) and _bridge(legs, middle, curve) else 0.0
        value = _watched(legs, watch, curve)
        bracket = narrowed(bracket, middle, value, rules)
        if bracket.high - bracket.low < rules.tolerance or value == 0.0:
            break
    return middle


@kernel
def _bridge(legs: Array, arc: float, curve: _Curve) -> bool:
    """Move to the middle between two points beside `arc`: where branches cross, no correction succeeds."""
    t, beside = curve.tracer, min(_RULES.beside, 0.1 * arc)
    if not move(legs, arc - beside, _STEP_RULES, t, curve.work):
        return False
    trial, tangent = t.trial.copy(), t.trial_tangent.copy()
    if not move(legs, arc + beside, _STEP_RULES, t, curve.work):
        return False
    t.trial[:], t.trial_tangent[:] = 0.5 * (t.trial + trial), 0.5 * (t.trial_tangent + tangent)
    return True


@kernel
def _set_change(y: Array, other: Array, problem: Problem, out: Array) -> None:
    """Fill `out` with the way from `y` to `other`, of angles the shorter one."""
    for k in range(y.shape[0]):
        out[k] = other[k] - y[k]
        if problem.box[k, 2] > 0.0:
            out[k] -= problem.box[k, 2] * round(out[k] / problem.box[k, 2])


@kernel
def _meets(legs: Array, other: Array, reach: float, curve: _Curve) -> bool:
    """Move to `other` if it lies on the curve at most `reach` after the last point; return whether it does."""
    t, change, pose = curve.tracer, curve.change, 2 * legs.shape[0]
    _set_change(t.y, other, curve.problem, change)
    arc = 0.0
    for j in range(change.shape[0]):
        if j >= pose and abs(change[j]) > 2.0 * reach:
            return False
        arc += t.border[j] * change[j]
    if not -_RULES.same_point < arc <= reach * (1.0 + _RULES.same_point) + _RULES.same_point:
        return False
    if not move(legs, arc, _STEP_RULES, t, curve.work):
        return False
    for j in range(change.shape[0]):
        change[j] += t.y[j] - t.trial[j]
    return metric_length(legs, change, t.vector, curve.work) < _RULES.same_point


@kernel
def _step(legs: Array, arc: float, curve: _Curve) -> tuple[float, float]:
    """Move by `arc`, or as much of it as is safe; return how far, 0 if not at all, and the tangent's turn."""
    t = curve.tracer
    while arc > _RULES.least_arc:
        if move(legs, arc, _STEP_RULES, t, curve.work):
            turn = math.acos(min(max(cosine_of_turn(legs, t, curve.work), -1.0), 1.0))
            if turn < _RULES.largest_turn and _sees_all(legs, arc, curve):
                return arc, turn
        arc *= 0.5
    return 0.0, 0.0


@kernel
def _sees_all(legs: Array, arc: float, curve: _Curve) -> bool:
    """Return whether the step to the trial is so short that all that is marked on it shows at its ends."""
    if curve.problem.is_singular:
        return _sees_cusps(legs, arc, curve)
    return not _is_way(curve.problem) or arc < _RULES.first_arc or _sees_folds(legs, arc, curve)


@kernel
def _sees_folds(legs: Array, arc: float, curve: _Curve) -> bool:
    """Return whether the step to the trial meets one fold, or one change of index, or neither, but no more.

    Where the parameter turns round the index changes by one; the double zero of a branch point on a branch that turns
    round there is left to the shortest steps. Where it does not, the cubic through both ends must not slow down much:
    two folds would be near.
    """
    t = curve.tracer
    jump = abs(assess_stability(legs, t.trial_x, curve.work).morse_index - curve.morse_index[0])
    first, last = t.tangent[-1], t.trial_tangent[-1]
    if first * last < 0.0:
        return bool(jump == 1)
    if jump > 1:
        return False
    rise = (t.trial[-1] - t.y[-1]) / arc
    linear, squared = 6.0 * rise - 4.0 * first - 2.0 * last, 3.0 * (first + last - 2.0 * rise)
    place = -0.5 * linear / squared if squared != 0.0 else 0.0
    if not 0.0 < place < 1.0:
        return True
    least = (first + place * (linear + place * squared)) * math.copysign(1.0, first + last)
    return bool(least > _RULES.least_slowdown * min(abs(first), abs(last)))


@kernel
def _sees_cusps(legs: Array, arc: float, curve: _Curve) -> bool:
    """Return whether the step to the trial is so short that a cusp on it shows in the tangents at its ends.

    The projected curve's normal turns little then: both tangents are along it, one this way, one that.
    """
    set_normal(legs, curve.tracer.trial, curve.problem.kind, curve.work, curve.trial_normal)
    cosine = 0.0
    for k in range(legs.shape[0]):
        cosine += curve.normal[k] * curve.trial_normal[k]
    return arc < _RULES.first_arc or not abs(cosine) < _RULES.least_normal_cosine


@kernel
def _end_step(legs: Array, arc: float, first: Array, may_close: bool, curve: _Curve) -> tuple[float, int]:
    """Cut the step of `arc` where the curve ends; return its length and how it ended, `GOES_ON` if it did not."""
    t, problem = curve.tracer, curve.problem
    room = _room(legs, t.trial, problem)
    if room < 0.0:
        arc = _locate(legs, _ROOM, arc, max(_room(legs, t.y, problem), 0.0), room, curve)
        return arc, (LARGEST_LOAD if _load_room(legs, t.trial, problem) < _RULES.room else OUT_OF_BOX)
    if may_close and _meets(legs, first, arc, curve):
        return arc, CLOSED
    if may_close and not move(legs, arc, _STEP_RULES, t, curve.work):
        return 0.0, FAILED
    return arc, GOES_ON


@kernel
def _mark_step(legs: Array, arc: float, value: float, curve: _Curve) -> tuple[bool, float]:
    """Move to the singular state of a line, or to the cusp, within the step of `arc`; return whether there is one.

    `value` is the singularity before the step, the second result that at its end. On a way it may also be zero without
    a change of sign: where a branch turns round at a branch point.
    """
    t, direction, problem = curve.tracer, curve.direction, curve.problem
    if not problem.is_singular:
        after = _watched(legs, _SINGULARITY, curve)
        if value * after < 0.0:
            return _locate(legs, _SINGULARITY, arc, value, after, curve) > 0.0, after
        first, second = t.tangent[-1], t.trial_tangent[-1]
        if not _is_way(problem) or first * second >= 0.0:
            return False, after
        direction[:] = 0.0
        direction[-1] = 1.0
        return _locate(legs, _DIRECTION, arc, first, second, curve) > 0.0, after
    if _projected(t.tangent, t.trial_tangent, problem) >= 0.0:
        return False, value
    direction[:] = t.tangent - t.trial_tangent
    first, second = _projected(t.tangent, direction, problem), _projected(t.trial_tangent, direction, problem)
    speed = math.sqrt(_projected(direction, direction, problem))
    if speed < _RULES.least_speed:
        return False, value
    is_found = _locate(legs, _DIRECTION, arc, first, second, curve) > 0.0
    left = math.sqrt(_projected(t.trial_tangent, t.trial_tangent, problem))
    return is_found and left < _RULES.cusp_speed * speed, value


@kernel
def begin_trace(legs: Array, y: Array, sign: float, problem: Problem, tangent: Array, stage: Array) -> bool:
    """Fill `tangent` with that of the curve at its point `y`, to one side, and `stage` (3,); return whether it has one.

    The stage is for `trace`: the length of the next step, the singularity at the last point, the number of points.
    """
    curve = _make_curve(legs, problem)
    if not _start(legs, y, sign, curve):
        return False
    tangent[:] = curve.tracer.tangent
    stage[0], stage[1], stage[2] = (
        _RULES.first_arc,
        singularity(legs, curve.tracer.x, problem.kind, curve.work),
        1.0,
    )
    return True


@kernel
def trace(
    legs: Array, first: Array, problem: Problem, stage: Array, path: Array, tangents: Array, marks: Mask
) -> tuple[int, int]:
    """Go on tracing the curve that began in `first`; fill `path` and `tangents` (n, size + m) and `marks` (n,).

    Row 0 holds the last point so far, and its tangent. Marked are the singular states on a line and the cusps of a
    singular curve's projection. Returns the number of rows, row 0 included, and how the curve ended; `GOES_ON` if there
    is no room for more.
    """
    curve = _make_curve(legs, problem)
    t = curve.tracer
    _go_on(legs, path[0], tangents[0], curve)
    arc, value, before, count = stage[0], stage[1], stage[2] - 1.0, 1
    while count < path.shape[0] - 1:
        arc, turn = _step(legs, arc, curve)
        if arc == 0.0:
            return count, FAILED
        length, end = _end_step(legs, arc, first, before + count > 2.0, curve)
        if length == 0.0:
            return count, FAILED
        path[count + 1], tangents[count + 1] = t.trial, t.trial_tangent
        is_marked, value = _mark_step(legs, length, value, curve)
        if is_marked:
            path[count], tangents[count], marks[count] = t.trial, t.trial_tangent, True
            count += 1
        else:
            path[count], tangents[count] = path[count + 1], tangents[count + 1]
        marks[count] = False
        _go_on(legs, path[count], tangents[count], curve)
        count += 1
        if end != GOES_ON:
            return count, end
        growth = _RULES.wanted_turn / max(turn, _RULES.wanted_turn / _RULES.largest_growth)
        arc = min(arc * max(growth, _RULES.least_growth), _RULES.largest_arc)
    stage[0], stage[1], stage[2] = arc, value, before + count
    return count, GOES_ON


@kernel
def is_on_path(legs: Array, y: Array, problem: Problem, path: Array, tangents: Array) -> bool:
    """Return whether the curve with these points and tangents passes through `y`."""
    curve, pose = _make_curve(legs, problem), 2 * legs.shape[0]
    change, border = curve.change, curve.tracer.border
    for k in range(path.shape[0] - 1):
        reach = near = 0.0
        _set_change(path[k], y, problem, change)
        for j in range(pose, y.shape[0]):
            reach = max(reach, abs(path[k + 1, j] - path[k, j]))
            near = max(near, abs(change[j]))
        if near > _RULES.nearby * reach + _RULES.largest_arc * _RULES.largest_turn:
            continue
        _go_on(legs, path[k], tangents[k], curve)
        _set_change(path[k], path[k + 1], problem, change)
        arc = 0.0
        for j in range(y.shape[0]):
            arc += border[j] * change[j]
        if _meets(legs, y, arc, curve):
            return True
    return False


@kernel
def point_beside(
    legs: Array, y: Array, tangent: Array, arc: float, problem: Problem, beside: Array, tangent_beside: Array
) -> bool:
    """Fill `beside` and `tangent_beside` with the point of the curve at `arc` from `y`; return whether it was found."""
    curve = _make_curve(legs, problem)
    _go_on(legs, y, tangent, curve)
    is_found = move(legs, arc, _STEP_RULES, curve.tracer, curve.work)
    beside[:], tangent_beside[:] = curve.tracer.trial, curve.tracer.trial_tangent
    return is_found


@kernel
def polish(legs: Array, y: Array, last_condition: Array, problem: Problem) -> bool:
    """Correct `y` in place to the point near it that meets the problem and a last linear condition."""
    curve = _make_curve(legs, problem)
    curve.tracer.y[:], curve.tracer.border[:] = y, last_condition
    is_found = correct(legs, 0.0, _STEP_RULES, curve.tracer, curve.work)
    y[:] = curve.tracer.trial
    return is_found
