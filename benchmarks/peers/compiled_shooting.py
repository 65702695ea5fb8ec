"""Shooting written by hand and compiled with Numba: the strongest simple opponent, and it knows only this mechanism.

Runge-Kutta's classical method with 20 steps per rod (an error of 2e-7 L), with the derivatives by force and
curvature at the clamp integrated along, and Newton's method on the four unknowns. All that makes it fast is used: the
first guess goes on in a straight line from the last two solutions, and once a correction is below 1e-5 the tip is
corrected to first order instead of shooting again, which costs an error of 1e-10. One mechanism, or many in a
compiled loop.
"""

import math
from typing import Any

import numba
import numpy as np

from benchmarks.peers.following import Places, Step
from benchmarks.peers.problem import BASES, exact_path
from pcm_gym.arrays import Array

_STEPS = 20
_LAST_CORRECTION = 1e-5
_MOST_CORRECTIONS = 20
_ROD = 16  # angle, curvature, x, y, and their derivatives by force x, force y and the clamp's curvature

compiled: Any = numba.njit(error_model="numpy")


@compiled
def _set_slopes(state: Any, force_x: Any, force_y: Any, slopes: Any) -> None:
    c, s = math.cos(state[0]), math.sin(state[0])
    turning = force_x * c + force_y * s
    slopes[0], slopes[1], slopes[2], slopes[3] = state[1], force_x * s - force_y * c, c, s
    for first in range(4, 16, 4):
        by_angle = state[first]
        slopes[first], slopes[first + 1] = state[first + 1], turning * by_angle
        slopes[first + 2], slopes[first + 3] = -s * by_angle, c * by_angle
    slopes[5] += s
    slopes[9] -= c


@compiled
def _shoot(angle: Any, base: Any, force_x: Any, force_y: Any, curvature: Any, work: Any) -> None:
    """Integrate a rod from its clamp to its tip, into the first row of `work` (6, 16)."""
    state, middle, k1, k2, k3, k4 = work[0], work[1], work[2], work[3], work[4], work[5]
    state[:] = 0.0
    state[0], state[1], state[2], state[13] = angle, curvature, base, 1.0
    h = 1.0 / _STEPS
    for _ in range(_STEPS):
        _set_slopes(state, force_x, force_y, k1)
        for i in range(_ROD):
            middle[i] = state[i] + 0.5 * h * k1[i]
        _set_slopes(middle, force_x, force_y, k2)
        for i in range(_ROD):
            middle[i] = state[i] + 0.5 * h * k2[i]
        _set_slopes(middle, force_x, force_y, k3)
        for i in range(_ROD):
            middle[i] = state[i] + h * k3[i]
        _set_slopes(middle, force_x, force_y, k4)
        for i in range(_ROD):
            state[i] += h / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i])


@compiled
def _solve(target: Any, unknowns: Any, tip: Any, work: Any, jacobian: Any, residual: Any) -> bool:
    """Bring the unknowns (force x, force y, curvatures) to these inputs; return whether Newton's method converged."""
    one, two = work[0], work[1]
    for _ in range(_MOST_CORRECTIONS):
        _shoot(target[0], BASES[0], unknowns[0], unknowns[1], unknowns[2], one)
        _shoot(target[1], BASES[1], -unknowns[0], -unknowns[1], unknowns[3], two)
        end_1, end_2 = one[0], two[0]
        residual[0], residual[1] = end_1[1], end_2[1]
        jacobian[0, 3] = jacobian[1, 2] = 0.0
        jacobian[0, 2], jacobian[1, 3] = end_1[13], end_2[13]
        for j in range(2):
            jacobian[0, j], jacobian[1, j] = end_1[5 + 4 * j], -end_2[5 + 4 * j]
        for i in range(2):
            residual[2 + i] = end_1[2 + i] - end_2[2 + i]
            jacobian[2 + i, 2], jacobian[2 + i, 3] = end_1[14 + i], -end_2[14 + i]
            for j in range(2):
                jacobian[2 + i, j] = end_1[6 + i + 4 * j] + end_2[6 + i + 4 * j]
        correction = np.linalg.solve(jacobian, residual)
        unknowns -= correction
        if np.abs(correction).max() < _LAST_CORRECTION:
            for i in range(2):
                by_unknowns = (
                    end_1[6 + i] * correction[0] + end_1[10 + i] * correction[1] + end_1[14 + i] * correction[2]
                )
                tip[i] = end_1[2 + i] - by_unknowns
            return True
    return False


@compiled
def _step_rows(targets: Any, unknowns: Any, before: Any, tips: Any, work: Any, jacobian: Any, residual: Any) -> bool:
    """Step every row; `before` holds the solutions of the step before the last one."""
    is_solved = True
    for row in range(targets.shape[0]):
        for i in range(4):
            last = unknowns[row, i]
            unknowns[row, i] += last - before[row, i]
            before[row, i] = last
        is_solved &= _solve(targets[row], unknowns[row], tips[row], work, jacobian, residual)
    return is_solved


def prepare(places: Places) -> Step:
    """Return the step of one mechanism, or of all rows, that begins at a place on the path or at one for each."""
    path = exact_path()
    unknowns = np.atleast_2d(path.unknowns[places])
    before, tips = unknowns.copy(), np.empty((len(unknowns), 2))
    work, jacobian, residual = np.empty((2, 6, _ROD)), np.empty((4, 4)), np.empty(4)

    def step(target: Array) -> Array:
        if not _step_rows(np.atleast_2d(target), unknowns, before, tips, work, jacobian, residual):
            raise RuntimeError("Newton's method did not converge on the path")
        return tips.reshape(target.shape)

    step(path.inputs[places])
    return step
