"""From the plain data of a configuration to the arguments of an algorithm of Stable-Baselines3."""

import inspect
from collections.abc import Mapping
from typing import Any

import numpy as np
from stable_baselines3.common.noise import NormalActionNoise
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from stable_baselines3.common.utils import LinearSchedule
from stable_baselines3.her import HerReplayBuffer
from torch import nn

from agents.learners.algorithms import ALGORITHMS
from agents.learners.features import GoalErrorFeatures
from agents.learners.settings import ConfigError, HindsightConfig, LearnerSettings

FEATURES: dict[str, type[BaseFeaturesExtractor]] = {"goal_error": GoalErrorFeatures}
ACTIVATIONS: dict[str, type[nn.Module]] = {"tanh": nn.Tanh, "relu": nn.ReLU, "elu": nn.ELU, "silu": nn.SiLU}


def hyperparameters_of(settings: LearnerSettings) -> dict[str, Any]:
    """Hyperparameters as plain data, the algorithm's defaults included."""
    return {**ALGORITHMS[settings.algorithm].defaults, **settings.hyperparameters}


def algorithm_arguments(settings: LearnerSettings, action_count: int) -> dict[str, Any]:
    """Keyword arguments of the algorithm.

    Raises
    ------
    ConfigError
        If the algorithm is not installed, or a hyperparameter unknown to it, or its value cannot be read.
    """
    try:
        known = inspect.signature(ALGORITHMS[settings.algorithm].load_class()).parameters
    except ModuleNotFoundError as error:
        raise ConfigError(f"algorithm {settings.algorithm}: {error}") from error
    unknown = sorted(settings.hyperparameters.keys() - known.keys())
    if unknown:
        raise ConfigError(f"hyperparameters unknown to {settings.algorithm}: {', '.join(unknown)}")
    arguments = {name: _schedule_or_value(name, value) for name, value in hyperparameters_of(settings).items()}
    if "policy_kwargs" in arguments:
        arguments["policy_kwargs"] = _policy_arguments(arguments["policy_kwargs"])
    if "action_noise" in arguments:
        arguments["action_noise"] = _action_noise(arguments["action_noise"], action_count)
    return arguments | _hindsight_arguments(settings.hindsight)


def _schedule_or_value(name: str, value: Any) -> Any:
    if name not in {"learning_rate", "clip_range"} or not isinstance(value, dict):
        return value
    if value.keys() != {"start", "end"}:
        raise ConfigError(
            f"hyperparameters.{name}: a schedule has the entries start and end, not {', '.join(sorted(value))}"
        )
    return LinearSchedule(value["start"], value["end"], end_fraction=1.0)


def _policy_arguments(arguments: dict[str, Any]) -> dict[str, Any]:
    tables: dict[str, Mapping[str, type]] = {"activation_fn": ACTIVATIONS, "features_extractor_class": FEATURES}
    named = {entry: _named(entry, arguments[entry], table) for entry, table in tables.items() if entry in arguments}
    return arguments | named


def _named(entry: str, name: Any, table: Mapping[str, type]) -> type:
    if name not in table:
        raise ConfigError(f"hyperparameters.policy_kwargs.{entry}: {name!r} is none of {', '.join(table)}")
    return table[name]


def _action_noise(value: Any, action_count: int) -> NormalActionNoise:
    if not isinstance(value, dict) or value.keys() != {"sigma"}:
        raise ConfigError("hyperparameters.action_noise: Gaussian noise is written {sigma: 0.1}")
    return NormalActionNoise(np.zeros(action_count), np.full(action_count, value["sigma"]))


def _hindsight_arguments(hindsight: HindsightConfig | None) -> dict[str, Any]:
    if hindsight is None:
        return {}
    buffer_arguments = {
        "n_sampled_goal": hindsight.goals_per_transition,
        "goal_selection_strategy": hindsight.strategy,
    }
    return {"replay_buffer_class": HerReplayBuffer, "replay_buffer_kwargs": buffer_arguments}
