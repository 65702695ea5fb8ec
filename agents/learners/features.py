"""What the networks of a goal-based learner see."""

import torch
from gymnasium import spaces
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from torch import Tensor


class GoalErrorFeatures(BaseFeaturesExtractor):
    """The observation, the desired goal, and what is missing to it: coarse and fine.

    The error ``e = desired_goal - achieved_goal`` enters as it is and as ``e / (|e| + fine)``: its direction, faded
    out below the distance `fine`. Networks then need not learn to subtract to high accuracy.

    Parameters
    ----------
    observation_space
        With the keys of a goal-based environment; the goals in their own units, not normalised.
    fine
        Distance, in the units of the goals, below which accuracy counts.
    """

    def __init__(self, observation_space: spaces.Dict, fine: float = 0.05) -> None:
        observation_count = spaces.flatdim(observation_space["observation"])
        goal_count = spaces.flatdim(observation_space["desired_goal"])
        super().__init__(observation_space, features_dim=observation_count + 3 * goal_count)
        self.fine = fine

    def forward(self, observations: dict[str, Tensor]) -> Tensor:
        """Features (n, features_dim) of a batch of observations."""
        desired = observations["desired_goal"]
        error = desired - observations["achieved_goal"]
        direction = error / (torch.linalg.vector_norm(error, dim=-1, keepdim=True) + self.fine)
        return torch.cat((observations["observation"], desired, error, direction), dim=-1)
