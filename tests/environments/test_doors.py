"""What is let in at the doors of environments and wrappers, and that what is refused there changes nothing."""

import copy
import json
from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.error import ResetNeeded
from gymnasium.wrappers.vector import DictInfoToList

import pcm_gym
from pcm_gym.environments.single import MechanismEnv
from pcm_gym.kernels.statics.states import States
from tests.environments.rollouts import assert_same, make_bare, make_native, roll_single, sweeping_actions

ID = "PCM/2RFR-Reach-v0"
STAY = np.zeros((3, 2), np.float32)


# Beginning and going on


@pytest.mark.parametrize("mode", ["Disabled", "NextStep", "SameStep"])
def test_rows_that_never_began_do_not_step(mode: str) -> None:
    env = make_native(ID, 3, autoreset_mode=mode)
    for name, actions in (("step", STAY), ("preview", np.zeros((3, 1, 2)))):
        with pytest.raises(ResetNeeded, match=rf"{name}\(\) was called before the first reset"):
            getattr(env, name)(actions)
    env.reset(seed=0, options={"reset_mask": np.array([False, True, False])})
    for name, actions in (("step", STAY), ("preview", np.zeros((3, 1, 2)))):
        with pytest.raises(ResetNeeded, match=r"first reset\(\) of environments \[0, 2\]"):
            getattr(env, name)(actions)
    env.reset(seed=0, options={"reset_mask": np.array([True, False, True])})
    env.step(STAY)


@pytest.mark.parametrize("mode", ["Disabled", "NextStep", "SameStep"])
def test_a_reset_of_some_rows_leaves_the_noise_of_the_others(mode: str) -> None:
    env = make_native(ID, 3, autoreset_mode=mode, observation_noise=0.1, max_episode_steps=4)
    mask = np.array([False, True, False])
    before, _ = env.reset(seed=0)
    for step in range(6):
        after, _ = env.reset(options={"reset_mask": mask})
        for key, array in before.items():
            assert array[~mask].tobytes() == after[key][~mask].tobytes(), (step, key)
            assert (array[mask] != after[key][mask]).any() or key == "desired_goal"
        before, _, terminated, truncated, _ = env.step(STAY)
        before = copy.deepcopy(before)
        if mode == "Disabled" and (terminated | truncated).any():
            before, _ = env.reset(options={"reset_mask": terminated | truncated})


def test_seeds_may_be_integers_of_any_kind_and_nothing_else() -> None:
    env = make_native(ID, 2)
    for seeds in ([3, 4], np.array([3, 4]), [np.int64(3), np.uint8(4)], (3, 4), np.int32(3)):
        assert_same(env.reset(seed=seeds), env.reset(seed=3))
    for wrong in ([3], [3, 4.0], [3, True], -1, "34", [3, -4], 3.0):
        with pytest.raises((TypeError, ValueError), match="seed must"):
            env.reset(seed=wrong)
    with pytest.raises(ValueError, match="seed must be at least 0, got -1"):
        make_bare(ID).reset(seed=-1)


# Saved states


def wrong_states(state: dict[str, Any]) -> list[Any]:
    rows = state["rows"]
    wrong: list[Any] = [None, {}, [], {**state, "rows": None}]
    wrong += [{key: own for key, own in state.items() if key != left_out} for left_out in state]
    for name, array in rows.items():
        for own in (array[:, :1] if array.ndim > 1 else array[:0], np.full(array.shape, np.nan), "x", None):
            changed = {**state, "rows": {**rows, name: own}}
            is_shape = isinstance(own, np.ndarray) and own.shape == array.shape
            if not is_shape or (name != "witness" and np.isnan(np.asarray(own, dtype=float)).any()):
                wrong.append(changed)
    wrong.append({**state, "rows": {**rows, "scene": rows["scene"] + 7}})
    generators = "generator" if "generator" in state else "generators"
    return [*wrong, {**state, generators: {"bit_generator": "none"}}, {**state, generators: [{}]}]


