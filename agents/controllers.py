"""Controllers (see `agents.rollouts.Controller`): learnt, random, and from the exact Jacobian of the motion."""

import pickle
from collections.abc import Sequence
from typing import Any

import numpy as np
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.vec_env import VecNormalize

from agents.config import ExperimentConfig
from agents.learning import load_policy
from agents.rollouts import RunningEpisode
from agents.runs import TrainedFiles
from pcm_gym.arrays import Array


class RandomController:
    """Uniformly random actions, drawn from each episode's own generator."""

    name = "random"

    def act(self, episodes: Sequence[RunningEpisode]) -> Array:
        """Actions (episodes, actuators), uniform in [-1, 1]."""
        return np.array([episode.generator.uniform(-1.0, 1.0, episode.action_count) for episode in episodes])


class ResolvedRateController:
    """Straight towards the goal through the exact Jacobian of the motion; it knows nothing of stability.

    The increment of the inputs is the damped least-squares solution of ``J dq = goal - pose`` (Y. Nakamura and
    H. Hanafusa, 1986, J. Dyn. Sys. Meas. Control 108), shortened as a whole to the largest increment allowed.

    Parameters
    ----------
    damping
        Damping in parts of the Jacobian's largest singular value.
    """

    name = "resolved rate"

    def __init__(self, damping: float = 0.05) -> None:
        self._damping = damping

    def act(self, episodes: Sequence[RunningEpisode]) -> Array:
        """Actions (episodes, actuators) of one resolved-rate step each."""
        return np.array([self._action(episode) for episode in episodes])

    def _action(self, episode: RunningEpisode) -> Array:
        env: Any = episode.env.unwrapped
        error = pose_error(env.goal, env.equilibrium.pose)
        jacobian = env.equilibrium.forward_jacobian
        action: Array = damped_solution(jacobian, error, self._damping) / env.max_action
        return action / max(1.0, float(np.abs(action).max()))


class TrainedController:
    """A model of Stable-Baselines3 with the statistics that normalise its observations.

    Parameters
    ----------
    model
        The trained model.
    normaliser
        Running statistics of the training, or None if it saw plain observations.
    is_deterministic
        Whether the mean action is taken in place of a sampled one.
    """

    name = "trained"

    def __init__(self, model: BaseAlgorithm, normaliser: VecNormalize | None, *, is_deterministic: bool = True) -> None:
        self._model = model
        self._normaliser = normaliser
        self.is_deterministic = is_deterministic

    @property
    def training_steps(self) -> int:
        """Steps the model was trained for."""
        return self._model.num_timesteps

    def act(self, episodes: Sequence[RunningEpisode]) -> Array:
        """Actions (episodes, actuators) of the policy."""
        keys = episodes[0].observation.keys()
        observations = {key: np.stack([episode.observation[key] for episode in episodes]) for key in keys}
        if self._normaliser is not None:
            observations = self._normaliser.normalize_obs(observations)  # type: ignore[assignment]
        actions, _ = self._model.predict(observations, deterministic=self.is_deterministic)
        return np.asarray(actions, dtype=np.float64)


def load_trained(files: TrainedFiles, config: ExperimentConfig, *, is_deterministic: bool = True) -> TrainedController:
    """Controller from a run's files. They are pickles: load only what you trust."""
    model = load_policy(config, files.model)
    model.set_random_seed(config.evaluation.seed)
    normaliser = None if files.normalisation is None else pickle.loads(files.normalisation.read_bytes())
    return TrainedController(model, normaliser, is_deterministic=is_deterministic)


def pose_error(goal: Array, pose: Array) -> Array:
    """What takes `pose` to `goal`: metres, then (for a platform) the shorter way round in radians."""
    error = np.asarray(goal, dtype=np.float64) - pose
    error[2:] = (error[2:] + np.pi) % (2.0 * np.pi) - np.pi
    return error


def damped_solution(jacobian: Array, error: Array, damping: float) -> Array:
    """Damped least-squares solution `x` of ``jacobian x = error``; zero where the Jacobian is zero or not finite.

    Each singular value `s` is inverted as ``s / (s**2 + (damping * s_max)**2)``.
    """
    if not (np.isfinite(jacobian).all() and jacobian.any()):
        return np.zeros(jacobian.shape[1])
    left, values, right = np.linalg.svd(jacobian, full_matrices=False)
    inverted = values / (values**2 + (damping * values[0]) ** 2)
    solution: Array = right.T @ (inverted * (left.T @ error))
    return solution
