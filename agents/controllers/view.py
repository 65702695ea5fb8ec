"""What a controller sees."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pcm_gym.arrays import Integers, Mask
from pcm_gym.environments.batch import MechanismVectorEnv


@dataclass(frozen=True)
class View:
    """Episodes that run side by side, one in each of the n rows of a batch, before their next step.

    Attributes
    ----------
    env : MechanismVectorEnv
        The batch, for those who know the mechanics: the exact equilibrium, goal and mechanism. Not to be stepped.
    observation : dict of array (n, ...)
        What the environment tells; a learnt policy sees nothing else.
    elapsed : array (n,)
        Steps since each episode began; where it is 0, whatever is remembered of the row is of another episode.
    under_way : array (n,)
        In which rows there is an episode; the actions of the others do not count.
    generators : sequence of n generators
        A source of chance for each episode, which depends on nothing but its seed.
    """

    env: MechanismVectorEnv
    observation: dict[str, NDArray[Any]]
    elapsed: Integers
    under_way: Mask
    generators: Sequence[np.random.Generator]

    @property
    def rows(self) -> list[int]:
        """The rows in which there is an episode."""
        return np.flatnonzero(self.under_way).tolist()

    @property
    def action_shape(self) -> tuple[int, int]:
        """Shape of the actions of all rows, (n, actuators)."""
        return len(self.under_way), self.env.mechanism.leg_count
