"""The adapter keeps Stable-Baselines3's conventions, on a batch whose every step is known beforehand."""

from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from stable_baselines3.common.vec_env import VecMonitor

from agents.learners.infos import Infos
from agents.learners.vector_adapter import CostPenalty, EpisodeMonitor, NativeVecEnv

TIME_LIMIT = 3
STAY, TERMINATE = np.array([0.0]), np.array([1.0])


class Counter(gymnasium.Env[Any, Any]):
    """Counts its steps from a first value drawn at the reset; a positive action ends the episode."""

    observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (1,), np.float64)
    action_space = gymnasium.spaces.Box(-1.0, 1.0, (1,), np.float64)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        super().reset(seed=seed)
        self.steps = 0
        self.first = (options or {}).get("first", self.np_random.uniform(0.0, 0.5))
        return self._observation(), {"phase": "reset"}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        self.steps += 1
        is_terminated = bool(action[0] > 0.0)
        info = {"phase": "step", "cost": 0.25 * self.steps, "is_success": is_terminated}
        return self._observation(), 1.0, is_terminated, False, info

    def shout(self, word: str) -> str:
        return word.upper()

    def _observation(self) -> Any:
        return np.array([self.first + self.steps])


def make_batch(count: int, mode: AutoresetMode = AutoresetMode.SAME_STEP) -> SyncVectorEnv:
    def make() -> gymnasium.Env[Any, Any]:
        return gymnasium.wrappers.TimeLimit(Counter(), TIME_LIMIT)

    return SyncVectorEnv([make] * count, autoreset_mode=mode)


@pytest.fixture
def adapter() -> NativeVecEnv:
    adapter = NativeVecEnv(make_batch(3))
    adapter.seed(7)
    adapter.reset()
    return adapter


def step_all(adapter: Any, *actions: Any) -> Any:
    return adapter.step(np.array(actions))


def test_time_running_out_is_marked_as_truncation(adapter: NativeVecEnv) -> None:
    for _ in range(TIME_LIMIT):
        _, _, dones, infos = step_all(adapter, STAY, STAY, STAY)
    assert dones.all()
    assert [info["TimeLimit.truncated"] for info in infos] == [True] * 3


def test_termination_is_not_marked_even_when_time_runs_out_as_well(adapter: NativeVecEnv) -> None:
    _, _, dones, infos = step_all(adapter, TERMINATE, STAY, STAY)
    assert dones.tolist() == [True, False, False]
    assert infos[0]["TimeLimit.truncated"] is False
    step_all(adapter, STAY, STAY, STAY)
    _, _, dones, infos = step_all(adapter, STAY, TERMINATE, STAY)
    assert dones.tolist() == [False, True, True]
    assert [infos[index]["TimeLimit.truncated"] for index in (1, 2)] == [False, True]


def test_last_observation_and_info_are_those_of_the_finished_episode(adapter: NativeVecEnv) -> None:
    step_all(adapter, STAY, STAY, STAY)
    observations, _, dones, infos = step_all(adapter, STAY, TERMINATE, STAY)
    assert dones.tolist() == [False, True, False]
    assert 2.0 <= infos[1]["terminal_observation"][0] <= 2.5
    assert 0.0 <= observations[1, 0] <= 0.5, "the next episode has begun"
    assert infos[1]["cost"] == 0.5
    assert infos[1]["phase"] == "step"
    assert "terminal_observation" not in infos[0]
    assert [type(info["cost"]) for info in infos] == [float] * 3
    assert type(infos[1]["is_success"]) is bool


def test_dtypes_are_those_of_stable_baselines(adapter: NativeVecEnv) -> None:
    _, rewards, dones, infos = step_all(adapter, STAY, TERMINATE, STAY)
    assert (rewards.dtype, dones.dtype) == (np.float32, np.bool_)
    assert [type(info) for info in infos] == [dict] * 3


def test_monitor_counts_episodes_and_keeps_keywords() -> None:
    monitored = VecMonitor(NativeVecEnv(make_batch(2)), info_keywords=("is_success",))
    monitored.reset()
    step_all(monitored, STAY, STAY)
    _, _, _, infos = step_all(monitored, STAY, TERMINATE)
    assert (infos[1]["episode"]["l"], infos[1]["episode"]["r"], infos[1]["episode"]["is_success"]) == (2, 2.0, True)
    assert "episode" not in infos[0]