@pytest.mark.parametrize("make", [make_bare, lambda own: make_native(own, 2)])
def test_a_state_that_is_none_is_refused_and_changes_nothing(make: Any) -> None:
    env = make(ID)
    env.reset(seed=0)
    saved = env.save_state()
    env.step(np.ones(env.action_space.shape, np.float32))
    here = env.save_state()
    for wrong in wrong_states(saved):
        with pytest.raises((TypeError, ValueError), match="state"):
            env.restore_state(wrong)
        assert_same(env.save_state(), here)
    env.restore_state(saved)
    assert_same(env.save_state(), saved)


# Rewards


@pytest.mark.parametrize("name", ["2RFR", "3PFR"])
@pytest.mark.parametrize("reward_type", ["dense", "sparse"])
def test_rewards_are_broadcast_as_arrays_are(name: str, reward_type: str) -> None:
    env = make_bare(f"PCM/{name}-Reach-v0", reward_type=reward_type)
    many = np.stack([env.reset(seed=seed)[0]["achieved_goal"] for seed in range(6)])
    one = env.reset(seed=3)[0]["achieved_goal"]
    expected = [env.compute_reward(goal, one, {}) for goal in many]
    assert expected[3] == max(expected) > min(expected)
    for achieved, desired in ((many, one), (one, many), (many, np.tile(one, (6, 1))), (many[:, None], one[None])):
        found = env.compute_reward(achieved, desired, {})
        assert found.shape == np.broadcast_shapes(achieved.shape, desired.shape)[:-1]
        np.testing.assert_array_equal(found.ravel(), expected)
    table = env.compute_reward(many[:, None], many[None], None)
    np.testing.assert_array_equal(table, table.T)
    assert isinstance(env.compute_reward(one.tolist(), one, {}), float)
    assert env.compute_reward(many[:0], one, {}).shape == (0,)


@pytest.mark.parametrize(
    ("achieved", "desired", "message"),
    [
        (np.zeros((3, 2)), np.zeros((2, 2)), "desired_goal must have a shape that fits that of achieved_goal"),
        (np.zeros(50), np.zeros(2), r"achieved_goal must have shape \(..., 2\), got \(50,\)"),
        (np.zeros((2, 3)), np.zeros(2), "achieved_goal must have shape"),
        (np.zeros(2), np.zeros((2, 1)), "desired_goal must have shape"),
        ((0.0, np.nan), np.zeros(2), "achieved_goal must be finite"),
        (np.zeros(2), (0.0, np.inf), "desired_goal must be finite"),
        ("here", np.zeros(2), "achieved_goal must be an array of numbers"),
        (0.0, np.zeros(2), "achieved_goal must have shape"),
    ],
)
def test_goals_that_do_not_fit_have_no_reward(achieved: Any, desired: Any, message: str) -> None:
    with pytest.raises((TypeError, ValueError), match=message):
        make_bare(ID).compute_reward(achieved, desired, {})


# Goals, starts and tasks


def test_goals_beyond_the_rods_or_of_other_mechanisms_are_refused() -> None:
    env = make_bare(ID)  # rods of 1 m on motors at -0.2 and 0.2 m
    far = np.array([0.9, 0.5])
    assert env.task.goals.of_pose(far) in env.observation_space["desired_goal"]
    assert np.hypot(*(far - [-0.2, 0.0])) > 1.0
    with pytest.raises(ValueError, match="within the reach of the rods"):
        env.reset(options={"goal": far})
    other = pcm_gym.home_equilibrium(pcm_gym.get_mechanism("2PFR"))
    with pytest.raises(ValueError, match="goal must be an Equilibrium of '2RFR'"):
        env.reset(options={"goal": other})
    here = pcm_gym.home_equilibrium(env.mechanism)
    none = pcm_gym.Equilibrium(env.mechanism, here.state + 0.01, here.inputs, here.load)
    with pytest.raises(ValueError, match="goal must be an equilibrium, got residual"):
        env.reset(options={"goal": none})
    env.reset(options={"goal": here})


