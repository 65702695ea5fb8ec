"""The table of environments, and their registration with Gymnasium."""

import gymnasium

from pcm_gym.mechanism import mechanism_names

# Task and length of an episode.
_TASKS = {"Reach": 50}
_VERSION = 0


def environment_ids() -> list[str]:
    """Return the ids of all environments of this package."""
    return [f"PCM/{mechanism}-{task}-v{_VERSION}" for task in _TASKS for mechanism in mechanism_names()]


def register_environments() -> None:
    """Register every mechanism with every task; a second call changes nothing."""
    for task, max_episode_steps in _TASKS.items():
        for mechanism in mechanism_names():
            environment_id = f"PCM/{mechanism}-{task}-v{_VERSION}"
            if environment_id not in gymnasium.registry:
                gymnasium.register(
                    environment_id,
                    entry_point="pcm_gym.environments.single:MechanismEnv",
                    vector_entry_point="pcm_gym.environments.batch:MechanismVectorEnv",
                    max_episode_steps=max_episode_steps,
                    kwargs={"mechanism": mechanism},
                )
