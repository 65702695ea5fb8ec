"""The native batch of an experiment's environment, for learning and for judging."""

from typing import cast

import gymnasium
from gymnasium.vector import AutoresetMode

import pcm_gym  # noqa: F401 (registers the environments)
from agents.learners.settings import EnvironmentConfig
from pcm_gym.environments.batch import MechanismVectorEnv


def make_batch(environment: EnvironmentConfig, count: int, autoreset_mode: AutoresetMode) -> MechanismVectorEnv:
    """Native batch of `count` environments."""
    batch = gymnasium.make_vec(
        environment.id,
        num_envs=count,
        vectorization_mode="vector_entry_point",
        autoreset_mode=autoreset_mode,
        **environment.kwargs,
    )
    return cast(MechanismVectorEnv, batch)  # without wrappers, as every environment of the package
