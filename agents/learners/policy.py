"""What has been learnt, to act upon: observations in, actions out."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.vec_env import VecNormalize

from agents.learners.learner import load_model, load_normaliser
from agents.learners.settings import AlgorithmName
from pcm_gym.arrays import Array


class LearntPolicy:
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

    def __init__(self, model: BaseAlgorithm, normaliser: VecNormalize | None, *, is_deterministic: bool = True) -> None:
        self._model = model
        self._normaliser = normaliser
        self.is_deterministic = is_deterministic

    @property
    def training_steps(self) -> int:
        """Steps the model was trained for."""
        return self._model.num_timesteps

    def seed(self, seed: int) -> None:
        """Begin anew what sampled actions are drawn from."""
        self._model.set_random_seed(seed)

    def __call__(self, observation: dict[str, NDArray[Any]]) -> Array:
        """Actions (n, actuators) for observations (n, ...)."""
        if self._normaliser is not None:
            observation = self._normaliser.normalize_obs(observation)  # type: ignore[assignment]  # of its kind
        actions, _ = self._model.predict(observation, deterministic=self.is_deterministic)
        return np.asarray(actions, dtype=np.float64)


def load_policy(
    algorithm: AlgorithmName, model: Path, normalisation: Path | None, *, is_deterministic: bool = True
) -> LearntPolicy:
    """Policy from the files of a snapshot. They are pickles: load only what you trust.

    Raises
    ------
    ModelError
        If they cannot be read.
    """
    normaliser = None if normalisation is None else load_normaliser(normalisation)
    return LearntPolicy(load_model(algorithm, model), normaliser, is_deterministic=is_deterministic)
