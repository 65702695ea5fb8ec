"""The controller that has learnt."""

from agents.controllers.view import View
from agents.learners.policy import LearntPolicy
from pcm_gym.arrays import Array


class TrainedController:
    """Acts as a learnt policy does, all rows in one inference."""

    def __init__(self, policy: LearntPolicy) -> None:
        self._policy = policy

    def act(self, view: View) -> Array:
        """Actions (n, actuators) of the policy."""
        return self._policy(view.observation)
