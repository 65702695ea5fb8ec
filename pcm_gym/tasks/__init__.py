"""What is asked of an agent: goals, rewards, starts and observations, as functions over a batch."""

from pcm_gym.tasks.goals import Goals, RewardType
from pcm_gym.tasks.observation import (
    Element,
    Layout,
    Part,
    box_of,
    command_elements,
    feature_layout,
    load_elements,
    observation_elements,
)
from pcm_gym.tasks.reach import Reach, ReachDifficulty
from pcm_gym.tasks.scene import Scene
from pcm_gym.tasks.switch import Switch, SwitchDifficulty
from pcm_gym.tasks.table import TASKS, free_task_name, register_task, task_type
from pcm_gym.tasks.task import Episodes, Generators, OnInstability, Task, default_max_action, draw, starts_of
from pcm_gym.tasks.track import Path, Track

__all__ = [
    "TASKS",
    "Element",
    "Episodes",
    "Generators",
    "Goals",
    "Layout",
    "OnInstability",
    "Part",
    "Path",
    "Reach",
    "ReachDifficulty",
    "RewardType",
    "Scene",
    "Switch",
    "SwitchDifficulty",
    "Task",
    "Track",
    "box_of",
    "command_elements",
    "default_max_action",
    "draw",
    "feature_layout",
    "free_task_name",
    "load_elements",
    "observation_elements",
    "register_task",
    "starts_of",
    "task_type",
]
