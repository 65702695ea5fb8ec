"""The first fold of a curve residual(z) = 0, z = (unknowns, parameter), by plain pseudo-arclength continuation."""

from collections.abc import Callable

import numpy as np
from scipy.optimize import brentq

from pcm_gym.arrays import Array

Function = Callable[[Array], Array]

_STEPS = 4000
_NEWTON_STEPS = 12


def _tangent(jacobian: Array, towards: Array) -> Array:
    """Return the unit null vector of the (n, n + 1) `jacobian` on the side of `towards`."""
    bordered = np.vstack([jacobian, towards])
    vector = np.linalg.solve(bordered, np.eye(len(towards))[-1])
    return vector / np.linalg.norm(vector)


def _correct(
    residual: Function, jacobian: Function, z: Array, tangent: Array, arc: float, scale: Array
) -> Array | None:
    """Return the point of the curve on the plane at `arc` along `tangent` from z, or None; all in scaled unknowns."""
    start, found = z / scale, z / scale + arc * tangent
    for _ in range(_NEWTON_STEPS):
        right = np.append(residual(found * scale), tangent @ (found - start) - arc)
        matrix = np.vstack([jacobian(found * scale) * scale, tangent])
        correction = np.linalg.solve(matrix, -right)
        found = found + correction
        size = np.linalg.norm(correction)
        if size > 2.0 * arc + 1e-6:
            return None
        if size < 1e-12 * (1.0 + np.linalg.norm(found)):
            return found * scale
    return None


def first_fold(
    residual: Function,
    jacobian: Function,
    start: Array,
    *,
    direction: float,
    limit: float,
    step: float,
    scale: Array | None = None,
) -> tuple[float, Array] | None:
    """Return (parameter, z) at the first fold on the way from `start` to the parameter `limit`, or None.

    `direction` is the sign with which the parameter, the last unknown, leaves. The fold is where its rate along the
    arc vanishes; found by bisection, its parameter is exact to the square of the arc's error.
    """
    scale = np.ones_like(start) if scale is None else scale
    z, arc = start, step
    towards = np.zeros_like(start)
    towards[-1] = direction
    tangent = _tangent(jacobian(z) * scale, towards)
    for _ in range(_STEPS):
        ahead = _correct(residual, jacobian, z, tangent, arc, scale)
        turned = None if ahead is None else _tangent(jacobian(ahead) * scale, tangent)
        if ahead is None or turned is None or turned @ tangent < 0.97:
            arc *= 0.5
            assert arc > 1e-9 * step, f"continuation stuck at parameter {z[-1]}"
            continue
        if turned[-1] * direction < 0.0:
            return _at_fold(residual, jacobian, z, tangent, arc, scale)
        if (ahead[-1] - limit) * direction >= 0.0:
            return None
        z, tangent, arc = ahead, turned, min(2.0 * arc, step)
    raise AssertionError(f"limit {limit} not reached, stopped at {z[-1]}")


def _at_fold(
    residual: Function, jacobian: Function, z: Array, tangent: Array, arc: float, scale: Array
) -> tuple[float, Array]:
    def point(part: float) -> Array:
        found = _correct(residual, jacobian, z, tangent, part, scale) if part > 0.0 else z
        assert found is not None
        return found

    def rate(part: float) -> float:
        return float(_tangent(jacobian(point(part)) * scale, tangent)[-1])

    at = point(float(brentq(rate, 0.0, arc, xtol=1e-14)))
    return float(at[-1]), at
