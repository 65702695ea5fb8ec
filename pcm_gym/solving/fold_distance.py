"""How far an equilibrium is from the nearest fold of its own sheet, in the space of the inputs."""

import math
from dataclasses import dataclass

import numpy as np

from pcm_gym.arrays import Array
from pcm_gym.kernels.branches.continuation import FOLD, INDEX_CHANGE, follow_branch
from pcm_gym.kernels.branches.curves import Problem, polish
from pcm_gym.kernels.branches.singularity import FORWARD, normal_at
from pcm_gym.kernels.statics.closure import LOWER, UPPER
from pcm_gym.kernels.statics.states import Point
from pcm_gym.mechanism.validation import check_kinds, instance_of, positive_number
from pcm_gym.solving.equilibrium import Equilibrium

_RAYS = 128
# Rays much longer than the best so far are not tracked to their end.
_LONGEST = 1.5
_BEST_RAYS = 5
_DESCENT_STEPS, _HALVINGS = 100, 12
_DIRECTION_TOLERANCE = 1e-7
_GOLDEN_ANGLE = math.pi * (3.0 - math.sqrt(5.0))


@dataclass(frozen=True, eq=False)
class NearestFold:
    """The fold nearest to an equilibrium in the space of the inputs.

    Attributes
    ----------
    equilibrium : Equilibrium
        The equilibrium at the fold.
    distance : float
        Distance of the inputs, each in its unit: rad, or mean rod lengths.
    direction : array (legs,)
        Unit vector towards it, in the same units.
    """

    equilibrium: Equilibrium
    distance: float
    direction: Array

    def __post_init__(self) -> None:
        check_kinds(self, equilibrium=Equilibrium, distance=float, direction=np.ndarray)

    @property
    def inputs(self) -> Array:
        """Actuator inputs at the fold, rad or m."""
        return self.equilibrium.inputs


def nearest_fold(equilibrium: Equilibrium, reach: float | None = None) -> NearestFold | None:
    """Return the nearest fold that the inputs can be driven to, or None if there is none within `reach`.

    It lies on the edge of the equilibrium's own sheet. The shortest way to that edge is a straight line of inputs, so
    rays are tracked to their first fold, and the shortest are turned towards the fold's normal until they meet it at a
    right angle. Where a branch bifurcates counts as a fold.

    Parameters
    ----------
    equilibrium : Equilibrium
        Stable or not.
    reach : float, optional
        Largest distance looked at, in rad and mean rod lengths; by default the diagonal of the actuators' ranges. Their
        limits themselves are not regarded.

    Raises
    ------
    ValueError
        If `reach` is not finite and greater than 0.

    Notes
    -----
    Local minima of the distance that no ray comes near are missed: 128 rays are tracked. About 20 ms for two legs;
    `Equilibrium.singularity_margin` estimates the distance in microseconds.
    """
    instance_of("equilibrium", equilibrium, Equilibrium)
    if reach is None:
        mechanism = equilibrium.mechanism
        ranges = mechanism.units.kernel_from_inputs(mechanism.upper_limits - mechanism.lower_limits)
        reach = float(np.linalg.norm(ranges))
    return _Search(equilibrium, positive_number("reach", reach)).run()


class _Search:
    """The rays from one equilibrium, in dimensionless numbers."""

    def __init__(self, equilibrium: Equilibrium, reach: float) -> None:
        mechanism = equilibrium.mechanism
        self._start, self._reach = equilibrium, reach
        self._legs = mechanism.leg_table.copy()
        self._legs[:, LOWER], self._legs[:, UPPER] = -math.inf, math.inf
        _, self._inputs, self._load = equilibrium.kernel_values()

    def run(self) -> NearestFold | None:
        hits, reach = [], self._reach
        for ray in _directions(len(self._inputs)):
            hit = self._shoot(ray, reach)
            if hit is not None:
                hits.append(hit)
                reach = min(reach, _LONGEST * hit[0])
        if not hits:
            return None
        hits.sort(key=lambda hit: hit[0])
        distance, unknowns = min((self._descend(*hit) for hit in hits[:_BEST_RAYS]), key=lambda hit: hit[0])
        mechanism, size = self._start.mechanism, self._start.mechanism.state_size
        inputs = mechanism.units.inputs_from_kernel(unknowns[size:])
        direction = (unknowns[size:] - self._inputs) / distance
        fold = Equilibrium.unchecked(mechanism, unknowns[:size], inputs, self._start.load)
        return NearestFold(fold, distance, direction)

    def _shoot(self, direction: Array, reach: float) -> tuple[float, Array] | None:
        """Return distance and unknowns of the first fold along a unit vector of inputs."""
        point = Point(np.array(self._start.state), self._inputs.copy(), self._load.copy())
        event, _ = follow_branch(self._legs, point, self._inputs + reach * direction, self._load, False)
        if event not in (FOLD, INDEX_CHANGE):
            return None
        unknowns, size = np.concatenate([point.x, point.inputs]), len(point.x)
        across = np.zeros((len(point.inputs) - 1, len(unknowns)))
        across[:, size:] = _complement(direction)
        box = np.tile([-math.inf, math.inf, 0.0], (len(unknowns), 1))
        problem = Problem(self._load, across[:-1], box, math.inf, FORWARD, True)
        if not polish(self._legs, unknowns, across[-1], problem):
            return None
        return float(np.linalg.norm(unknowns[size:] - self._inputs)), unknowns

    def _descend(self, distance: float, unknowns: Array) -> tuple[float, Array]:
        """Turn the ray to this fold towards the fold's normal as long as that makes it shorter."""
        for _ in range(_DESCENT_STEPS):
            direction = (unknowns[-len(self._inputs) :] - self._inputs) / distance
            normal = normal_at(self._legs, unknowns, FORWARD)
            turn = math.copysign(1.0, float(normal @ direction)) * normal - direction
            if np.linalg.norm(turn) < _DIRECTION_TOLERANCE:
                break
            shorter = self._shorter(distance, direction, turn)
            if shorter is None:
                break
            distance, unknowns = shorter
        return distance, unknowns

    def _shorter(self, distance: float, direction: Array, turn: Array) -> tuple[float, Array] | None:
        part = 1.0
        for _ in range(_HALVINGS):
            trial = direction + part * turn
            hit = self._shoot(trial / np.linalg.norm(trial), 1.5 * distance)
            if hit is not None and hit[0] < distance:
                return hit
            part *= 0.5
        return None


def _directions(count: int) -> Array:
    """Return unit vectors (m, count) spread over the circle or the sphere."""
    number = np.arange(_RAYS, dtype=np.float64)
    if count == 2:
        angles = 2.0 * math.pi * (number + 0.25) / _RAYS
        return np.column_stack([np.cos(angles), np.sin(angles)])
    height = 1.0 - (2.0 * number + 1.0) / _RAYS
    angles, radius = _GOLDEN_ANGLE * number, np.sqrt(1.0 - height * height)
    return np.column_stack([radius * np.cos(angles), radius * np.sin(angles), height])


def _complement(direction: Array) -> Array:
    """Return orthonormal vectors (m - 1, m) across a unit vector."""
    full, _ = np.linalg.qr(np.column_stack([direction, np.eye(len(direction))]))
    across: Array = full[:, 1 : len(direction)].T
    return across
