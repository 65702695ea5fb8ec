"""From plain data to a learner: arguments, snapshots, and the goal-based replay through the adapter."""

import inspect
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from stable_baselines3.common.noise import NormalActionNoise
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm
from stable_baselines3.common.utils import LinearSchedule
from stable_baselines3.her import HerReplayBuffer
from torch import as_tensor, nn

from agents.experiments.config import ExperimentConfig, parse_config
from agents.learners.algorithms import ALGORITHMS
from agents.learners.features import GoalErrorFeatures
from agents.learners.files import MODEL
from agents.learners.hyperparameters import algorithm_arguments
from agents.learners.learner import load_learner, load_model, make_training_env, new_learner, save_learner
from agents.learners.settings import ConfigError

SMALL_NETWORK = {"policy_kwargs": {"net_arch": [8]}}


def experiment(**changes: Any) -> ExperimentConfig:
    environment = {"id": "PCM/2RFR-Reach-v0"}
    return parse_config({"name": "x", "environment": environment, "total_steps": 100, "num_envs": 4} | changes)


def test_plain_data_become_arguments() -> None:
    hyperparameters = {
        "learning_rate": {"start": 1e-3, "end": 0.0},
        "policy_kwargs": {"activation_fn": "tanh", "features_extractor_class": "goal_error", "net_arch": [8]},
        "action_noise": {"sigma": 0.1},
    }
    arguments = algorithm_arguments(experiment(algorithm="TD3", hyperparameters=hyperparameters, hindsight={}), 2)
    assert isinstance(arguments["learning_rate"], LinearSchedule)
    assert arguments["learning_rate"](0.5) == pytest.approx(5e-4)
    assert arguments["policy_kwargs"] == {
        "activation_fn": nn.Tanh,
        "features_extractor_class": GoalErrorFeatures,
        "net_arch": [8],
    }
    assert isinstance(arguments["action_noise"], NormalActionNoise)
    assert arguments["replay_buffer_class"] is HerReplayBuffer


@pytest.mark.parametrize("name", ALGORITHMS)
def test_every_algorithm_of_the_table_is_there_and_as_it_says(name: str) -> None:
    pytest.importorskip(ALGORITHMS[name].path.split(":")[0])
    kind = ALGORITHMS[name].load_class()
    assert name in {own.__name__ for own in kind.__mro__}  # the class of that name, or one that learns the same
    assert issubclass(kind, OffPolicyAlgorithm) == ALGORITHMS[name].is_off_policy
    assert ALGORITHMS[name].defaults.keys() <= inspect.signature(kind).parameters.keys()


def test_experiment_overrides_the_defaults_of_the_algorithm() -> None:
    assert algorithm_arguments(experiment(), 2) == {"gamma": 0.99}
    assert algorithm_arguments(experiment(hyperparameters={"gamma": 0.9}), 2) == {"gamma": 0.9}


@pytest.mark.parametrize(
    ("hyperparameters", "message"),
    [
        ({"gama": 0.9, "n_stps": 1}, "unknown to PPO: gama, n_stps"),
        ({"learning_rate": {"begin": 1.0}}, "learning_rate: a schedule has the entries start and end"),
        ({"policy_kwargs": {"activation_fn": "tan"}}, "'tan' is none of tanh, relu"),
        ({"policy_kwargs": {"features_extractor_class": "goal"}}, "'goal' is none of goal_error"),
    ],
)
def test_unusable_hyperparameter_is_named(hyperparameters: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        new_learner(experiment(hyperparameters=hyperparameters))


def test_goal_error_features_hold_the_error_coarse_and_fine() -> None:
    env: Any = make_training_env(experiment())
    extractor = GoalErrorFeatures(env.observation_space, fine=0.1)
    observations = {key: np.zeros((2, *space.shape), np.float32) for key, space in env.observation_space.items()}
    observations["desired_goal"][0] = [0.3, 0.4]
    features = extractor({key: as_tensor(value) for key, value in observations.items()}).numpy()
    assert features.shape == (2, extractor.features_dim)
    np.testing.assert_allclose(features[0, -6:], [0.3, 0.4, 0.3, 0.4, 0.5, 2.0 / 3.0], rtol=1e-6)
    np.testing.assert_array_equal(features[1, -6:], np.zeros(6))


def test_goals_are_not_normalised() -> None:
    env: Any = new_learner(experiment()).get_env()
    assert env is not None
    env.seed(0)
    observations = env.reset()
    original = env.get_original_obs()
    np.testing.assert_array_equal(observations["desired_goal"], original["desired_goal"])
    assert (observations["observation"] != original["observation"]).any()


def test_training_episodes_end_by_time_as_truncations() -> None:
    env: Any = make_training_env(experiment())
    env.seed(0)
    env.reset()
    still = np.zeros((env.num_envs, *env.action_space.shape), dtype=np.float32)
    dones = np.zeros(env.num_envs, dtype=np.bool_)
    while not dones.any():
        _, _, dones, infos = env.step(still)
    for index in np.flatnonzero(dones):
        info = infos[index]
        assert info["TimeLimit.truncated"]
        assert info["cost"] == info["cost_unstable"] + info["cost_singular"] + info["cost_solver"]
        assert info["terminal_observation"].keys() == env.observation_space.keys()
        assert info["episode"]["l"] > 1


@pytest.mark.parametrize("algorithm", ["PPO", "SAC"])
def test_loaded_learner_acts_as_the_saved_one(tmp_path: Path, algorithm: str) -> None:
    config = experiment(algorithm=algorithm, hyperparameters=SMALL_NETWORK)
    learner: Any = new_learner(config)
    save_learner(learner, tmp_path)
    loaded: Any = load_learner(config, tmp_path)
    observations = learner.get_env().reset()
    expected, _ = learner.predict(observations, deterministic=True)
    found, _ = loaded.predict(observations, deterministic=True)
    np.testing.assert_array_equal(found, expected)
    assert expected.shape == (4, 2)


def test_models_that_name_the_features_by_their_earlier_module_load() -> None:
    assert pickle.loads(b"cagents.features\nGoalErrorFeatures\n.") is GoalErrorFeatures


def test_hindsight_learns_from_rewards_that_the_batch_recomputes(tmp_path: Path) -> None:
    hyperparameters = SMALL_NETWORK | {"learning_starts": 500, "batch_size": 16, "buffer_size": 2_000}
    environment = {"id": "PCM/2RFR-Reach-v0", "kwargs": {"reward_type": "sparse"}}
    config = experiment(algorithm="SAC", hyperparameters=hyperparameters, environment=environment, hindsight={})
    learner: Any = new_learner(config)
    learner.learn(800)
    sampled = learner.replay_buffer.sample(64)
    assert np.isfinite(sampled.rewards.numpy()).all()

    save_learner(learner, tmp_path)
    loaded: Any = load_learner(config, tmp_path)
    assert loaded.replay_buffer.size() == learner.replay_buffer.size()
    observations = learner.get_env().reset()
    expected, _ = learner.predict(observations, deterministic=True)
    found, _ = load_model(config.algorithm, tmp_path / MODEL).predict(observations, deterministic=True)
    np.testing.assert_array_equal(found, expected)
