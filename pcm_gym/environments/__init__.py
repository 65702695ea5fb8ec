"""Gymnasium environments: one single class, one batched class, one table, and wrappers."""

from pcm_gym.environments.preview import Preview
from pcm_gym.environments.registration import environment_ids, register_environments
from pcm_gym.environments.wrappers import CostStep, SolverShield

__all__ = ["CostStep", "Preview", "SolverShield", "environment_ids", "register_environments"]
