"""The table of environments, and their registration with Gymnasium."""

import gymnasium

from pcm_gym.mechanism import mechanism_names
from pcm_gym.tasks import TASKS

_VERSION = 0
# Arguments of pairs of mechanism and task that differ from the defaults: no cusp of the 2PFR is within its limits.
_ARGUMENTS = {("2PFR", "Switch"): {"difficulty": "fall", "on_instability": "snap"}}


def environment_ids() -> list[str]:
    """Return the ids of all environments of this package."""
    return [_id(mechanism, task) for mechanism, task in _pairs()]


def register_environments() -> None:
    """Register every mechanism with every task; a second call changes nothing."""
    for mechanism, task in _pairs():
        if _id(mechanism, task) not in gymnasium.registry:
            gymnasium.register(
                _id(mechanism, task),
                entry_point="pcm_gym.environments.single:MechanismEnv",
                vector_entry_point="pcm_gym.environments.batch:MechanismVectorEnv",
                max_episode_steps=TASKS[task].time_limit,
                kwargs={"mechanism": mechanism, "task": task, **_ARGUMENTS.get((mechanism, task), {})},
            )


def _pairs() -> list[tuple[str, str]]:
    return [(mechanism, task) for task in TASKS for mechanism in mechanism_names()]


def _id(mechanism: str, task: str) -> str:
    return f"PCM/{mechanism}-{task}-v{_VERSION}"
