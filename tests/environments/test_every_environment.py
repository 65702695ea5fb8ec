"""Every registered environment keeps Gymnasium's conventions and its own contract."""

import copy
import json
import pickle
import subprocess
import sys
from itertools import combinations, pairwise
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode
from gymnasium.wrappers.vector import FlattenObservation, NormalizeObservation, RecordEpisodeStatistics

import pcm_gym
from tests.environments.rollouts import (
    COSTS,
    assert_same,
    chosen_ids,
    digests_of_all,
    info_types,
    leaves,
    make,
    make_bare,
    make_native,
    mechanism_of,
    roll_batch,
    roll_single,
    sweeping_actions,
)

ROOT = Path(__file__).parents[2]
IDS = chosen_ids()
AUTORESET_MODES = list(AutoresetMode)
LOSSES = (pcm_gym.Event.FOLD, pcm_gym.Event.INDEX_CHANGE)

pytestmark = pytest.mark.parametrize("environment_id", IDS)


def variants(environment_id: str) -> list[dict[str, Any]]:
    """Keywords that reach every way of ending, both rewards and a load."""
    return [{}, {"reward_type": "sparse", "load": (0.05, -0.1)}]


def terminates(environment_id: str) -> bool:
    """Whether the loss of stability ends episodes, as it does where no other behaviour is registered."""
    return gymnasium.spec(environment_id).kwargs.get("on_instability", "terminate") == "terminate"


def is_stable_element(env: Any) -> int:
    return [element.name for element in env.elements].index("is_stable")


# Conventions of Gymnasium and Stable-Baselines3


def test_passes_gymnasiums_check(environment_id: str) -> None:
    check_env(make_bare(environment_id, render_mode="rgb_array"))


def test_passes_stable_baselines_check(environment_id: str, capsys: pytest.CaptureFixture[str]) -> None:
    checker = pytest.importorskip("stable_baselines3.common.env_checker")
    checker.check_env(make_bare(environment_id, render_mode="rgb_array"), warn=True)
    assert capsys.readouterr().out.count("\n") <= 2  # that it takes the environment for one with goals, nothing else


def test_spec_survives_json_and_pickle(environment_id: str) -> None:
    spec = gymnasium.make(environment_id, reward_type="sparse", load=[0.0, 0.01]).spec
    assert spec is not None
    assert pickle.loads(pickle.dumps(spec)) == spec
    again = EnvSpec.from_json(spec.to_json())
    assert json.loads(again.to_json()) == json.loads(spec.to_json())
    assert_same(roll_single(gymnasium.make(again), 1, 20), roll_single(gymnasium.make(spec), 1, 20))


def test_name_with_module_can_be_made(environment_id: str) -> None:
    assert make(f"pcm_gym:{environment_id}").spec.id == environment_id


def test_picture_is_of_bytes(environment_id: str) -> None:
    env = make_bare(environment_id, render_mode="rgb_array")
    env.reset(seed=0)
    picture = env.render()
    assert (picture.dtype, picture.ndim, picture.shape[2]) == (np.uint8, 3, 3)
    assert np.ptp(picture) > 0


# Determinism and independence


def test_equal_seeds_give_equal_rollouts(environment_id: str) -> None:
    used = make_bare(environment_id)
    roll_single(used, seed=4, steps=30)
    assert_same(roll_single(make_bare(environment_id), 3, 120), roll_single(used, 3, 120))
    used = make_native(environment_id, 4)
    roll_batch(used, seed=4, steps=30)
    assert_same(roll_batch(make_native(environment_id, 4), 3, 120), roll_batch(used, 3, 120))


def test_other_seeds_give_other_rollouts(environment_id: str) -> None:
    env = make_bare(environment_id)
    first, second = env.reset(seed=1)[0], env.reset(seed=2)[0]
    assert not np.array_equal(first["observation"], second["observation"])
    assert not np.array_equal(first["desired_goal"], second["desired_goal"])


