"""What every task has: goals, the way they move, and how episodes are drawn."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from pcm_gym.arrays import Array
from pcm_gym.kernels.statics.states import States
from pcm_gym.mechanism import Mechanism
from pcm_gym.tasks.goals import Goals
from pcm_gym.tasks.scene import Scene

Generators = Sequence[np.random.Generator]


@dataclass(frozen=True)
class Episodes:
    """Starts and goals, dimensionless as in the kernels, one row per episode."""

    states: States  # (n, ...)
    goals: Array  # (n, p, g): the goal of each step, over and over
    witness: States  # (n, ...): where the first goal is met


@dataclass(frozen=True)
class Task(ABC):
    """A task is what its goals are and how episodes are drawn; what it is to reach one, the goals tell themselves.

    Starts and goals
    ----------------
    Starts and goals that are drawn are stable equilibria, with a singularity margin of at least one and a half times
    `singular_margin`. `witness` is an equilibrium that meets the first goal; it is not observed. Same generator, same
    episode. What stable ways reach is charted when episodes are first drawn, which takes up to some seconds.

    Attributes
    ----------
    goals : Goals
    """

    # Steps that an episode lasts in the registered environments, those after which the goals begin again, and how many
    # steps ahead the agent sees the goal beside the present one.
    time_limit: ClassVar[int]
    period: ClassVar[int] = 1
    look_ahead: ClassVar[tuple[int, ...]] = ()

    goals: Goals

    @abstractmethod
    def sample(self, scene: Scene, generators: Generators, threads: int = 1) -> Episodes:
        """Return a new episode for each generator, which decides it alone: same scene, same numbers, same episode.

        Raises
        ------
        ValueError
            If the scene has no such episodes.
        """


def draw(generators: Generators, count: int) -> Array:
    """Return `count` numbers from [0, 1) of each generator, (n, count)."""
    return np.array([generator.random(count) for generator in generators]).reshape(-1, count)


def starts_of(scene: Scene, generators: Generators, threads: int) -> States:
    """Return the starts of episodes: the scene's origin, or states drawn evenly."""
    if scene.origin is not None:
        return scene.at_equilibrium(scene.origin, len(generators))
    return scene.starts(draw(generators, 1 + scene.mechanism.leg_count), threads)


def default_max_action(mechanism: Mechanism) -> Array:
    """Return the increment of each input for an action of 1: 0.1 rad, or 0.03 of the mean rod length."""
    return mechanism.units.inputs_from_kernel(np.array([leg.actuator.default_step for leg in mechanism.legs]))
