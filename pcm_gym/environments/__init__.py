"""Gymnasium environments: one single class, one batched class, one table."""

from pcm_gym.environments.registration import environment_ids, register_environments

__all__ = ["environment_ids", "register_environments"]
