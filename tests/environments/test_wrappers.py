"""The wrappers keep their promises; the truth is the same environment without them, and the tracker."""

from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from gymnasium.wrappers import FlattenObservation, TransformAction

import pcm_gym
from pcm_gym import BranchTracker, CostStep, Event, SolverShield, VectorSolverShield, environment_ids
from tests.environments.rollouts import (
    assert_same,
    make,
    make_bare,
    make_native,
    sweeping_actions,
)

IDS = environment_ids()
# Clamps that follow late, with play; the mechanism itself is not known exactly.
LATE = {"actuator_lag": 2.0, "rate_limit": 0.04, "backlash": 0.02, "observation_noise": 0.05}
RANDOMISED = {"randomisation": {"stiffness": 0.1, "length": 0.02, "base": 0.01}, "variants": 2}
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
        env, plain = (CostStep(make(name)), make(name))
        total = 0.0
        for seed in range(30):
            env.reset(seed=seed)
            plain.reset(seed=seed)
            action = np.sign(np.random.default_rng(seed).normal(size=plain.action_space.shape)).astype(np.float32)
            for _ in range(50):
                observation, reward, cost, terminated, truncated, info = env.step(action)
                expected, own_reward, own_terminated, own_truncated, own_info = plain.step(action)
                np.testing.assert_equal(observation, expected)
                assert (reward, terminated, truncated, info) == (own_reward, own_terminated, own_truncated, own_info)
                assert cost == own_info["cost"]
                total += cost
                if terminated or truncated:
                    break
            if total > 0.0:
                return
        raise AssertionError("no step has cost anything")


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
        env: Any = SolverShield(gymnasium.make("PCM/2RFR-Reach-v0"), least_margin=0.2)
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

    @pytest.mark.parametrize("behaviour", ["terminate", "snap", "hold", "continue"])
    def test_stability_and_margin_are_kept_by_clamps_that_follow_late(self, behaviour: str) -> None:
        keywords = {"mechanism": "2RFR-paper", "on_instability": behaviour, **LATE, **RANDOMISED}
        plain = episodes(make("PCM/2RFR-Reach-v0", **keywords), 8)
        shielded = episodes(SolverShield(make("PCM/2RFR-Reach-v0", **keywords)), 8)
        assert sum(info["cost_unstable"] for info in plain) > 1
        assert sum(info["shielded"] for info in shielded) > 10
        assert not any(info["cost_unstable"] or info["cost_solver"] for info in shielded)
        least = make_bare("PCM/2RFR-Reach-v0").singular_margin
        assert min(info["singularity_margin"] for info in shielded) > least * (1.0 - 1e-6)

    def test_a_safe_next_step_is_not_enough_where_clamps_follow_late(self) -> None:
        """With the same candidates but without a look at stopping, what is lost is lost for good."""

        def best_next_step(env: Any, wanted: np.ndarray) -> np.ndarray:
            generator = np.random.default_rng(0)
            others = generator.uniform(-1.0, 1.0, (200, 2)).astype(np.float32)
            told = env.unwrapped.preview(np.concatenate([wanted[None], others]))
            margins = np.where(told.cost_unstable > 0.0, -1.0, told.singularity_margin)
            is_safe = margins >= env.unwrapped.singular_margin
            return wanted if is_safe[0] else others[margins[1:].argmax()]

        keywords = {"actuator_lag": 5.0}
        without = episodes(make("PCM/2RFR-Reach-v0", **keywords), 10, best_next_step)
        assert any(info["cost_unstable"] for info in without)
        shielded = episodes(SolverShield(make("PCM/2RFR-Reach-v0", **keywords)), 10)
        assert not any(info["cost_unstable"] or info["cost_singular"] for info in shielded)

    def test_the_action_that_is_taken_is_one_that_was_asked_about(self) -> None:
        """To the last bit: what it was told to do is what it does."""
        taken = []

        class Recorder(gymnasium.Wrapper):
            def step(self, action: Any) -> Any:
                bare: Any = self.env.unwrapped
                taken.append((action, bare.preview(action[None])))
                return self.env.step(action)

        env = SolverShield(Recorder(gymnasium.make("PCM/2RFR-Reach-v0", actuator_lag=1.0)), least_margin=0.2)
        env.reset(seed=4)
        replaced = 0
        for action in sweeping_actions(80, (2,), seed=1, hold=40):
            *_, info = env.step(action)
            chosen, told = taken[-1]
            assert chosen.dtype == np.float32
            assert env.action_space.contains(chosen)
            assert told.singularity_margin[0] == info["singularity_margin"]
            if info["shielded"]:
                replaced += 1
                assert told.singularity_margin[0] >= 0.2 * (1.0 - 1e-6)
            else:
                assert chosen is action
        assert replaced > 5

    def test_a_margin_that_is_too_small_never_falls(self) -> None:
        env = SolverShield(gymnasium.make("PCM/2RFR-Reach-v0"), least_margin=3.0)
        risen = 0
        for seed in range(6):
            _, info = env.reset(seed=seed)
            margin = first = info["singularity_margin"]
            assert margin < 3.0
            for action in sweeping_actions(30, (2,), seed=seed):
                *_, info = env.step(action)
                assert info["cost_unstable"] == 0.0
                assert info["singularity_margin"] >= min(margin, 3.0) * (1.0 - 1e-9)
                margin = info["singularity_margin"]
            risen += margin > first
        assert risen > 3

    def test_from_an_unstable_start_the_action_asked_for_is_taken_if_none_leads_to_stability(self) -> None:
        plain = make("PCM/2RFR-Reach-v0", on_instability="continue")
        home = pcm_gym.home_equilibrium(plain.unwrapped.mechanism)
        unstable = next(found for found in pcm_gym.solve_forward(home.mechanism, home.inputs) if not found.is_stable)
        env = SolverShield(gymnasium.make("PCM/2RFR-Reach-v0", on_instability="continue"))
        action = np.array([0.5, -0.25], dtype=np.float32)
        for own in (plain, env):
            own.reset(seed=0, options={"equilibrium": unstable})
        *_, info = env.step(action)
        *_, expected = plain.step(action)
        assert info == {**expected, "shielded": True}

    def test_of_a_foreign_environment_is_an_error(self) -> None:
        with pytest.raises(TypeError, match="env must be an environment of pcm_gym"):
            SolverShield(gymnasium.make("CartPole-v1"))

    def test_around_what_changes_actions_is_an_error(self) -> None:
        env = gymnasium.make("PCM/2RFR-Reach-v0")
        halved = TransformAction(env, lambda action: 0.5 * action, env.action_space)
        with pytest.raises(ValueError, match="env must not change actions, put TransformAction around the shield"):
            SolverShield(halved)

    @pytest.mark.parametrize("margin", [0.0, -1.0, float("nan")])
    def test_margin_must_be_positive(self, margin: float) -> None:
        with pytest.raises(ValueError, match="least_margin must be"):
            SolverShield(gymnasium.make("PCM/2RFR-Reach-v0"), least_margin=margin)