@pytest.fixture(scope="module")
def digests_elsewhere() -> dict[str, list[str]]:
    code = "import json; from tests.environments.rollouts import digests_of_all; print(json.dumps(digests_of_all()))"
    result = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    found: dict[str, list[str]] = json.loads(result.stdout)
    return found


@pytest.fixture(scope="module")
def digests_here() -> dict[str, list[str]]:
    return digests_of_all()


def test_another_process_gives_equal_rollouts(
    environment_id: str, digests_here: dict[str, list[str]], digests_elsewhere: dict[str, list[str]]
) -> None:
    assert digests_here[environment_id] == digests_elsewhere[environment_id]


def test_overwriting_what_was_returned_changes_nothing(environment_id: str) -> None:
    assert_same(
        roll_single(make_bare(environment_id), 6, 80),
        roll_single(make_bare(environment_id), 6, 80, spoil=True),
    )
    for mode in (AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP):
        envs = [make_native(environment_id, 4, autoreset_mode=mode) for _ in range(2)]
        assert_same(roll_batch(envs[0], 6, 80), roll_batch(envs[1], 6, 80, spoil=True))


@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
def test_returned_arrays_share_no_memory(environment_id: str, mode: AutoresetMode) -> None:
    env = make_native(environment_id, 3, autoreset_mode=mode, max_episode_steps=3)
    results: list[Any] = [env.reset(seed=0)]
    results += [env.step(env.action_space.sample()) for _ in range(5)]
    arrays = [(path, leaf) for path, leaf in leaves(results) if isinstance(leaf, np.ndarray)]
    for (path, array), (other_path, other) in combinations(arrays, 2):
        assert not np.shares_memory(array, other), (path, other_path)


def test_state_in_the_middle_of_an_episode_is_restored_exactly(environment_id: str) -> None:
    def rest(env: Any) -> list[Any]:
        actions = sweeping_actions(25, env.action_space.shape, seed=8)
        return [*(env.step(action) for action in actions), env.reset(), env.step(actions[0]), env.equilibrium.state]

    env, other = (make_bare(environment_id) for _ in range(2))
    env.reset(seed=1)
    for action in sweeping_actions(7, env.action_space.shape, seed=9):
        env.step(action)
    state = env.save_state()
    pickled = pickle.dumps(state)
    first = rest(env)
    env.restore_state(state)
    assert_same(rest(env), first)
    other.restore_state(pickle.loads(pickled))
    assert_same(rest(other), first)
    assert pickle.dumps(env.save_state()) == pickle.dumps(other.save_state())


@pytest.mark.parametrize("mode", AUTORESET_MODES)
def test_state_of_a_batch_is_restored_exactly(environment_id: str, mode: AutoresetMode) -> None:
    def rest(env: Any) -> list[Any]:
        results = []
        for action in sweeping_actions(30, env.action_space.shape, seed=8):
            results.append(env.step(action))
            ended = results[-1][2] | results[-1][3]
            if mode is AutoresetMode.DISABLED and ended.any():
                results.append(env.reset(options={"reset_mask": ended}))
        return results

    env, other = (make_native(environment_id, 3, autoreset_mode=mode, max_episode_steps=20) for _ in range(2))
    env.reset(seed=1)
    for action in sweeping_actions(15, env.action_space.shape, seed=9):
        *_, terminated, truncated, _ = env.step(action)
        if mode is AutoresetMode.DISABLED and (terminated | truncated).any():
            env.reset(options={"reset_mask": terminated | truncated})
    state = env.save_state()
    pickled = pickle.dumps(state)
    first = rest(env)
    env.restore_state(state)
    assert_same(rest(env), first)
    other.restore_state(pickle.loads(pickled))
    assert_same(rest(other), first)
    assert (env.np_random_seed, other.np_random_seed) == ((1, 2, 3), (1, 2, 3))