def test_monitor_tells_of_episodes_what_that_of_stable_baselines_does() -> None:
    own, theirs = EpisodeMonitor(NativeVecEnv(make_batch(2))), VecMonitor(NativeVecEnv(make_batch(2)))
    for monitored in (own, theirs):
        monitored.seed(3)
        monitored.reset()
    for actions in [(STAY, STAY), (STAY, TERMINATE), (STAY, STAY), (TERMINATE, STAY)]:
        *_, found = step_all(own, *actions)
        *_, expected = step_all(theirs, *actions)
        for info, other in zip(found, expected, strict=True):
            assert info.keys() == other.keys()
            if "episode" in info:
                assert {key: info["episode"][key] for key in "rl"} == {key: other["episode"][key] for key in "rl"}


def test_what_is_written_into_an_info_stays(adapter: NativeVecEnv) -> None:
    _, _, _, infos = step_all(adapter, STAY, TERMINATE, STAY)
    infos[1]["terminal_observation"] = "changed"
    for same in (infos[1], infos[-2], infos[1:][0], list(infos)[1]):
        assert same["terminal_observation"] == "changed"
    with pytest.raises(IndexError):
        infos[3]


def test_penalty_takes_the_weighted_cost_from_the_reward_alone() -> None:
    penalised = CostPenalty(NativeVecEnv(make_batch(2)), weight=2.0)
    penalised.reset()
    _, rewards, _, infos = step_all(penalised, STAY, TERMINATE)
    np.testing.assert_array_equal(rewards, np.array([0.5, 0.5], dtype=np.float32))
    assert [info["cost"] for info in infos] == [0.25, 0.25]


def test_seed_and_options_hold_for_one_reset(adapter: NativeVecEnv) -> None:
    adapter.seed(7)
    first = adapter.reset()
    adapter.seed(7)
    np.testing.assert_array_equal(adapter.reset(), first)
    adapter.set_options({"first": 0.25})
    np.testing.assert_array_equal(adapter.reset(), np.full((3, 1), 0.25))
    assert (np.asarray(adapter.reset()) != 0.25).all()
    assert [info["phase"] for info in adapter.reset_infos] == ["reset"] * 3


def test_options_per_environment_are_refused(adapter: NativeVecEnv) -> None:
    with pytest.raises(TypeError, match="one dictionary"):
        adapter.set_options([{}, {}, {}])


def test_attributes_and_methods_are_the_batch_s(adapter: NativeVecEnv) -> None:
    assert adapter.get_attr("num_envs", indices=[0, 2]) == [3, 3]
    assert adapter.env_method("get_attr", "steps", indices=0) == [(0, 0, 0)]
    adapter.set_attr("note", "seen")
    assert adapter.get_attr("note") == ["seen"] * 3
    with pytest.raises(ValueError, match="whole batch"):
        adapter.set_attr("note", "some", indices=[0])
    with pytest.raises(AttributeError):
        adapter.get_attr("absent")


def test_wrappers_of_the_batch_are_seen() -> None:
    wrapped = gymnasium.wrappers.vector.RecordEpisodeStatistics(make_batch(2))
    adapter = NativeVecEnv(wrapped)
    assert adapter.env_is_wrapped(gymnasium.wrappers.vector.RecordEpisodeStatistics) == [True, True]
    assert adapter.env_is_wrapped(gymnasium.wrappers.TimeLimit) == [False, False]


def test_images_are_none_without_a_render_mode(adapter: NativeVecEnv) -> None:
    assert list(adapter.get_images()) == [None] * 3


@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.DISABLED])
def test_other_ways_of_resetting_are_refused(mode: AutoresetMode) -> None:
    with pytest.raises(ValueError, match="SAME_STEP"):
        NativeVecEnv(make_batch(1, mode))


def test_masked_and_nested_infos_are_split() -> None:
    mask = np.array([True, False])
    infos = {
        "a": np.array([1, 2]),
        "b": np.array([0.5, 0.0]),
        "_b": mask,
        "c": {"d": np.eye(2), "_d": mask},
        "_c": mask,
    }
    first, second = Infos(infos, 2)
    assert (first["a"], first["b"], second) == (1, 0.5, {"a": 2})
    np.testing.assert_array_equal(first["c"]["d"], [1.0, 0.0])
