"""The controller that has learnt."""

from agents.learners.exported import ActingPolicy
from pcm_gym.arrays import Array
from pcm_gym.references import View


class TrainedController:
    """Acts as a learnt policy does, all rows in one inference."""

    def __init__(self, policy: ActingPolicy) -> None:
        self._policy = policy

    def act(self, view: View) -> Array:
        """Actions (n, actuators) of the policy."""
        return self._policy(view.observation)