def test_copies_go_on_alike_and_apart(environment_id: str) -> None:
    env = make_bare(environment_id)
    env.reset(seed=1)
    env.step(env.action_space.high)
    copies = [copy.deepcopy(env), pickle.loads(pickle.dumps(env))]
    first = [env.step(env.action_space.low), env.reset()]
    for other in copies:
        assert_same([other.step(other.action_space.low), other.reset()], first)


# Observation, info, reward


def test_observations_are_in_their_space_and_no_element_is_constant(environment_id: str) -> None:
    env = make_native(environment_id, 1000)  # 100,000 steps
    space = env.observation_space
    lowest, highest = np.full(space["observation"].shape[1], np.inf), np.full(space["observation"].shape[1], -np.inf)
    observation, _ = env.reset(seed=0)
    actions = sweeping_actions(100, env.action_space.shape, seed=0)
    for action in [None, *actions]:
        if action is not None:
            observation, *_ = env.step(action)
        assert space.contains(observation)
        lowest = np.minimum(lowest, observation["observation"].min(axis=0))
        highest = np.maximum(highest, observation["observation"].max(axis=0))
    names = [element.name for element in make_bare(environment_id).elements]
    constant = [name for name, low, high in zip(names, lowest, highest, strict=True) if high - low < 1e-3]
    assert constant == ([] if terminates(environment_id) else ["is_stable"])  # one layout, whatever ends episodes


def test_info_of_a_step_has_the_keys_types_and_values_of_the_contract(environment_id: str) -> None:
    for keywords in variants(environment_id):
        env = make_bare(environment_id, **keywords)
        for record in roll_single(env, seed=2, steps=100):
            info = record[-1]
            assert {key: type(value) for key, value in info.items()} == info_types(env)
            assert info["cost"] == sum(info[key] for key in COSTS)
            assert all(info[key] in (0.0, 1.0) for key in COSTS)
            assert 0.0 <= info["singularity_margin"] <= 10.0
            assert 0.0 <= info["residual"] <= 1e-10
            if len(record) == 2:  # a reset
                assert (info["cost"], info["event"], info["index"]) == (0.0, pcm_gym.Event.NONE, 0)
                continue
            _, reward, terminated, truncated, _ = record
            assert [type(value) for value in (reward, terminated, truncated)] == [float, bool, bool]
            assert reward >= 0.0
            is_lost = info["event"] in LOSSES
            assert info["cost_unstable"] == float(is_lost)
            assert terminated == (is_lost and terminates(environment_id))
            assert info["cost_solver"] == float(info["event"] == pcm_gym.Event.SOLVER_FAILURE)
            assert info["cost_singular"] == float(info["singularity_margin"] < env.singular_margin)


def test_info_of_a_batch_is_that_of_its_rows(environment_id: str) -> None:
    env = make_native(environment_id, 3)
    observation, infos = env.reset(seed=0)
    for _ in range(2):
        assert {key for key in infos if not key.startswith("_")} == set(info_types(env))
        for key, kind in info_types(env).items():
            assert infos[key].dtype == np.dtype(kind), key
            assert (infos[f"_{key}"].dtype, infos[f"_{key}"].tolist()) == (np.bool_, [True] * 3)
        assert {key: array.dtype for key, array in observation.items()} == dict.fromkeys(observation, np.float64)
        observation, reward, terminated, truncated, infos = env.step(env.action_space.sample())
        assert [array.dtype for array in (reward, terminated, truncated)] == [np.float64, np.bool_, np.bool_]


