"""Curves in state and parameters, traced to both sides of a point."""

from dataclasses import dataclass

import numpy as np

from pcm_gym.arrays import Array, Mask
from pcm_gym.kernels.branches import curves as tracing
from pcm_gym.kernels.branches.problem import Problem
from pcm_gym.solving.singular_curve import CurveEnd

# Points of a curve that are computed in one call of compiled code, and in all.
_POINTS_AT_ONCE, _MOST_POINTS = 1 << 9, 1 << 20
# The kernels' codes, in their order.
_ENDS = (CurveEnd.CLOSED, CurveEnd.LARGEST_LOAD, CurveEnd.BOUNDS, CurveEnd.SOLVER_FAILURE)


@dataclass(frozen=True)
class Traced:
    """A curve in the unknowns, state and parameters: its points, (n, size + m), with tangents, marks and ends."""

    path: Array
    tangents: Array
    marks: Mask
    ends: tuple[CurveEnd, CurveEnd]


def trace(legs: Array, problem: Problem, y: Array) -> Traced:
    """Return the curve of the problem through the point `y`."""
    path, tangents, marks, end = _trace_side(legs, problem, y, 1.0)
    if end is CurveEnd.CLOSED:
        return Traced(path, tangents, marks, (end, end))
    path_before, tangents_before, marks_before, end_before = _trace_side(legs, problem, y, -1.0)
    return Traced(
        np.vstack([path_before[:0:-1], path]),
        np.vstack([-tangents_before[:0:-1], tangents]),
        np.append(marks_before[:0:-1], marks),
        (end_before, end),
    )


def _trace_side(legs: Array, problem: Problem, y: Array, sign: float) -> tuple[Array, Array, Mask, CurveEnd]:
    stage, end = np.empty(3), CurveEnd.SOLVER_FAILURE
    paths, tangents, marks = [y[np.newaxis]], [np.empty((1, y.size))], [np.zeros(1, np.bool_)]
    if not tracing.begin_trace(legs, y, sign, problem, tangents[0][0], stage):
        return paths[0].copy(), tangents[0], marks[0], end
    while stage[2] < _MOST_POINTS:
        path, directions = np.empty((_POINTS_AT_ONCE, y.size)), np.empty((_POINTS_AT_ONCE, y.size))
        path[0], directions[0], is_marked = paths[-1][-1], tangents[-1][-1], np.empty(_POINTS_AT_ONCE, np.bool_)
        count, code = tracing.trace(legs, y, problem, stage, path, directions, is_marked)
        paths.append(path[1:count])
        tangents.append(directions[1:count])
        marks.append(is_marked[1:count])
        if code != tracing.GOES_ON:
            end = _ENDS[code]
            break
    return np.concatenate(paths), np.concatenate(tangents), np.concatenate(marks), end
