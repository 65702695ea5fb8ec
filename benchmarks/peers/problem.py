"""The task that every peer gets: a 2RFR led slowly around a closed path of inputs, and the tip's exact path.

Rods with EI = L = 1, motors at -0.2 and 0.2, as in the catalogue. From home both motors go around a circle of inputs in
100 steps, each one degree long, over stable equilibria and back home.
"""

import math
from functools import cache
from typing import NamedTuple

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import root

from pcm_gym.arrays import Array

BASES = (-0.2, 0.2)  # x of the motors; y is 0
HOME = np.radians([120.0, 60.0])
STEPS = 100
INCREMENT = math.radians(1.0)
# Towards both rods bowed more, where the tip moves most.
_TO_CENTRE = np.array([1.0, -1.0]) / math.sqrt(2.0)
# About the force on the first rod's tip, and the curvatures at the clamps, at home: Newton's method goes on from there.
_AT_HOME = (2.4, 0.0, -2.0, 2.0)


class Path(NamedTuple):
    """The closed path; its last step leads from the last row to the first, which is home."""

    inputs: Array  # (100, 2), rad
    unknowns: Array  # (100, 4): force on the first rod's tip, curvatures at the clamps
    tips: Array  # (100, 2), L


def inputs_on_path() -> Array:
    """Return the inputs of the path, (100, 2)."""
    radius = INCREMENT / (2.0 * math.sin(math.pi / STEPS))
    turns = 2.0 * math.pi * np.arange(STEPS) / STEPS
    sideways = np.array([-_TO_CENTRE[1], _TO_CENTRE[0]])
    path: Array = HOME + radius * ((1.0 - np.cos(turns))[:, None] * _TO_CENTRE + np.sin(turns)[:, None] * sideways)
    return path


def slopes(_: float, state: Array, force_x: float, force_y: float) -> tuple[float, ...]:
    """Return the derivatives along both rods of angle, curvature, x and y; `force` acts on the first rod's tip."""
    angle_1, curvature_1, _, _, angle_2, curvature_2, _, _ = state
    cos_1, sin_1, cos_2, sin_2 = math.cos(angle_1), math.sin(angle_1), math.cos(angle_2), math.sin(angle_2)
    bend_1, bend_2 = force_x * sin_1 - force_y * cos_1, force_y * cos_2 - force_x * sin_2
    return curvature_1, bend_1, cos_1, sin_1, curvature_2, bend_2, cos_2, sin_2


def clamped(inputs: Array, curvatures: Array) -> list[float]:
    """Return both rods' angle, curvature, x and y at the clamps."""
    return [inputs[0], curvatures[0], BASES[0], 0.0, inputs[1], curvatures[1], BASES[1], 0.0]


def misses(ends: Array) -> Array:
    """Return what must vanish at the common tip, (4,): the rods' curvatures there and the gap between them."""
    return np.array([ends[1], ends[5], ends[2] - ends[6], ends[3] - ends[7]])


@cache
def exact_path() -> Path:
    """Return the path with its exact solutions.

    By shooting with an integrator of order 8 at its tightest tolerance, without any code of the package.
    """
    path, unknowns, found, tips = inputs_on_path(), np.array(_AT_HOME), [], []
    for inputs in path:

        def ends(guess: Array, inputs: Array = inputs) -> Array:
            start = clamped(inputs, guess[2:])
            solved = solve_ivp(slopes, (0.0, 1.0), start, "DOP853", args=tuple(guess[:2]), rtol=2.3e-14, atol=1e-15)
            last: Array = solved.y[:, -1]
            return last

        unknowns = root(lambda guess, ends=ends: misses(ends(guess)), unknowns, tol=1e-14).x
        last = ends(unknowns)
        if np.abs(misses(last)).max() > 1e-11:
            raise RuntimeError(f"the exact path is lost at the inputs {inputs.tolist()}")
        found.append(unknowns)
        tips.append(0.5 * (last[2:4] + last[6:8]))
    return Path(path, np.array(found), np.array(tips))