@pytest.mark.parametrize("reward_type", ["dense", "sparse"])
def test_compute_reward_is_the_reward_of_the_step(environment_id: str, reward_type: str) -> None:
    _, *goals = _rewards_and_goals(environment_id)
    achieved, desired = goals
    task = make_bare(environment_id).task
    middle = np.median(np.sqrt((achieved - desired) ** 2 @ task.goals.scale.weights))
    keywords: dict[str, Any] = {"reward_type": reward_type, "hold_steps": 1}
    if not task.counts_all:  # such a task begins at its goal, and has no paths that are large beside a middle distance
        keywords["success_distance"] = float(middle)
    single = make_bare(environment_id, **keywords)
    expected, *goals = _rewards_and_goals(environment_id, **keywords)
    assert (expected >= 0.0).all()
    assert np.ptp(expected) > 0.03
    found = single.compute_reward(*goals, {})
    assert found.dtype == np.float64
    assert found.tobytes() == expected.tobytes()
    for row in (0, len(expected) - 1):
        alone = single.compute_reward(goals[0][row], goals[1][row], {})
        assert (type(alone), alone) == (float, expected[row])


def _rewards_and_goals(environment_id: str, **keywords: Any) -> list[Any]:
    """Rewards, achieved and desired goals of many steps, all rows in a run."""
    env = make_native(environment_id, 50, max_episode_steps=None, **keywords)
    env.reset(seed=0)
    parts = []
    for action in sweeping_actions(20, env.action_space.shape, seed=1):
        observation, reward, terminated, truncated, infos = env.step(action)
        is_step = ~(terminated | truncated)
        parts.append([array[is_step] for array in (reward, observation["achieved_goal"], observation["desired_goal"])])
        if keywords.get("reward_type") == "sparse" and not env.task.counts_all:
            assert (reward[is_step] == infos["is_success"][is_step]).all()
        if (terminated | truncated).any():
            env.reset()
    return [np.concatenate(part) for part in zip(*parts, strict=True)]


# Ways of ending


def test_losing_stability_terminates_with_a_cost(environment_id: str) -> None:
    if not terminates(environment_id):
        pytest.skip("it falls and goes on: tests of the four behaviours")
    env = make_bare(environment_id)
    events = set()
    for seed in range(40):
        env.reset(seed=seed)
        action = np.sign(np.random.default_rng(seed).normal(size=env.action_space.shape))
        for _ in range(50):
            before = env.equilibrium
            observation, _, terminated, truncated, info = env.step(action)
            if terminated:
                events.add(info["event"])
                assert not truncated
                assert info["cost_unstable"] == 1.0
                assert observation["observation"][is_stable_element(env)] == 0.0
                assert env.observation_space.contains(observation)
                # the state is the one just before the event, on the way of this step
                way = env.equilibrium.inputs - before.inputs
                assert (np.abs(way) <= env.max_action + 1e-12).all()
                assert (env.equilibrium.residual, env.equilibrium.is_stable) <= (1e-10, True)
                break
            assert observation["observation"][is_stable_element(env)] == 1.0
            assert (info["index"], info["cost_unstable"]) == (0, 0.0)
    assert pcm_gym.Event.FOLD in events


def test_running_out_of_time_truncates(environment_id: str) -> None:
    limit = gymnasium.spec(environment_id).max_episode_steps
    assert limit is not None
    env, batch = make(environment_id), make_native(environment_id, 2)
    env.reset(seed=0)
    batch.reset(seed=0)
    stay = np.zeros(env.action_space.shape, np.float32)
    for step in range(1, limit + 1):
        _, _, terminated, truncated, info = env.step(stay)
        assert (terminated, truncated, info["cost"]) == (False, step == limit, 0.0)
        _, _, terminated, truncated, _ = batch.step(np.stack([stay, stay]))
        assert (terminated.tolist(), truncated.tolist()) == ([False] * 2, [step == limit] * 2)


