"""Wrappers: the cost as an element of the step, and shields, for one environment and for the native batch."""

from pcm_gym.environments.wrappers import CostStep, SolverShield, VectorSolverShield

__all__ = ["CostStep", "SolverShield", "VectorSolverShield"]