def test_sliders_reach_as_far_as_their_limits_let_them() -> None:
    env = make_bare("PCM/2PFR-Reach-v0", mechanism="2PFR-paper")  # vertical rails at x = -0.2 and 0.2 m
    upper = env.mechanism.upper_limits.max()
    env.reset(options={"goal": (0.0, upper + 0.9)})
    with pytest.raises(ValueError, match="within the reach of the rods"):
        env.reset(options={"goal": (0.0, upper + 0.99)})


@dataclass(frozen=True)
class Odd(pcm_gym.Task):
    """What it draws is laid out as one likes."""

    kind: str = "strided"

    def sample(self, scene: pcm_gym.Scene, generators: Any, threads: int = 1) -> pcm_gym.Episodes:
        count = len(generators)
        start = scene.at_equilibrium(scene.home, count)
        goals = np.tile(self.goals.of_states(start.x, start.inputs)[:, None], (1, 1, 1))
        spread = np.zeros((2 * count, 1, 4))
        spread[::2, :, ::2] = goals
        if self.kind == "strided":
            states = States(*(np.asfortranarray(array).astype(">f8") for array in start))
            return pcm_gym.Episodes(states, spread[::2, :, ::2])
        wrong = {
            "short": goals[:, :, :1],
            "flat": goals[:, 0],
            "nan": goals + np.nan,
            "long": np.repeat(goals, 2, axis=1),
        }
        if self.kind == "states":
            return pcm_gym.Episodes(start._replace(x=start.x[:, :-1]), goals)
        return pcm_gym.Episodes(start, wrong[self.kind])


@dataclass(frozen=True)
class OddScore(Odd):
    """What it returns of goals is no reward."""

    def score(self, achieved: Any, desired: Any) -> Any:
        return {"nan": np.full(len(achieved), np.nan), "short": np.zeros(1)}[self.kind], np.zeros(len(achieved), bool)


def odd(kind: str) -> Odd:
    return Odd(pcm_gym.Goals(pcm_gym.get_mechanism("2RFR")), kind)


def test_what_a_task_draws_may_be_laid_out_in_any_way_but_must_fit() -> None:
    batch = pcm_gym.MechanismVectorEnv(3, task=odd("strided"))
    plain, _ = make_native(ID, 3).reset(seed=0)
    observation, _ = batch.reset(seed=0)
    np.testing.assert_array_equal(observation["achieved_goal"], observation["desired_goal"])
    assert observation["observation"].shape == plain["observation"].shape
    batch.step(STAY)
    for kind in ("short", "flat", "nan", "long", "states"):
        with pytest.raises((TypeError, ValueError), match=r"goals|states\.x"):
            pcm_gym.MechanismVectorEnv(3, task=odd(kind)).reset(seed=0)


def test_what_a_task_says_of_goals_must_be_rewards() -> None:
    goals = np.zeros((3, 2))
    for kind in ("nan", "short"):
        task = OddScore(pcm_gym.Goals(pcm_gym.get_mechanism("2RFR")), kind=kind)
        with pytest.raises(ValueError, match=r"rewards of score\(\) must"):
            task.compute_reward(goals, goals)


# Arguments


def test_errors_blame_what_was_called() -> None:
    with pytest.raises(TypeError, match="'cls' is no argument of an environment"):
        MechanismEnv(cls=3)  # type: ignore[call-arg]
    with pytest.raises(
        ValueError, match=r"must keep the singularity margin .* max_action: one of these must be smaller"
    ):
        MechanismEnv(max_action=3.0).reset(seed=0)


def test_actions_may_be_whatever_is_an_array_of_numbers() -> None:
    env, action = make_bare(ID), np.array([0.5, -0.25])
    expected = [env.reset(seed=0), env.step(action)]
    for own in (action.tolist(), tuple(action), action.astype(np.float32), np.stack([action, action], axis=1)[:, 0]):
        assert_same([env.reset(seed=0), env.step(own)], expected)
    for wrong in (
        "up",
        [0.5],
        [0.5, np.nan],
        [0.5, None],
        [0.5, 1j],
        [True, False],
        np.ma.array([0.5, 0.5], mask=[True, False]),
    ):
        with pytest.raises((TypeError, ValueError), match="action must"):
            env.step(wrong)