def test_limits_of_the_actuators_cut_the_step_without_cost(environment_id: str) -> None:
    env = make_bare(environment_id)
    lower, upper = env.mechanism.lower_limits, env.mechanism.upper_limits
    cut_count = 0
    for seed in range(20):
        env.reset(seed=seed)
        for action in sweeping_actions(50, env.action_space.shape, seed, hold=25):
            wish = env.equilibrium.inputs + action * env.max_action
            observation, _, terminated, _, info = env.step(action)
            if terminated:
                break
            outside = np.maximum(lower - wish, wish - upper).max()
            if abs(outside) > 1e-9:
                assert info["at_limit"] == (outside > 0.0)
                assert info["cost"] == info["cost_unstable"] + info["cost_singular"] + info["cost_solver"]
                if info["event"] not in LOSSES:
                    assert info["event"] == (pcm_gym.Event.ACTUATOR_LIMIT if outside > 0.0 else pcm_gym.Event.NONE)
                cut_count += int(outside > 0.0)
            np.testing.assert_allclose(env.equilibrium.inputs, np.clip(wish, lower, upper), rtol=0.0, atol=1e-12)
            assert env.equilibrium.within_limits
            assert env.observation_space.contains(observation)
    assert cut_count > 5


def test_actions_are_cut_to_their_box_without_cost(environment_id: str) -> None:
    env = make_bare(environment_id)
    outcomes = []
    for factor in (1.0, 7.0):
        env.reset(seed=0)
        outcomes.append(env.step(factor * np.ones(env.action_space.shape)))
    assert_same(*outcomes)


def test_failure_of_the_solver_rolls_back_and_truncates(environment_id: str) -> None:
    """A state that is no equilibrium stands in for a natural failure: the solver cannot follow a branch from it."""
    env = make_bare(environment_id)
    env.reset(seed=0)
    state = env.save_state()
    state["rows"]["x"][0, : 2 * env.mechanism.leg_count] += 0.5
    env.restore_state(state)
    before = env.save_state()
    observation, reward, terminated, truncated, info = env.step(env.action_space.high)
    assert (terminated, truncated) == (False, True)
    assert (info["event"], info["cost_solver"], info["cost_unstable"]) == (pcm_gym.Event.SOLVER_FAILURE, 1.0, 0.0)
    assert info["cost"] == 1.0 + info["cost_singular"]
    assert reward >= 0.0
    assert env.observation_space.contains(observation)
    after = env.save_state()
    assert after["rows"].pop("elapsed") == before["rows"].pop("elapsed") + 1
    before["rows"].pop("held"), after["rows"].pop("held")
    assert_same(after, before)
    env.reset(seed=0)
    assert env.step(env.action_space.high)[3] is False


def test_failure_of_one_row_is_no_matter_of_the_others(environment_id: str) -> None:
    healthy, broken = (make_native(environment_id, 3) for _ in range(2))
    healthy.reset(seed=0)
    broken.reset(seed=0)
    broken._simulation.rows.x[1, -2:] += 0.7
    kept = broken._simulation.rows.x[1].copy()
    actions = np.ones(healthy.action_space.shape, np.float32)
    expected, found = healthy.step(actions), broken.step(actions)
    assert found[3].tolist() == [False, True, False]
    assert found[2].tolist() == expected[2].tolist()
    assert found[4]["cost_solver"].tolist() == [0.0, 1.0, 0.0]
    assert np.array_equal(broken._simulation.rows.x[1], kept)
    for row in (0, 2):
        assert_same(*({key: array[row] for key, array in result[0].items()} for result in (expected, found)))
    observation, reward, terminated, truncated, infos = broken.step(actions)
    assert (reward[1], terminated[1], truncated[1], infos["cost"][1]) == (0.0, False, False, 0.0)
    assert broken.observation_space.contains(observation)


def test_nearly_singular_is_half_of_the_smallest_step(environment_id: str) -> None:
    env = make_bare(environment_id)
    smallest = (env.max_action / env.mechanism.units.inputs).min()
    assert env.singular_margin == pytest.approx(0.5 * smallest, rel=1e-15)
    unequal = make_bare(environment_id, max_action=np.linspace(0.02, 0.04, len(env.max_action)))
    assert unequal.singular_margin == pytest.approx(0.01 / env.mechanism.units.inputs[0], rel=1e-15)