class TestVectorSolverShield:
    @pytest.mark.parametrize("mode", list(AutoresetMode))
    @pytest.mark.parametrize(
        ("name", "keywords"),
        [
            ("PCM/2RFR-Reach-v0", {"on_instability": "terminate"}),
            ("PCM/2RFR-Track-v0", {"on_instability": "snap", **LATE, **RANDOMISED}),
            ("PCM/2PFR-Reach-v0", {"on_instability": "continue", "load": (2.0, -1.0), "actuator_lag": 1.0}),
            ("PCM/3PFR-Reach-v0", {"on_instability": "hold", "rate_limit": 0.025}),
        ],
    )
    def test_is_the_single_one_row_by_row_and_bit_for_bit(
        self, name: str, keywords: dict[str, Any], mode: AutoresetMode
    ) -> None:
        keywords, margin = {**keywords, "max_episode_steps": 25}, 0.15
        native: Any = VectorSolverShield(make_native(name, 4, autoreset_mode=mode, **keywords), least_margin=margin)
        sync = gymnasium.make_vec(
            name,
            num_envs=4,
            vectorization_mode="sync",
            vector_kwargs={"autoreset_mode": mode},
            wrappers=[lambda env: SolverShield(env, least_margin=margin)],
            **keywords,
        )
        assert_same(native.reset(seed=3), sync.reset(seed=3))
        replaced = 0
        for action in sweeping_actions(60, native.action_space.shape, seed=4, hold=25):
            found, expected = native.step(action), sync.step(action)
            infos = found[4]
            replaced += infos["shielded"].sum()
            if "shielded" not in expected[4]:  # no row has one
                assert not infos.pop("shielded").any()
                assert not infos.pop("_shielded").any()
            assert_same(found, expected)
            ended = found[2] | found[3]
            if mode is AutoresetMode.DISABLED and ended.any():
                options = {"reset_mask": ended}
                assert_same(native.reset(options=options), sync.reset(options=dict(options)))
        assert replaced > 5

    def test_many_rows_are_decided_as_few_are(self) -> None:
        """More rows are unsafe than are worked on at a time."""
        count, keywords = 400, {"actuator_lag": 1.0, "max_episode_steps": 60}
        many, few = (
            VectorSolverShield(make_native("PCM/2RFR-Reach-v0", rows, threads=2, **keywords), least_margin=1.0)
            for rows in (count, 3)
        )
        many.reset(seed=0)
        few.reset(seed=0)
        for actions in sweeping_actions(4, (count, 2), seed=0):
            observation, _, _, _, infos = many.step(actions)
            expected, _, _, _, own = few.step(actions[:3])
            assert_same({key: array[:3] for key, array in observation.items()}, expected)
            assert infos["shielded"][:3].tolist() == own["shielded"].tolist()
            assert infos["shielded"].sum() > 256

    def test_safe_actions_pass_unchanged(self) -> None:
        plain = make_native("PCM/2RFR-Reach-v0", 3)
        env = VectorSolverShield(make_native("PCM/2RFR-Reach-v0", 3))
        assert_same(env.reset(seed=1), plain.reset(seed=1))
        for action in 0.1 * sweeping_actions(20, plain.action_space.shape, seed=1):
            ours, theirs = env.step(action), plain.step(action)
            assert not ours[4].pop("shielded").any()
            assert ours[4].pop("_shielded").all()
            assert_same(ours, theirs)

    def test_of_foreign_environments_is_an_error(self) -> None:
        for mode in ("sync", "vector_entry_point"):
            name = "PCM/2RFR-Reach-v0" if mode == "sync" else "CartPole-v1"
            with pytest.raises(TypeError, match="env must be a native batch of pcm_gym"):
                VectorSolverShield(gymnasium.make_vec(name, num_envs=2, vectorization_mode=mode))

    def test_around_what_changes_actions_is_an_error(self) -> None:
        batch = make_native("PCM/2RFR-Reach-v0", 2)
        halved = gymnasium.wrappers.vector.TransformAction(batch, lambda actions: 0.5 * actions)
        with pytest.raises(ValueError, match="env must not change actions, put TransformAction around the shield"):
            VectorSolverShield(halved)

    def test_margin_must_be_positive(self) -> None:
        with pytest.raises(ValueError, match="least_margin must be"):
            VectorSolverShield(make_native("PCM/2RFR-Reach-v0", 2), least_margin=0.0)

    def test_actions_before_the_first_reset_are_refused(self) -> None:
        with pytest.raises(gymnasium.error.ResetNeeded):
            VectorSolverShield(make_native("PCM/2RFR-Reach-v0", 2)).step(np.zeros((2, 2), np.float32))


def test_wrappers_have_a_module_of_their_own() -> None:
    for name in ("CostStep", "SolverShield", "VectorSolverShield"):
        assert getattr(pcm_gym.wrappers, name) is getattr(pcm_gym, name)


@pytest.mark.parametrize("name", IDS)
def test_flat_observation_of_gymnasium_holds_all_three_parts(name: str) -> None:
    env = FlattenObservation(gymnasium.make(name))
    observation, _ = env.reset(seed=0)
    parts, _ = env.unwrapped.reset(seed=0)
    assert observation in env.observation_space
    assert sorted(observation) == sorted(np.concatenate(list(parts.values())))
