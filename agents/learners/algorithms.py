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
    extra
        The extra of the project that brings it.
    """

    path: str
    is_off_policy: bool = False
    defaults: Mapping[str, Any] = field(default_factory=lambda: {"gamma": 0.99})
    extra: str = "agents"

    def load_class(self) -> "type[BaseAlgorithm]":
        """Class of the algorithm.

        Raises
        ------
        ModuleNotFoundError
            If it is not installed; the message names the extra that brings it.
        """
        try:
            return resolve_name(self.path)  # type: ignore[no-any-return]  # a class
        except ModuleNotFoundError as error:
            hint = f"{error.name} is not installed: pip install -e '.[{self.extra}]'"
            raise ModuleNotFoundError(hint, name=error.name) from error


ALGORITHMS: dict[str, Algorithm] = {
    "PPO": Algorithm("agents.learners.fast_ppo:FastPPO"),
    "A2C": Algorithm("stable_baselines3:A2C"),
    "SAC": Algorithm("stable_baselines3:SAC", is_off_policy=True),
    "TD3": Algorithm("stable_baselines3:TD3", is_off_policy=True),
    "DDPG": Algorithm("stable_baselines3:DDPG", is_off_policy=True),
    "TQC": Algorithm("sb3_contrib:TQC", is_off_policy=True, extra="contrib"),
}