def test_closeness_to_singularity_costs(environment_id: str) -> None:
    env = make_bare(environment_id)
    costs = set()
    for record in roll_single(env, 0, 600):
        if len(record) == 5:
            info = record[-1]
            assert info["cost_singular"] == float(info["singularity_margin"] < env.singular_margin)
            costs.add(info["cost_singular"])
    assert costs == {0.0, 1.0}


@pytest.mark.parametrize("position", ["single", "batch"])
def test_actions_that_are_not_finite_or_misshaped_are_refused(environment_id: str, position: str) -> None:
    env = make_bare(environment_id) if position == "single" else make_native(environment_id, 2)
    env.reset(seed=0)
    good = np.zeros(env.action_space.shape)
    first = env.step(good)
    bad = good.copy()
    bad.flat[-1] = np.nan
    for wrong in (bad, good + np.inf, good[..., :1], good[None], 0.0, [0.0] * 7):
        with pytest.raises(ValueError, match="action"):
            env.step(wrong)
    # standing still corrects the last bit or two
    np.testing.assert_allclose(env.step(good)[0]["achieved_goal"], first[0]["achieved_goal"], rtol=0.0, atol=1e-12)


# The batch


@pytest.mark.parametrize("mode", AUTORESET_MODES)
def test_batch_equals_single_environments_bit_for_bit(environment_id: str, mode: AutoresetMode) -> None:
    ends = np.zeros(2, dtype=int)
    for keywords in variants(environment_id):
        native = make_native(environment_id, 5, autoreset_mode=mode, max_episode_steps=50, **keywords)
        sync = gymnasium.make_vec(
            environment_id,
            num_envs=5,
            max_episode_steps=50,
            vectorization_mode="sync",
            vector_kwargs={"autoreset_mode": mode},
            **keywords,
        )
        assert native.metadata["autoreset_mode"] is mode
        assert native.observation_space == sync.observation_space
        assert native.action_space == sync.action_space
        assert_same(native.reset(seed=3), sync.reset(seed=3))
        for action in sweeping_actions(130, native.action_space.shape, seed=4):
            found, expected = native.step(action), sync.step(action)
            assert_same(found, expected)
            ended = found[2] | found[3]
            ends += [found[2].sum(), found[3].sum()]
            if mode is AutoresetMode.DISABLED:
                for row in np.flatnonzero(ended):  # one by one, so that the others are seen to wait
                    options = {"reset_mask": np.arange(5) == row}
                    assert_same(native.reset(options=options), sync.reset(options=dict(options)))
    assert (ends > 0).tolist() == [terminates(environment_id), True]


def test_large_batch_equals_single_environment(environment_id: str) -> None:
    """Vectorised machine code would treat the rows of a large batch differently from a row alone."""
    native, row = make_native(environment_id, 67, max_episode_steps=None), 65
    env = make_bare(environment_id)
    actions = sweeping_actions(12, native.action_space.shape, seed=5)
    observation, _ = native.reset(seed=10)
    records: list[Any] = [(observation, 0.0)]
    records += [native.step(action)[:2] for action in actions]
    assert_same({key: array[row] for key, array in observation.items()}, env.reset(seed=10 + row)[0])
    for action, (observation, reward) in zip(actions, records[1:], strict=True):
        expected, expected_reward, terminated, _, _ = env.step(action[row])
        assert_same({key: array[row] for key, array in observation.items()}, expected)
        assert reward[row] == expected_reward
        if terminated:
            break


def test_batch_tells_of_each_row_what_a_single_environment_tells(environment_id: str) -> None:
    native, env = make_native(environment_id, 3), make_bare(environment_id)
    native.reset(seed=20)
    actions = sweeping_actions(5, native.action_space.shape, seed=6)
    for action in actions:
        native.step(action)
    env.reset(seed=21)
    for action in actions:
        env.step(action[1])
    np.testing.assert_array_equal(native.equilibrium(1).state, env.equilibrium.state)
    np.testing.assert_array_equal(native.equilibrium(1).inputs, env.equilibrium.inputs)
    np.testing.assert_array_equal(native.goal(1), env.goal)
    np.testing.assert_array_equal(native.max_action, env.max_action)
    assert native.mechanism == env.mechanism


