"""The nearest fold from a state in some space of parameters, by rays that are turned towards the fold's normal."""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from pcm_gym.arrays import Array

_RAYS = 128
# Rays much longer than the best so far are not tracked to their end.
_LONGEST = 1.5
_BEST_RAYS = 5
_DESCENT_STEPS, _HALVINGS = 100, 12
_DIRECTION_TOLERANCE = 1e-7
# Rays that end further from a right angle than this end at no smooth point of the folds; they are turned to all sides,
# by this at first.
_RIGHT_ANGLE, _FIRST_POLL = 1e-3, 0.05
_GOLDEN_ANGLE = math.pi * (3.0 - math.sqrt(5.0))


class Hit(NamedTuple):
    """Where a ray meets its first fold."""

    distance: float
    direction: Array  # of the ray, a unit vector of parameters
    state: Array
    parameters: Array


class Space(NamedTuple):
    """A space of parameters in which a fold is looked for."""

    size: int
    shoot: Callable[[Array, float], Hit | None]  # the first fold along a unit vector, within a distance
    normal: Callable[[Hit], Array]  # unit normal of the set of folds there


def nearest_hit(space: Space, reach: float) -> Hit | None:
    """Return the nearest fold within `reach`, or None if no ray meets one.

    Where the segment to the nearest point of a smooth set ends, it is at a right angle to it: the shortest rays are
    turned towards the fold's normal as long as that makes them shorter.
    """
    hits: list[Hit] = []
    for ray in _directions(space.size):
        hit = space.shoot(ray, reach)
        if hit is not None:
            hits.append(hit)
            reach = min(reach, _LONGEST * hit.distance)
    if not hits:
        return None
    hits.sort(key=lambda hit: hit.distance)
    return min((_descend(space, hit) for hit in hits[:_BEST_RAYS]), key=lambda hit: hit.distance)


def _turn(space: Space, hit: Hit) -> Array:
    """Return the way from the ray's direction to the normal on its side."""
    normal = space.normal(hit)
    return math.copysign(1.0, float(normal @ hit.direction)) * normal - hit.direction


def _descend(space: Space, hit: Hit) -> Hit:
    for _ in range(_DESCENT_STEPS):
        turn = _turn(space, hit)
        if np.linalg.norm(turn) < _DIRECTION_TOLERANCE:
            break
        shorter = _shorter(space, hit, turn)
        if shorter is None:
            break
        hit = shorter
    return hit


def _shorter(space: Space, hit: Hit, turn: Array) -> Hit | None:
    part = 1.0
    for _ in range(_HALVINGS):
        trial = hit.direction + part * turn
        found = space.shoot(trial / np.linalg.norm(trial), 1.5 * hit.distance)
        if found is not None and found.distance < hit.distance:
            return found
        part *= 0.5
    return None


def polled(space: Space, hit: Hit) -> Hit:
    """Turn a ray that ends at no right angle to all sides, as long as that makes it shorter: to a cusp, for one."""
    if np.linalg.norm(_turn(space, hit)) < _RIGHT_ANGLE:
        return hit
    step = _FIRST_POLL
    while step > _DIRECTION_TOLERANCE:
        across, _ = np.linalg.qr(np.column_stack([hit.direction, np.eye(len(hit.direction))]))
        trials = (hit.direction + way * side for side in across.T[1:] for way in (step, -step))
        found = (space.shoot(trial / np.linalg.norm(trial), hit.distance) for trial in trials)
        shorter = next((own for own in found if own is not None and own.distance < hit.distance), None)
        if shorter is None:
            step *= 0.5
        else:
            hit = shorter
    return hit


def _directions(count: int) -> Array:
    """Return unit vectors (m, count) spread over the circle or the sphere."""
    number = np.arange(_RAYS, dtype=np.float64)
    if count == 2:
        angles = 2.0 * math.pi * (number + 0.25) / _RAYS
        return np.column_stack([np.cos(angles), np.sin(angles)])
    height = 1.0 - (2.0 * number + 1.0) / _RAYS
    angles, radius = _GOLDEN_ANGLE * number, np.sqrt(1.0 - height * height)
    return np.column_stack([radius * np.cos(angles), radius * np.sin(angles), height])
