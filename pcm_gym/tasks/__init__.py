"""What is asked of an agent: goals, rewards, starts and observations, as functions over a batch."""

from pcm_gym.tasks.goals import Goals, RewardType
from pcm_gym.tasks.observation import (
    Element,
    box_of,
    command_elements,
    goal_elements,
    load_elements,
    observation_elements,
)
from pcm_gym.tasks.reach import Reach
from pcm_gym.tasks.scene import Scene
from pcm_gym.tasks.switch import Switch
from pcm_gym.tasks.task import Episodes, Task, default_max_action
from pcm_gym.tasks.track import Track

TASKS: dict[str, type[Task]] = {"Reach": Reach, "Track": Track, "Switch": Switch}

__all__ = [
    "TASKS",
    "Element",
    "Episodes",
    "Goals",
    "Reach",
    "RewardType",
    "Scene",
    "Switch",
    "Task",
    "Track",
    "box_of",
    "command_elements",
    "default_max_action",
    "goal_elements",
    "load_elements",
    "observation_elements",
]
