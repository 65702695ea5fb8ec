"""The learner of an experiment: its environments, its algorithm, and snapshots of both."""

import pickle
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm
from stable_baselines3.common.vec_env import VecEnv, VecNormalize

from agents.learners import features
from agents.learners.algorithms import ALGORITHMS
from agents.learners.batches import make_batch
from agents.learners.files import MODEL, NORMALISATION, REPLAY_BUFFER
from agents.learners.hyperparameters import algorithm_arguments, hyperparameters_of
from agents.learners.imitation import Imitation
from agents.learners.lagrangian import CostController
from agents.learners.provenance import mark
from agents.learners.settings import AlgorithmName, ConfigError, LearnerSettings, ModelError
from agents.learners.vector_adapter import CostPenalty, EpisodeMonitor, NativeVecEnv
from pcm_gym.wrappers import VectorSolverShield

# A saved model names the module of its features: models saved while that was agents/features.py load as well.
sys.modules.setdefault("agents.features", features)


def make_training_env(settings: LearnerSettings) -> VecEnv:
    """Native batch of the experiment's environment, shielded or not, its episodes monitored, its costs penalised."""
    batch: Any = make_batch(settings.environment, settings.num_envs, AutoresetMode.SAME_STEP)
    monitored = EpisodeMonitor(NativeVecEnv(VectorSolverShield(batch) if settings.shield else batch))
    is_penalised = settings.cost_weight > 0.0 or settings.lagrangian is not None
    return CostPenalty(monitored, settings.cost_weight) if is_penalised else monitored


def new_learner(settings: LearnerSettings, kind: type[BaseAlgorithm] | None = None) -> BaseAlgorithm:
    """Learner that has not seen a step yet, of the class in the table or of another one to compare it with.

    Raises
    ------
    ConfigError
        If a hyperparameter is unknown to the algorithm or its value cannot be read.
    """
    env = _normalised(make_training_env(settings), settings)
    arguments = algorithm_arguments(settings, action_count=int(np.prod(env.action_space.shape or (1,))))
    try:
        return (kind or ALGORITHMS[settings.algorithm].load_class())(
            policy="MultiInputPolicy", env=env, seed=settings.seed, device="cpu", **arguments
        )
    except (AssertionError, TypeError, ValueError) as error:
        raise ConfigError(f"hyperparameters of {settings.algorithm}: {error}") from error


def load_learner(settings: LearnerSettings, snapshot: Path) -> BaseAlgorithm:
    """Learner as it was when the snapshot was taken, on environments that begin new episodes.

    The new episodes are drawn from the seed and the number of steps done, so that none is met twice.

    Raises
    ------
    ConfigError, ModelError
        If the environment cannot be made, or a file of the snapshot cannot be read.
    """
    env = make_training_env(settings)
    with reading(snapshot):
        if (snapshot / NORMALISATION).exists():
            env = VecNormalize.load(str(snapshot / NORMALISATION), env)
        learner = ALGORITHMS[settings.algorithm].load_class().load(snapshot / MODEL, env=env, device="cpu")
        if isinstance(learner, OffPolicyAlgorithm) and (snapshot / REPLAY_BUFFER).exists():
            with warnings.catch_warnings():
                # Right: the episodes under way when the snapshot was taken are not continued.
                warnings.filterwarnings("ignore", message="The last trajectory in the replay buffer will be truncated")
                learner.load_replay_buffer(snapshot / REPLAY_BUFFER)
    seed = np.random.SeedSequence([settings.seed, learner.num_timesteps]).generate_state(1)[0]
    learner.set_random_seed(int(seed))
    return learner


def learning_callbacks(settings: LearnerSettings) -> list[BaseCallback]:
    """What takes part in the learning beside the algorithm: imitation first, and who weighs the cost.

    Raises
    ------
    ConfigError
        If there is no such reference to imitate.
    """
    callbacks: list[BaseCallback] = []
    if settings.lagrangian is not None:
        callbacks.append(CostController(settings.lagrangian))
    if settings.imitation is not None:
        callbacks.append(Imitation(settings.imitation, settings.seed))
    return callbacks


def load_model(algorithm: AlgorithmName, model: Path) -> BaseAlgorithm:
    """Model as it was saved, to act and not to learn: it has no environments and no replay buffer to speak of."""
    no_buffer: dict[str, Any] = {"replay_buffer_class": None, "replay_buffer_kwargs": {}, "buffer_size": 1}
    with reading(model):
        return ALGORITHMS[algorithm].load_class().load(model, device="cpu", custom_objects=no_buffer)


def load_normaliser(normalisation: Path) -> VecNormalize:
    """Statistics that observations were normalised with, to act and not to learn."""
    with reading(normalisation):
        normaliser = pickle.loads(normalisation.read_bytes())
        if not isinstance(normaliser, VecNormalize):
            raise TypeError(f"it holds a {type(normaliser).__name__}")
    return normaliser


@contextmanager
def reading(path: Path) -> Iterator[None]:
    """Turn whatever reading a damaged file leads zipfile, pickle and torch to into a `ModelError`."""
    try:
        yield
    except Exception as error:
        raise ModelError(f"{path}: cannot be read as a trained model: {type(error).__name__}: {error}") from error


def save_learner(learner: BaseAlgorithm, folder: Path) -> None:
    """Write what `load_learner` needs."""
    learner.save(folder / MODEL)
    normaliser = learner.get_vec_normalize_env()
    if normaliser is not None:
        normaliser.save(str(folder / NORMALISATION))
    if isinstance(learner, OffPolicyAlgorithm):
        learner.save_replay_buffer(folder / REPLAY_BUFFER)
    mark(folder)


def _normalised(env: VecEnv, settings: LearnerSettings) -> VecEnv:
    wanted = settings.normalisation
    if not (wanted.observation or wanted.reward):
        return env
    return VecNormalize(
        env,
        norm_obs=wanted.observation,
        norm_obs_keys=["observation"],  # goals keep their units: what is achieved and what is desired compare
        norm_reward=wanted.reward,
        clip_obs=wanted.clip,
        clip_reward=wanted.clip,
        gamma=hyperparameters_of(settings)["gamma"],
    )