# Registration


def test_a_registration_that_fails_leaves_nothing_behind() -> None:
    mine = pcm_gym.Mechanism("one of its own", pcm_gym.get_mechanism("2RFR").legs)
    ids, names = set(gymnasium.registry), pcm_gym.mechanism_names()
    with pytest.raises(ValueError, match="environment_id must be"):
        pcm_gym.register_environment("no id at all!", mechanism=mine, task=Odd)
    with pytest.raises(ValueError, match="environment_id must be a new one"):
        pcm_gym.register_environment(ID, mechanism=mine, task=Odd)
    with pytest.raises(TypeError, match="'speed' is no argument"):
        pcm_gym.register_environment("Test/Doors-v0", mechanism=mine, task=Odd, speed=3)
    assert (set(gymnasium.registry), pcm_gym.mechanism_names()) == (ids, names)
    with pytest.raises(ValueError, match="task must be one of"):
        pcm_gym.MechanismEnv(task="Odd")


# Wrappers


@pytest.mark.parametrize("wrapper", [pcm_gym.CostStep, pcm_gym.SolverShield])
def test_wrapped_environments_can_be_made_again_from_their_specification(wrapper: Any) -> None:
    keywords = {} if wrapper is pcm_gym.CostStep else {"least_margin": 0.25}
    env = wrapper(gymnasium.make(ID, max_action=0.2), **keywords)
    spec = EnvSpec.from_json(env.spec.to_json())
    assert json.loads(spec.to_json()) == json.loads(env.spec.to_json())
    again = gymnasium.make(spec)
    assert isinstance(again, wrapper)
    assert getattr(again, "least_margin", 0.25) == 0.25
    if wrapper is pcm_gym.SolverShield:
        assert_same(roll_single(again, 1, 60), roll_single(env, 1, 60))


def test_infos_in_lists_go_around_the_shield() -> None:
    with pytest.raises(ValueError, match="env must not make lists of infos, put DictInfoToList around the shield"):
        pcm_gym.VectorSolverShield(DictInfoToList(make_native(ID, 2)))
    env = DictInfoToList(pcm_gym.VectorSolverShield(make_native(ID, 2)))
    env.reset(seed=0)
    *_, infos = env.step(env.action_space.sample())
    assert [info["shielded"] in (False, True) for info in infos] == [True, True]


@pytest.mark.parametrize("wrapper", [pcm_gym.CostStep, pcm_gym.SolverShield, pcm_gym.VectorSolverShield])
def test_what_is_no_environment_is_not_wrapped(wrapper: Any) -> None:
    for wrong in (None, 3, ID, MechanismEnv):
        with pytest.raises(TypeError, match="env must be"):
            wrapper(wrong)


def test_everything_becomes_tensors() -> None:
    """Gymnasium's own conversion, of one environment and of a batch, to what learners in torch take."""
    torch = pytest.importorskip("torch")
    pytest.importorskip("array_api_compat")
    from gymnasium.wrappers import NumpyToTorch
    from gymnasium.wrappers.vector import NumpyToTorch as VectorNumpyToTorch

    env, plain = NumpyToTorch(make_bare(ID)), make_bare(ID)
    batch, plain_batch = VectorNumpyToTorch(make_native(ID, 3)), make_native(ID, 3)
    for wrapped, own in ((env, plain), (batch, plain_batch)):
        results, expected = [wrapped.reset(seed=0)], [own.reset(seed=0)]
        for action in sweeping_actions(40, own.action_space.shape, seed=0):
            results.append(wrapped.step(torch.from_numpy(action)))
            expected.append(own.step(action))
        for result, wanted in zip(results, expected, strict=True):
            assert result[-1].keys() == wanted[-1].keys()
            for key, value in {**result[0], **result[-1]}.items():
                assert isinstance(value, torch.Tensor), key
                number = {**wanted[0], **wanted[-1]}[key]
                np.testing.assert_allclose(value.numpy(), number, rtol=1e-6, err_msg=key)
        assert len({int(code) for result in results for code in np.ravel(result[-1]["event"])}) > 1
