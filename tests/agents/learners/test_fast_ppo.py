"""The fast PPO makes the updates that Stable-Baselines3's own PPO makes, and is saved as that is."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import stable_baselines3
import torch
from stable_baselines3.common.logger import KVWriter, Logger

from agents.experiments.config import parse_config
from agents.learners.algorithms import ALGORITHMS
from agents.learners.fast_ppo import FastPPO
from agents.learners.learner import new_learner
from agents.learners.settings import ConfigError

ENVIRONMENTS, STEPS, TIME_LIMIT = 8, 60, 100
# Differences of rounding in a gradient, in terms of Adam's `eps`, times learning rate and number of updates.
TOLERANCE = 2e-5


class Kept(KVWriter):
    """Keeps what is logged."""

    def __init__(self) -> None:
        self.rows: list[dict[str, Any]] = []

    def write(self, key_values: dict[str, Any], *_: Any) -> None:
        self.rows.append(dict(key_values))

    def close(self) -> None:
        pass


def learnt(kind: type[stable_baselines3.PPO], rollouts: int, **hyperparameters: Any) -> tuple[Any, list[Any]]:
    """Return a learner of that class after some rollouts, in which episodes end, and what it has logged."""
    usual = {"n_steps": STEPS, "batch_size": 100, "n_epochs": 2, "learning_rate": 1e-3}
    config = parse_config(
        {
            "name": "x",
            "environment": {"id": "PCM/2RFR-Reach-v0"},
            "num_envs": ENVIRONMENTS,
            "total_steps": 1,
            "seed": 3,
            "hyperparameters": usual | hyperparameters,
        }
    )
    with pytest.warns(UserWarning, match="truncated mini-batch"):
        learner: Any = new_learner(config, kind)
    kept = Kept()
    learner.set_logger(Logger(None, [kept]))
    learner.learn(rollouts * ENVIRONMENTS * STEPS)
    learner.logger.dump()
    return learner, kept.rows


@pytest.mark.parametrize(
    "hyperparameters",
    [
        {},
        {"clip_range_vf": 0.05, "clip_range": 0.05, "ent_coef": 0.01, "vf_coef": 0.7},
        {"normalize_advantage": False, "max_grad_norm": 0.05, "target_kl": 1e-4},
        {"policy_kwargs": {"features_extractor_class": "goal_error", "activation_fn": "relu", "net_arch": [16, 8]}},
        {"policy_kwargs": {"net_arch": {"pi": [8], "vf": [16, 16]}, "log_std_init": -1.0}, "gamma": 0.9},
    ],
    ids=["usual", "clipped values, entropy", "early stop", "other features", "other networks"],
)
def test_updates_are_those_of_stable_baselines(hyperparameters: dict[str, Any]) -> None:
    """Rollouts, bootstrapping, losses, gradients and steps: whatever differed would be in the parameters."""
    expected, expected_rows = learnt(stable_baselines3.PPO, 2, **hyperparameters)
    found, rows = learnt(FastPPO, 2, **hyperparameters)
    assert (found.num_timesteps, found._n_updates) == (expected.num_timesteps, expected._n_updates)
    moved = 0.0
    for name, parameter in expected.policy.state_dict().items():
        np.testing.assert_allclose(found.policy.state_dict()[name], parameter, rtol=0, atol=TOLERANCE, err_msg=name)
        moved = max(moved, float(parameter.abs().max()))
    assert moved > 100.0 * TOLERANCE
    assert any(own["l"] == TIME_LIMIT for own in expected.ep_info_buffer)  # what time has ended is bootstrapped
    assert [own["r"] for own in found.ep_info_buffer] == pytest.approx([own["r"] for own in expected.ep_info_buffer])
    for own, other in zip(rows, expected_rows, strict=True):
        assert own.keys() == other.keys()
        for name in other.keys() - {"time/fps", "time/time_elapsed"}:
            assert own[name] == pytest.approx(other[name], rel=1e-3, abs=1e-4), name


def test_the_table_s_ppo_is_the_fast_one() -> None:
    assert ALGORITHMS["PPO"].load_class() is FastPPO


def test_it_is_saved_as_stable_baselines_would(tmp_path: Path) -> None:
    learner, _ = learnt(FastPPO, 1)
    learner.save(tmp_path / "model.zip")
    loaded = stable_baselines3.PPO.load(tmp_path / "model.zip", device="cpu")
    observation = {key: own.sample() for key, own in learner.observation_space.items()}
    np.testing.assert_array_equal(
        loaded.predict(observation, deterministic=True)[0], learner.predict(observation, deterministic=True)[0]
    )
    ours, theirs = (own.policy.optimizer.state_dict()["state"] for own in (learner, loaded))
    assert all(torch.equal(ours[key]["exp_avg"], theirs[key]["exp_avg"]) for key in ours)


def test_what_it_cannot_learn_is_refused() -> None:
    with pytest.raises(ConfigError, match="use_sde must be false"):
        learnt(FastPPO, 1, use_sde=True)
