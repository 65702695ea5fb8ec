"""The table of learning algorithms. A new one is a line here."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pkgutil import resolve_name
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:  # it loads torch, which the table does without
    from stable_baselines3.common.base_class import BaseAlgorithm


@dataclass(frozen=True)
class Algorithm:
    """An algorithm that can be chosen by name.

    Attributes
    ----------
    path
        Where its class is, ``package.module:name``; imported when it is needed.
    is_off_policy
        Whether it learns from a replay buffer, which hindsight needs.
    defaults
        Hyperparameters that hold unless an experiment says otherwise.
    """

    path: str
    is_off_policy: bool = False
    defaults: Mapping[str, Any] = field(default_factory=lambda: {"gamma": 0.99})

    def load_class(self) -> "type[BaseAlgorithm]":
        """Class of the algorithm."""
        return resolve_name(self.path)  # type: ignore[no-any-return]


ALGORITHMS: dict[str, Algorithm] = {
    "PPO": Algorithm("stable_baselines3:PPO"),
    "A2C": Algorithm("stable_baselines3:A2C"),
    "SAC": Algorithm("stable_baselines3:SAC", is_off_policy=True),
    "TD3": Algorithm("stable_baselines3:TD3", is_off_policy=True),
    "DDPG": Algorithm("stable_baselines3:DDPG", is_off_policy=True),
}
