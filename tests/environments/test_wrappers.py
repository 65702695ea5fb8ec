"""The wrappers keep their promises; the truth is the same environment without them, and the tracker."""

from collections.abc import Callable

import gymnasium
import numpy as np
import pytest
from gymnasium.wrappers import FlattenObservation

from pcm_gym import BranchTracker, CostStep, Event, SolverShield, environment_ids

IDS = environment_ids()
Policy = Callable[[gymnasium.Env, np.ndarray], np.ndarray]


def straight_on(env: gymnasium.Env, start: np.ndarray) -> np.ndarray:
    """Go on in the direction of the episode's first action, whatever comes."""
    return start


def episodes(env: gymnasium.Env, count: int, policy: Policy = straight_on) -> list[dict]:
    """Run episodes in random directions, each to its end; return the infos of all steps."""
    infos = []
    for seed in range(count):
        env.reset(seed=seed)
        rng = np.random.default_rng(seed)
        direction = np.sign(rng.normal(size=env.action_space.shape)).astype(np.float32)
        is_over = False
        while not is_over:
            *_, terminated, truncated, info = env.step(policy(env, direction))
            infos.append(info)
            is_over = terminated or truncated
    return infos


class TestCostStep:
    @pytest.mark.parametrize("name", IDS)
    def test_returns_the_cost_of_the_info_as_third_value(self, name: str) -> None:
        env, plain = CostStep(gymnasium.make(name)), gymnasium.make(name)
        env.reset(seed=3)
        plain.reset(seed=3)
        action = np.ones(env.action_space.shape, dtype=np.float32)
        costs = []
        for _ in range(50):
            observation, reward, cost, terminated, truncated, info = env.step(action)
            expected, own_reward, own_terminated, own_truncated, own_info = plain.step(action)
            np.testing.assert_equal(observation, expected)
            assert (reward, terminated, truncated, info) == (own_reward, own_terminated, own_truncated, own_info)
            assert cost == own_info["cost"]
            costs.append(cost)
            if terminated or truncated:
                break
        assert any(costs)


class TestSolverShield:
    @pytest.mark.parametrize("name", ["PCM/2RFR-Reach-v0", "PCM/3PFR-Reach-v0"])
    def test_stability_is_kept_where_it_is_lost_without(self, name: str) -> None:
        count = 12
        plain = episodes(gymnasium.make(name), count)
        shielded = episodes(SolverShield(gymnasium.make(name)), count)
        assert sum(info["cost_unstable"] for info in plain) > 1
        assert sum(info["cost_singular"] for info in plain) > 1
        assert sum(info["shielded"] for info in shielded) > 1
        assert not any(info["cost_unstable"] or info["cost_singular"] for info in shielded)

    def test_safe_actions_pass_unchanged(self) -> None:
        name = "PCM/2RFR-Reach-v0"
        env, plain = SolverShield(gymnasium.make(name)), gymnasium.make(name)
        env.reset(seed=1)
        plain.reset(seed=1)
        for _ in range(20):
            action = 0.1 * plain.action_space.sample()
            ours, theirs = env.step(action), plain.step(action)
            np.testing.assert_equal(ours[0], theirs[0])
            assert ours[4] == {**theirs[4], "shielded": False}

    def test_replacement_is_no_farther_from_the_action_than_standing_still(self) -> None:
        env = SolverShield(gymnasium.make("PCM/2RFR-Reach-v0"), least_margin=0.2)
        replaced = 0
        for seed in range(12):
            env.reset(seed=seed)
            rng = np.random.default_rng(seed)
            action = np.sign(rng.normal(size=2)).astype(np.float32)
            for _ in range(50):
                before = env.unwrapped.equilibrium
                *_, terminated, truncated, info = env.step(action)
                if info["shielded"] and before.singularity_margin > 0.2:
                    replaced += 1
                    steps, mechanism = env.unwrapped.max_action, before.mechanism
                    target = np.clip(before.inputs + steps * action, mechanism.lower_limits, mechanism.upper_limits)
                    wanted = (target - before.inputs) / steps
                    taken = (env.unwrapped.equilibrium.inputs - before.inputs) / steps
                    assert np.linalg.norm(taken - wanted) <= np.linalg.norm(wanted) + 1e-6
                    tracked = BranchTracker(before.mechanism, before).step(env.unwrapped.equilibrium.inputs)
                    assert tracked.event is Event.NONE
                    assert tracked.equilibrium.singularity_margin > 0.2 * (1.0 - 1e-6)
                if terminated or truncated:
                    break
        assert replaced > 5

    def test_of_a_foreign_environment_is_an_error(self) -> None:
        with pytest.raises(TypeError, match="env must be an environment of pcm_gym"):
            SolverShield(gymnasium.make("CartPole-v1"))

    @pytest.mark.parametrize("margin", [0.0, -1.0, float("nan")])
    def test_margin_must_be_positive(self, margin: float) -> None:
        with pytest.raises(ValueError, match="least_margin must be"):
            SolverShield(gymnasium.make("PCM/2RFR-Reach-v0"), least_margin=margin)


@pytest.mark.parametrize("name", IDS)
def test_flat_observation_of_gymnasium_holds_all_three_parts(name: str) -> None:
    env = FlattenObservation(gymnasium.make(name))
    observation, _ = env.reset(seed=0)
    parts, _ = env.unwrapped.reset(seed=0)
    assert observation in env.observation_space
    assert sorted(observation) == sorted(np.concatenate(list(parts.values())))
