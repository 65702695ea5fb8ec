"""What is asked of an agent: goals, rewards, starts and observations, as functions over a batch."""

from pcm_gym.tasks.distances import Potential
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
from pcm_gym.tasks.split import GUARD, SPLITS, Split, in_split
from pcm_gym.tasks.switch import Switch, SwitchDifficulty
from pcm_gym.tasks.table import TASKS, free_task_name, register_task, task_type
from pcm_gym.tasks.task import (
    Episodes,
    Generators,
    OnInstability,
    Progress,
    Task,
    default_max_action,
    draw,
    draw_until,
    starts_of,
)
from pcm_gym.tasks.track import Path, Track, TrackDifficulty

__all__ = [
    "GUARD",
    "SPLITS",
    "TASKS",
    "Element",
    "Episodes",
    "Generators",
    "Goals",
    "Layout",
    "OnInstability",
    "Part",
    "Path",
    "Potential",
    "Progress",
    "Reach",
    "ReachDifficulty",
    "RewardType",
    "Scene",
    "Split",
    "Switch",
    "SwitchDifficulty",
    "Task",
    "Track",
    "TrackDifficulty",
    "box_of",
    "command_elements",
    "default_max_action",
    "draw",
    "draw_until",
    "feature_layout",
    "free_task_name",
    "in_split",
    "load_elements",
    "observation_elements",
    "register_task",
    "starts_of",
    "task_type",
]
