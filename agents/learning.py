"""The learner of an experiment: its environments, its algorithm, and snapshots of both."""

import inspect
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import stable_baselines3
from gymnasium.vector import AutoresetMode
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.noise import NormalActionNoise
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from stable_baselines3.common.utils import LinearSchedule
from stable_baselines3.common.vec_env import VecEnv, VecMonitor, VecNormalize
from stable_baselines3.her import HerReplayBuffer
from torch import nn

import pcm_gym  # noqa: F401 (registers the environments)
from agents.config import AlgorithmName, ConfigError, ExperimentConfig
from agents.features import GoalErrorFeatures
from agents.runs import MODEL, NORMALISATION, REPLAY_BUFFER
from agents.vector_adapter import CostPenalty, NativeVecEnv

FEATURES: dict[str, type[BaseFeaturesExtractor]] = {"goal_error": GoalErrorFeatures}
ACTIVATIONS: dict[str, type[nn.Module]] = {"tanh": nn.Tanh, "relu": nn.ReLU, "elu": nn.ELU, "silu": nn.SiLU}
DEFAULT_DISCOUNT = 0.99


def algorithm_class(name: AlgorithmName) -> type[BaseAlgorithm]:
    """Class of Stable-Baselines3 that carries the name."""
    return getattr(stable_baselines3, name)  # type: ignore[no-any-return]


def make_training_env(config: ExperimentConfig) -> VecEnv:
    """Native batch of the experiment's environment, its episodes monitored, its costs taken from the rewards."""
    batch = gymnasium.make_vec(
        config.environment.id,
        num_envs=config.num_envs,
        vectorization_mode="vector_entry_point",
        autoreset_mode=AutoresetMode.SAME_STEP,
        **config.environment.kwargs,
    )
    monitored = VecMonitor(NativeVecEnv(batch))
    return CostPenalty(monitored, config.cost_weight) if config.cost_weight > 0.0 else monitored


def new_learner(config: ExperimentConfig) -> BaseAlgorithm:
    """Learner that has not seen a step yet.

    Raises
    ------
    ConfigError
        If a hyperparameter is unknown to the algorithm or its value cannot be read.
    """
    env = _normalised(make_training_env(config), config)
    return algorithm_class(config.algorithm)(
        policy="MultiInputPolicy",
        env=env,
        seed=config.seed,
        device="cpu",
        **algorithm_arguments(config, action_count=int(np.prod(env.action_space.shape or (1,)))),
    )


def load_learner(config: ExperimentConfig, snapshot: Path) -> BaseAlgorithm:
    """Learner as it was when the snapshot was taken, on environments that begin new episodes.

    The new episodes are drawn from the seed and the number of steps done, so that none is met twice.
    """
    env = make_training_env(config)
    if (snapshot / NORMALISATION).exists():
        env = VecNormalize.load(str(snapshot / NORMALISATION), env)
    learner = algorithm_class(config.algorithm).load(snapshot / MODEL, env=env, device="cpu")
    if isinstance(learner, OffPolicyAlgorithm) and (snapshot / REPLAY_BUFFER).exists():
        with warnings.catch_warnings():
            # Right: the episodes under way when the snapshot was taken are not continued.
            warnings.filterwarnings("ignore", message="The last trajectory in the replay buffer will be truncated")
            learner.load_replay_buffer(snapshot / REPLAY_BUFFER)
    seed = np.random.SeedSequence([config.seed, learner.num_timesteps]).generate_state(1)[0]
    learner.set_random_seed(int(seed))
    return learner


def load_policy(config: ExperimentConfig, model: Path) -> BaseAlgorithm:
    """Model as it was saved, to act and not to learn: it has no environments and no replay buffer to speak of."""
    no_buffer: dict[str, Any] = {"replay_buffer_class": None, "replay_buffer_kwargs": {}, "buffer_size": 1}
    return algorithm_class(config.algorithm).load(model, device="cpu", custom_objects=no_buffer)


def save_learner(learner: BaseAlgorithm, folder: Path) -> None:
    """Write what `load_learner` needs."""
    learner.save(folder / MODEL)
    normaliser = learner.get_vec_normalize_env()
    if normaliser is not None:
        normaliser.save(str(folder / NORMALISATION))
    if isinstance(learner, OffPolicyAlgorithm):
        learner.save_replay_buffer(folder / REPLAY_BUFFER)


def algorithm_arguments(config: ExperimentConfig, action_count: int) -> dict[str, Any]:
    """Keyword arguments of the algorithm, from the plain data of the configuration.

    Raises
    ------
    ConfigError
        If a hyperparameter is unknown to the algorithm or its value cannot be read.
    """
    known = inspect.signature(algorithm_class(config.algorithm)).parameters
    unknown = sorted(config.hyperparameters.keys() - known.keys())
    if unknown:
        raise ConfigError(f"hyperparameters unknown to {config.algorithm}: {', '.join(unknown)}")
    arguments = {name: _schedule_or_value(name, value) for name, value in config.hyperparameters.items()}
    if "policy_kwargs" in arguments:
        arguments["policy_kwargs"] = _policy_arguments(arguments["policy_kwargs"])
    if "action_noise" in arguments:
        arguments["action_noise"] = _action_noise(arguments["action_noise"], action_count)
    return arguments | _hindsight_arguments(config)


def _normalised(env: VecEnv, config: ExperimentConfig) -> VecEnv:
    wanted = config.normalisation
    if not (wanted.observation or wanted.reward):
        return env
    return VecNormalize(
        env,
        norm_obs=wanted.observation,
        norm_obs_keys=["observation"],  # goals keep their units: what is achieved and what is desired compare
        norm_reward=wanted.reward,
        clip_obs=wanted.clip,
        clip_reward=wanted.clip,
        gamma=config.hyperparameters.get("gamma", DEFAULT_DISCOUNT),
    )


def _schedule_or_value(name: str, value: Any) -> Any:
    if name not in {"learning_rate", "clip_range"} or not isinstance(value, dict):
        return value
    if value.keys() != {"start", "end"}:
        raise ConfigError(f"{name}: a schedule has the entries start and end, not {', '.join(sorted(value))}")
    return LinearSchedule(value["start"], value["end"], end_fraction=1.0)


def _policy_arguments(arguments: dict[str, Any]) -> dict[str, Any]:
    tables: dict[str, Mapping[str, type]] = {"activation_fn": ACTIVATIONS, "features_extractor_class": FEATURES}
    named = {entry: _named(entry, arguments[entry], table) for entry, table in tables.items() if entry in arguments}
    return arguments | named


def _named(entry: str, name: Any, table: Mapping[str, type]) -> type:
    if name not in table:
        raise ConfigError(f"policy_kwargs.{entry}: {name!r} is none of {', '.join(table)}")
    return table[name]


def _action_noise(value: Any, action_count: int) -> NormalActionNoise:
    if not isinstance(value, dict) or value.keys() != {"sigma"}:
        raise ConfigError("action_noise: Gaussian noise is written {sigma: 0.1}")
    return NormalActionNoise(np.zeros(action_count), np.full(action_count, value["sigma"]))


def _hindsight_arguments(config: ExperimentConfig) -> dict[str, Any]:
    if config.hindsight is None:
        return {}
    buffer_arguments = {
        "n_sampled_goal": config.hindsight.goals_per_transition,
        "goal_selection_strategy": config.hindsight.strategy,
    }
    return {"replay_buffer_class": HerReplayBuffer, "replay_buffer_kwargs": buffer_arguments}
