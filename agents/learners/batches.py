"""The native batch of an experiment's environment, for learning and for judging."""

import gymnasium
from gymnasium.vector import AutoresetMode

import pcm_gym  # noqa: F401 (registers the environments)
from agents.learners.settings import ConfigError, EnvironmentConfig
from pcm_gym.environments.batch import MechanismVectorEnv


def make_batch(environment: EnvironmentConfig, count: int, autoreset_mode: AutoresetMode) -> MechanismVectorEnv:
    """Native batch of `count` environments, which can begin episodes.

    Raises
    ------
    ConfigError
        If there is no such environment, or not with these arguments.
    """
    try:
        batch = gymnasium.make_vec(
            environment.id,
            num_envs=count,
            vectorization_mode="vector_entry_point",
            autoreset_mode=autoreset_mode,
            **environment.kwargs,
        )
        batch.reset(seed=0)  # some arguments can be judged only where episodes begin
    except (gymnasium.error.Error, ImportError, TypeError, ValueError) as error:
        raise ConfigError(f"environment {environment.id!r} with {environment.kwargs}: {error}") from error
    if not isinstance(batch, MechanismVectorEnv):  # those of the package come without wrappers
        raise ConfigError(f"environment {environment.id!r}: must be one of pcm_gym, got {batch}")
    return batch
