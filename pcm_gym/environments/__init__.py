"""Gymnasium environments: one single class, one batched class, one table, and wrappers."""

from pcm_gym.environments.preview import Preview
from pcm_gym.environments.registration import environment_ids, register_environments
from pcm_gym.environments.wrappers import CostStep, SolverShield, VectorSolverShield

__all__ = ["CostStep", "Preview", "SolverShield", "VectorSolverShield", "environment_ids", "register_environments"]
