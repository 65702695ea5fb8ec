"""How far an equilibrium is from the nearest fold of its own sheet, in the space of the inputs."""

import math
from dataclasses import dataclass

import numpy as np

from pcm_gym.arrays import Array
from pcm_gym.kernels.branches.continuation import FOLD, INDEX_CHANGE, follow_branch
from pcm_gym.kernels.branches.curves import polish
from pcm_gym.kernels.branches.problem import Problem, inputs_as_parameters
from pcm_gym.kernels.branches.singularity import FORWARD, normal_at
from pcm_gym.kernels.statics.closure import LOWER, UPPER
from pcm_gym.kernels.statics.states import Point
from pcm_gym.mechanism.validation import check_kinds, instance_of, positive_number
from pcm_gym.solving.equilibrium import Equilibrium
from pcm_gym.solving.fold_search import Hit, Space, nearest_hit


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
    return _Search(equilibrium).run(positive_number("reach", reach))


class _Search:
    """The rays of inputs from one equilibrium, in dimensionless numbers."""

    def __init__(self, equilibrium: Equilibrium) -> None:
        mechanism = equilibrium.mechanism
        self._start = equilibrium
        self._legs = mechanism.leg_table.copy()
        self._legs[:, LOWER], self._legs[:, UPPER] = -math.inf, math.inf
        _, self._inputs, self._load = equilibrium.kernel_values()

    def run(self, reach: float) -> NearestFold | None:
        mechanism, load = self._start.mechanism, self._start.load
        hit = nearest_hit(Space(len(self._inputs), self._shoot, self._normal), reach)
        if hit is None:
            return None
        inputs = mechanism.units.inputs_from_kernel(hit.parameters)
        fold = Equilibrium.unchecked(mechanism, hit.state, inputs, load)
        return NearestFold(fold, hit.distance, hit.direction)

    def _shoot(self, direction: Array, reach: float) -> Hit | None:
        point = Point(np.array(self._start.state), self._inputs.copy(), self._load.copy())
        event, _ = follow_branch(self._legs, point, self._inputs + reach * direction, self._load, False)
        if event not in (FOLD, INDEX_CHANGE):
            return None
        unknowns, size = np.concatenate([point.x, point.inputs]), len(point.x)
        across = np.zeros((len(point.inputs) - 1, len(unknowns)))
        across[:, size:] = _complement(direction)
        box = np.tile([-math.inf, math.inf, 0.0], (len(unknowns), 1))
        problem = Problem(inputs_as_parameters(self._load), across[:-1], box, math.inf, FORWARD, True)
        if not polish(self._legs, unknowns, across[-1], problem):
            return None
        way = unknowns[size:] - self._inputs
        distance = float(np.linalg.norm(way))
        return Hit(distance, way / distance, unknowns[:size], unknowns[size:])

    def _normal(self, hit: Hit) -> Array:
        return normal_at(self._legs, np.concatenate([hit.state, hit.parameters]), FORWARD)


def _complement(direction: Array) -> Array:
    """Return orthonormal vectors (m - 1, m) across a unit vector."""
    full, _ = np.linalg.qr(np.column_stack([direction, np.eye(len(direction))]))
    across: Array = full[:, 1 : len(direction)].T
    return across
