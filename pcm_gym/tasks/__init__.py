"""What is asked of an agent: observations, goals, rewards and success, as functions over a batch."""

from pcm_gym.tasks.observation import Element, goal_box, observation_box, observation_elements
from pcm_gym.tasks.reach import Episodes, ReachTask, default_max_action

__all__ = [
    "Element",
    "Episodes",
    "ReachTask",
    "default_max_action",
    "goal_box",
    "observation_box",
    "observation_elements",
]
