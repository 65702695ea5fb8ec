"""One rod by numerical integration of its differential equation; no elliptic function, no code of the package.

From the tip, where the hinge leaves no curvature, to the base: with t the distance from the tip and tau the tangent's
angle seen from the tip's tangent, tau'' = g_x sin tau - g_y cos tau, tau(0) = tau'(0) = 0 (units L = EI = 1).
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.integrate import solve_ivp

from pcm_gym.arrays import Array

# The tightest that DOP853 accepts is 100 machine epsilons.
RELATIVE_TOL = 2.3e-14
# tau of a taut rod starts as g_y t^2 / 2: absolute tolerances are in that unit.
ABSOLUTE_TOL = 1e-16


class IntegratedRod(NamedTuple):
    """In the clamp's frame, units L, EI/L^2 and EI/L."""

    tip: Array
    force: Array
    energy: float
    angle: Callable[[Array], Array]  # tangent's angle at the distance s from the base, vectorised
    point: Callable[[Array], Array]  # (n, 2): centre line at the distances s from the base


def integrate_rod(g_x: float, g_y: float, relative_tol: float = RELATIVE_TOL) -> IntegratedRod:
    """Return the rod of the tip load (g_x, g_y), given in the tip's frame."""

    def slope(_: float, state: Array) -> list[float]:
        tau, rate = state[:2]
        return [rate, g_x * np.sin(tau) - g_y * np.cos(tau), np.cos(tau), np.sin(tau), 0.5 * rate**2]

    scale = min(1.0, abs(g_y)) if g_y != 0.0 else 1.0
    tolerances = ABSOLUTE_TOL / RELATIVE_TOL * relative_tol * np.array([scale, scale, 1.0, 1.0, 1.0])
    solved = solve_ivp(
        slope, (0.0, 1.0), np.zeros(5), method="DOP853", rtol=relative_tol, atol=tolerances, dense_output=True
    )
    assert solved.success, solved.message
    base_angle, _, x, y, energy = solved.y[:, -1]
    c, s = np.cos(base_angle), np.sin(base_angle)
    to_clamp = np.array([[c, s], [-s, c]])  # turns vectors by -base_angle
    tip = to_clamp @ np.array([x, y])

    def angle(distance: Array) -> Array:
        return solved.sol(1.0 - np.asarray(distance))[0] - base_angle

    def point(distance: Array) -> Array:
        to_tip = solved.sol(1.0 - np.asarray(distance))[2:4]
        return tip - (to_clamp @ to_tip).T

    return IntegratedRod(tip, to_clamp @ np.array([g_x, g_y]), float(energy), angle, point)
