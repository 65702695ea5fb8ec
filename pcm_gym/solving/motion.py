"""Motions: stable ways from one equilibrium to another, step by step, and why there may be none."""

from dataclasses import dataclass
from enum import Enum
from functools import cached_property
from typing import Any

import numpy as np

from pcm_gym.arrays import Array
from pcm_gym.mechanism import Mechanism
from pcm_gym.mechanism.validation import finite_array, finite_vector, instance_of
from pcm_gym.solving.equilibrium import Equilibrium


class Obstacle(Enum):
    """Why there is no motion; the value says it in words."""

    UNSTABLE_START = "the start is not stable, and a motion begins on stable equilibria"
    START_MARGIN = "no step from the start keeps the margin"
    OUT_OF_REACH = "the mechanism has no equilibrium at the goal"
    ONLY_UNSTABLE = "the mechanism has equilibria at the goal, but no stable one"
    LIMITS = "the mechanism has stable equilibria at the goal, but beyond the limits of its actuators"
    GOAL_MARGIN = "every stable equilibrium at the goal is nearer to a fold than the margin"
    STRUCTURE = "every stable equilibrium at the goal breaks a limit of the structure"
    MARGIN_ON_THE_WAY = "stable ways lead to the goal, but each comes nearer to a fold than the margin"
    STRUCTURE_ON_THE_WAY = "stable ways lead to the goal, but each breaks a limit of the structure"
    OTHER_SHEET = "the goal lies on another sheet: no way was found that leads there without losing stability"


class PlanningError(ValueError):
    """There is no motion.

    Attributes
    ----------
    obstacle : Obstacle
        Why.
    """

    def __init__(self, obstacle: Obstacle, details: str) -> None:
        super().__init__(obstacle, details)
        self.obstacle = obstacle
        self._details = details

    def __str__(self) -> str:
        """Return why there is none, and the numbers that belong to it."""
        return f"there is no motion: {self.obstacle.value} ({self._details})"


@dataclass(frozen=True, eq=False)
class Motion:
    """A motion on stable equilibria. `plan_motion` makes it.

    Every step was followed by the tracker: from each row on to the next one no stability is lost on the straight line
    of the inputs, and each row after the first keeps the margin and the limits of the structure that were asked for.

    Attributes
    ----------
    mechanism : Mechanism
    load : array (d,)
        Load on the end-effector, N and N m.
    inputs : array (n, legs)
        Inputs one after the other, those of the start first, rad or m.
    states : array (n, 2 legs + d)
        The kernels' dimensionless states there.
    """

    mechanism: Mechanism
    load: Array
    inputs: Array
    states: Array

    def __post_init__(self) -> None:
        mechanism = instance_of("mechanism", self.mechanism, Mechanism)
        inputs = finite_array("inputs", self.inputs, ("n", mechanism.leg_count))
        if not len(inputs):
            raise ValueError("inputs must have a row for the start, got none")
        checked: dict[str, Any] = {
            "load": finite_vector("load", self.load, mechanism.dof),
            "inputs": inputs,
            "states": finite_array("states", self.states, (len(inputs), mechanism.state_size)),
        }
        self.__dict__.update(checked)

    @property
    def length(self) -> int:
        """Number of steps; none if the start is at the goal."""
        return len(self.inputs) - 1

    @cached_property
    def equilibria(self) -> tuple[Equilibrium, ...]:
        """The equilibria, one for each row of the inputs."""
        return tuple(
            Equilibrium.unchecked(self.mechanism, state, inputs, self.load)
            for state, inputs in zip(self.states, self.inputs, strict=True)
        )

    @property
    def poses(self) -> Array:
        """Poses of the end-effector, (n, d), m and rad."""
        return self.mechanism.units.pose_from_kernel(self.states[:, 2 * self.mechanism.leg_count :])

    def path_length(self, step: Array) -> float:
        """Return how long the way of the inputs is where the longest step along each input, (legs,), counts one."""
        moves: Array = np.abs(np.diff(self.inputs, axis=0)) / finite_vector("step", step, self.mechanism.leg_count)
        return float(moves.max(axis=1, initial=0.0).sum())
