"""The view: which part of the plane a picture shows, and the pixels of its points."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from pcm_gym.arrays import Array
from pcm_gym.mechanism import Leg, Mechanism

Bounds = tuple[float, float, float, float]  # x_min, x_max, y_min, y_max, in m


@dataclass(frozen=True)
class Camera:
    """A fixed view of the plane, the same scale along both axes, y upwards.

    Attributes
    ----------
    size : (width, height)
        In pixels.
    centre : (x, y)
        The point in the middle of the picture, in m.
    scale : float
        Pixels per m.
    """

    size: tuple[int, int]
    centre: tuple[float, float]
    scale: float

    @classmethod
    def fit(cls, bounds: Bounds, size: tuple[int, int], margin: float = 0.0) -> "Camera":
        """Return the camera that shows `bounds` as large as `size` allows, with `margin` pixels around it."""
        x_min, x_max, y_min, y_max = bounds
        width, height = size
        scale = min((width - 2.0 * margin) / (x_max - x_min), (height - 2.0 * margin) / (y_max - y_min))
        return cls(size, (0.5 * (x_min + x_max), 0.5 * (y_min + y_max)), scale)

    def magnified(self, factor: int) -> "Camera":
        """Return the same view on `factor` times as many pixels each way."""
        width, height = self.size
        return Camera((factor * width, factor * height), self.centre, factor * self.scale)

    def pixels(self, points: ArrayLike) -> Array:
        """Return pixel coordinates (column, row) of world `points` (..., 2); (0, 0) is the upper left corner."""
        from_centre = np.asarray(points, dtype=np.float64) - self.centre
        return from_centre * (self.scale, -self.scale) + 0.5 * np.array(self.size)

    def points(self, pixels: ArrayLike) -> Array:
        """Return the world points (..., 2) at pixel coordinates (column, row), the inverse of `pixels`."""
        from_middle = np.asarray(pixels, dtype=np.float64) - 0.5 * np.array(self.size)
        points: Array = from_middle / (self.scale, -self.scale) + self.centre
        return points

    @property
    def bounds(self) -> Bounds:
        """What the picture shows, in m."""
        half_width, half_height = 0.5 * self.size[0] / self.scale, 0.5 * self.size[1] / self.scale
        x, y = self.centre
        return x - half_width, x + half_width, y - half_height, y + half_height


def reach_bounds(mechanism: Mechanism) -> Bounds:
    """Return a rectangle no part of the mechanism leaves while its inputs are within the limits, in m.

    It needs no solution: a rod of length L between its base b and its tip t stays within
    n . p <= (n . b + n . t + L) / 2 in every direction n, and its tip within reach of all the legs.
    """
    x_max, y_max = _farthest(mechanism, (1.0, 0.0)), _farthest(mechanism, (0.0, 1.0))
    return -_farthest(mechanism, (-1.0, 0.0)), x_max, -_farthest(mechanism, (0.0, -1.0)), y_max


def rail_ends(leg: Leg) -> Array:
    """Return the clamped base point at both limits of the leg's actuator, (2, 2), in m."""
    actuator = leg.actuator
    ends: Array = np.array(actuator.base) + np.outer(actuator.limits, actuator.axis)
    return ends


def _farthest(mechanism: Mechanism, direction: tuple[float, float]) -> float:
    legs = mechanism.legs
    bases = [float(np.max(rail_ends(leg) @ direction)) for leg in legs]

    def tip_limit(attachment: tuple[float, float]) -> float:
        spans = (math.dist(attachment, leg.attachment) for leg in legs)
        return min(base + leg.rod.length + span for base, leg, span in zip(bases, legs, spans, strict=True))

    tips = [tip_limit(leg.attachment) for leg in legs]
    middles = [0.5 * (base + tip + leg.rod.length) for base, tip, leg in zip(bases, tips, legs, strict=True)]
    return max(*bases, *tips, *middles, tip_limit((0.0, 0.0)))
