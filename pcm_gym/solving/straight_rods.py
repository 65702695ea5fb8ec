"""The state of a mechanism in which all its rods are straight, if there is one."""

import math

import numpy as np

from pcm_gym.arrays import Array
from pcm_gym.kernels.enumeration.cells import hinge, reaching_input
from pcm_gym.kernels.statics.closure import (
    ATTACH_X,
    ATTACH_Y,
    AXIS_X,
    AXIS_Y,
    BASE_X,
    BASE_Y,
    CLAMP_ANGLE,
    LENGTH,
    TURN,
)

# How far from its hinge, in reference lengths, a straight rod may end.
_MISS = 1e-9


def straight_point(legs: Array, given: Array, *, is_inverse: bool) -> Array | None:
    """Return unloaded straight rods, their pose and inputs as one array (size + legs,); None if they do not meet.

    Parameters
    ----------
    legs : array (legs, 12)
    given : array
        The pose if that is given, else the inputs; dimensionless.
    is_inverse : bool
    """
    other = _reaching(legs, given) if is_inverse else _met(legs, _tips(legs, given))
    if other is None:
        return None
    pose, inputs = (given, other) if is_inverse else (other, given)
    return np.concatenate([np.zeros(2 * len(legs)), pose, inputs])


def _tips(legs: Array, inputs: Array) -> list[tuple[float, float]]:
    """Return the tips of straight rods."""
    tips = []
    for row, value in zip(legs.tolist(), inputs.tolist(), strict=True):
        angle = row[CLAMP_ANGLE] + row[TURN] * value
        x, y = row[BASE_X] + row[AXIS_X] * value, row[BASE_Y] + row[AXIS_Y] * value
        tips.append((x + row[LENGTH] * math.cos(angle), y + row[LENGTH] * math.sin(angle)))
    return tips


def _met(legs: Array, tips: list[tuple[float, float]]) -> Array | None:
    """Return the pose at which the hinges are at these places; None if there is none."""
    if len(tips) == 2:
        return np.array(tips[0]) if math.dist(*tips) < _MISS else None
    hinges = legs[:, ATTACH_X : ATTACH_Y + 1].tolist()
    for first, second in ((0, 1), (1, 2), (2, 0)):
        if abs(math.dist(tips[first], tips[second]) - math.dist(hinges[first], hinges[second])) > _MISS:
            return None
    places, arms = np.array(tips) @ (1.0, 1.0j), np.array(hinges) @ (1.0, 1.0j)
    turn = complex(np.vdot(arms - arms.mean(), places - places.mean()))
    turn /= abs(turn)
    origin = places.mean() - turn * arms.mean()
    if np.abs(origin + turn * arms - places).max() > _MISS:  # a mirror image
        return None
    return np.array([origin.real, origin.imag, math.atan2(turn.imag, turn.real)])


def _reaching(legs: Array, pose: Array) -> Array | None:
    """Return the inputs with which straight rods reach their hinges; None if they do not."""
    inputs = np.empty(len(legs))
    for leg in range(len(legs)):
        x, y = hinge(legs, leg, pose)
        if (
            legs[leg, TURN] != 0.0
            and abs(math.hypot(x - legs[leg, BASE_X], y - legs[leg, BASE_Y]) - legs[leg, LENGTH]) > _MISS
        ):
            return None
        inputs[leg] = reaching_input(legs, leg, x, y, 1.0, 0.0)
    tips = _tips(legs, inputs)
    reached = (math.dist(tip, hinge(legs, leg, pose)) < _MISS for leg, tip in enumerate(tips))
    return inputs if all(reached) else None