def test_rows_that_are_not_reset_stay_as_they_are(environment_id: str) -> None:
    env = make_native(environment_id, 4, autoreset_mode=AutoresetMode.DISABLED)
    env.reset(seed=0)
    observation, *_ = env.step(env.action_space.sample())
    mask = np.array([False, True, False, True])
    options = {"reset_mask": mask.copy()}
    fresh, infos = env.reset(seed=[1, 2, 3, 4], options=options)
    np.testing.assert_array_equal(options["reset_mask"], mask)
    for key, array in fresh.items():
        np.testing.assert_array_equal(array[~mask], observation[key][~mask])
    assert (fresh["desired_goal"][mask] != observation["desired_goal"][mask]).any(axis=1).all()
    assert infos["_cost"].tolist() == mask.tolist()
    single = make_bare(environment_id)
    assert_same({key: array[3] for key, array in fresh.items()}, single.reset(seed=4)[0])
    for wrong in (np.zeros(4, np.bool_), np.ones(3, np.bool_), np.ones(4), [True] * 4):
        with pytest.raises(ValueError, match="reset_mask"):
            env.reset(options={"reset_mask": wrong})


def test_stepping_past_the_end_is_refused_where_nothing_resets(environment_id: str) -> None:
    env = make_native(environment_id, 2, autoreset_mode=AutoresetMode.DISABLED, max_episode_steps=1)
    env.reset(seed=0)
    env.step(env.action_space.sample())
    with pytest.raises(gymnasium.error.ResetNeeded, match="reset_mask"):
        env.step(env.action_space.sample())


def test_stepping_before_the_first_reset_is_refused(environment_id: str) -> None:
    env = make_native(environment_id, 2)
    with pytest.raises(ValueError, match="options key"):
        env.reset(seed=0, options={"nowhere": 1})  # is no reset
    with pytest.raises(gymnasium.error.ResetNeeded, match="reset"):
        env.step(env.action_space.sample())
    env.reset(seed=0)
    env.step(env.action_space.sample())


def test_seeds_of_a_batch_are_those_of_its_rows(environment_id: str) -> None:
    env = make_native(environment_id, 3)
    by_number, by_list = env.reset(seed=7)[0], env.reset(seed=[7, 8, 9])[0]
    assert_same(by_number, by_list)
    first = env.reset(seed=[7, None, 9])[0]
    np.testing.assert_array_equal(first["desired_goal"][[0, 2]], by_number["desired_goal"][[0, 2]])
    assert not np.array_equal(env.reset()[0]["desired_goal"], first["desired_goal"])
    with pytest.raises(ValueError, match="seed"):
        env.reset(seed=[1, 2])


@pytest.mark.parametrize("mode", AUTORESET_MODES)
def test_statistics_of_episodes_can_be_recorded(environment_id: str, mode: AutoresetMode) -> None:
    env: Any = RecordEpisodeStatistics(make_native(environment_id, 3, autoreset_mode=mode, max_episode_steps=5))
    env.reset(seed=0)
    stay, total = np.zeros(env.action_space.shape, np.float32), np.zeros(3)
    for _ in range(5):
        _, reward, _, truncated, infos = env.step(stay)
        total += reward
    assert truncated.all()
    assert infos["episode"]["l"].tolist() == [5] * 3
    np.testing.assert_allclose(infos["episode"]["r"], total, rtol=1e-12)
    if mode is AutoresetMode.DISABLED:
        env.reset(options={"reset_mask": np.ones(3, np.bool_)})
    for _ in range(5 + (mode is AutoresetMode.NEXT_STEP)):
        *_, infos = env.step(stay)
    assert infos["episode"]["l"].tolist() == [5] * 3


