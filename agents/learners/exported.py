"""What acts: a model as it was learnt, or a policy that was exported."""

from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from agents.learners.settings import ModelError
from pcm_gym.arrays import Array
from pcm_gym.policies import Policy, PolicyError


class ActingPolicy(Protocol):
    """Whatever acts upon what it observes, and says how long it has learnt."""

    @property
    def training_steps(self) -> int:
        """Steps it was trained for."""

    @property
    def is_deterministic(self) -> bool:
        """Whether it acts without exploring."""

    def __call__(self, observation: dict[str, NDArray[Any]]) -> Array:
        """Actions (n, actuators) for observations (n, ...)."""


class ExportedPolicy:
    """A policy from a file, without torch; it does not explore.

    Parameters
    ----------
    policy
        As `pcm_gym.load_policy` returns it.
    """

    is_deterministic = True

    def __init__(self, policy: Policy) -> None:
        self._policy = policy
        self.card = policy.card

    @classmethod
    def load(cls, path: Path) -> "ExportedPolicy":
        """Read it from a file.

        Raises
        ------
        ModelError
            If there is none.
        """
        try:
            return cls(Policy.load(path))
        except PolicyError as error:
            raise ModelError(str(error)) from error

    @property
    def training_steps(self) -> int:
        """Steps it was trained for, as its card says."""
        return int(self.card.get("training_steps", 0))

    def __call__(self, observation: dict[str, NDArray[Any]]) -> Array:
        """Actions (n, actuators) for observations (n, ...)."""
        return self._policy(observation).astype(np.float64)
