"""An exported policy does in NumPy what the model does in torch, and is its equal after a file."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from stable_baselines3.common.vec_env import VecNormalize
from torch import nn

from agents.experiments.config import parse_config
from agents.learners.algorithms import ALGORITHMS
from agents.learners.export import network_of
from agents.learners.hyperparameters import ACTIVATIONS as OF_TORCH
from agents.learners.learner import new_learner
from agents.learners.policy import LearntPolicy
from agents.learners.settings import ModelError
from pcm_gym.policies import Policy, load_policy
from pcm_gym.policies.network import ACTIVATIONS

# Some units in the last place of single precision, through three layers.
TOLERANCE = 5e-6


def learner_of(algorithm: str, **changes: Any) -> Any:
    pytest.importorskip(ALGORITHMS[algorithm].path.split(":")[0])
    content = {
        "name": "x",
        "environment": {"id": "PCM/2RFR-Reach-v0"},
        "total_steps": 1,
        "num_envs": 16,
        "algorithm": algorithm,
    }
    return new_learner(parse_config(content | changes))


@pytest.mark.parametrize("algorithm", ALGORITHMS)
@pytest.mark.parametrize("features", ["goal_error", None])
def test_actions_are_those_of_the_model(algorithm: str, features: str | None, tmp_path: Path) -> None:
    policy_arguments: dict[str, Any] = {"net_arch": [24, 12]}
    if features is not None:
        policy_arguments["features_extractor_class"] = features
    learner = learner_of(algorithm, hyperparameters={"policy_kwargs": policy_arguments})
    assert_equal_actions(learner, tmp_path)


@pytest.mark.parametrize("activation", OF_TORCH)
def test_every_activation_function_is_there(activation: str, tmp_path: Path) -> None:
    assert ACTIVATIONS.keys() == OF_TORCH.keys()
    assert_equal_actions(learner_of("PPO", hyperparameters={"policy_kwargs": {"activation_fn": activation}}), tmp_path)


def test_plain_observations_need_no_statistics(tmp_path: Path) -> None:
    learner = learner_of("PPO", normalisation={"observation": False, "reward": True})
    assert_equal_actions(learner, tmp_path)


def assert_equal_actions(learner: Any, folder: Path) -> None:
    env: VecNormalize = learner.get_env()
    generator = np.random.default_rng(0)
    for parameter in learner.policy.parameters():  # actions that differ, and reach the ends of the range
        parameter.data += parameter.data.new_tensor(generator.normal(0.0, 0.3, parameter.shape))
    env.seed(0)
    env.reset()
    for _ in range(5):
        env.step(generator.uniform(-1.0, 1.0, (16, 2)).astype(np.float32))
    observation: Any = env.get_original_obs()
    expected = LearntPolicy(learner, env)(observation)
    assert np.ptp(expected, axis=0).min() > 0.2
    Policy(network_of(learner, env), {}).save(folder / "policy.npz")
    np.testing.assert_allclose(load_policy(folder / "policy.npz")(observation), expected, rtol=0, atol=TOLERANCE)


def test_what_policies_do_not_have_is_refused() -> None:
    learner = learner_of("PPO")
    learner.policy.mlp_extractor.policy_net.append(nn.Softplus())
    with pytest.raises(ModelError, match="Softplus, which is no activation function"):
        network_of(learner, None)
    learner.policy.mlp_extractor.policy_net[-1] = nn.ReLU()
    with pytest.raises(ModelError, match="one activation function, the model has relu, tanh"):
        network_of(learner, None)
    learner.policy.pi_features_extractor = nn.Identity()
    learner.policy.mlp_extractor.policy_net.pop(-1)
    with pytest.raises(ModelError, match="features are Identity"):
        network_of(learner, None)