def test_observations_can_be_normalised(environment_id: str) -> None:
    env: Any = NormalizeObservation(FlattenObservation(make_native(environment_id, 20)))
    observation, _ = env.reset(seed=0)
    for action in sweeping_actions(60, env.action_space.shape, seed=0):
        observation, *_ = env.step(action)
    assert np.isfinite(observation).all()
    assert np.abs(observation).max() < 50.0
    assert env.observation_space.contains(observation)


# Units


def scaled(mechanism: pcm_gym.Mechanism, length: float, stiffness: float) -> pcm_gym.Mechanism:
    """The same mechanism, drawn larger and made of another material."""

    def larger(pair: tuple[float, float]) -> tuple[float, float]:
        return length * pair[0], length * pair[1]

    def leg(old: pcm_gym.Leg) -> pcm_gym.Leg:
        actuator, rod = old.actuator, old.rod
        if isinstance(actuator, pcm_gym.Revolute):
            new: Any = pcm_gym.Revolute(larger(actuator.base), actuator.clamp_angle, actuator.limits)
        else:
            new = pcm_gym.Prismatic(
                larger(actuator.base), actuator.axis_angle, actuator.clamp_angle, larger(actuator.limits)
            )
        thicker = pcm_gym.Rod(length * rod.length, stiffness * length**2 * rod.bending_stiffness)
        return pcm_gym.Leg(new, thicker, larger(old.attachment))

    legs = tuple(leg(old) for old in mechanism.legs)
    inputs_unit = [1.0 if isinstance(old.actuator, pcm_gym.Revolute) else length for old in mechanism.legs]
    assert mechanism.home_inputs is not None
    assert mechanism.home_pose is not None
    home_inputs = tuple(unit * value for unit, value in zip(inputs_unit, mechanism.home_inputs, strict=True))
    home_pose = (*(length * value for value in mechanism.home_pose[:2]), *mechanism.home_pose[2:])
    return pcm_gym.Mechanism("scaled", legs, home_inputs, home_pose)


@pytest.mark.parametrize(("length", "stiffness", "tolerance"), [(4.0, 0.5, 0.0), (0.07, 31.0, 1e-9)])
def test_units_do_not_matter(environment_id: str, length: float, stiffness: float, tolerance: float) -> None:
    """Powers of two leave every bit; other factors round differently, and a step magnifies that a little.

    More so in the singularity margin: it is a quotient of derivatives of the energy up to the third, and near a pole of
    a rod's stiffness these multiply rounding errors.
    """
    load = np.array([0.02, -0.05])
    env = make_bare(environment_id, load=load)
    other = make_bare(
        environment_id,
        mechanism=scaled(env.mechanism, length, stiffness),
        load=load * stiffness,
        success_distance=env.success_distance * length,
    )
    names = [element.name for element in env.elements]
    for first, second in zip(roll_single(env, 2, 60), roll_single(other, 2, 60), strict=True):
        for (path, value), (_, found) in zip(leaves(first[:-1]), leaves(second[:-1]), strict=True):
            bound = np.full(np.shape(value), tolerance)
            if path == "/0/observation":
                bound[names.index("singularity_margin")] *= 100.0
            assert (np.abs(np.asarray(found, float) - np.asarray(value, float)) <= bound).all(), path
        for key in ("is_success", "cost", "index", "event", "at_limit"):
            assert first[-1][key] == second[-1][key], key
        # the stiffness, tens of EI / L^2, changes up to hundreds of times faster than the state
        assert second[-1]["stability_margin"] == pytest.approx(
            first[-1]["stability_margin"], rel=max(tolerance, 1e-15), abs=100.0 * tolerance
        )


def test_a_mechanism_of_ones_own_takes_the_place_of_the_default(environment_id: str) -> None:
    default = pcm_gym.get_mechanism(mechanism_of(environment_id))
    env = make(environment_id, mechanism=scaled(default, 2.0, 3.0))
    assert env.unwrapped.mechanism.name == "scaled"
    assert [len(record) for record in pairwise(roll_single(env, 0, 5))]
