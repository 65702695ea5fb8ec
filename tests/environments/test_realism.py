"""What real mechanisms add: parts and loads that differ, actuators that lag and have play, sensors with noise."""

import json
import math
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.vector import AutoresetMode

import pcm_gym
from tests.environments.rollouts import MECHANISMS, assert_same, make_bare, make_native, roll_single, sweeping_actions

NAMES = MECHANISMS
DEVIATIONS = {"stiffness": 0.2, "length": 0.05, "base": 0.02}
LOADS = ((-0.02, -0.05), (0.02, 0.01))
ALL: dict[str, Any] = {
    "randomisation": DEVIATIONS,
    "load": LOADS,
    "variants": 3,
    "actuator_lag": 1.5,
    "backlash": 0.01,
    "rate_limit": 0.05,
    "observation_noise": 0.02,
}


def reach(name: str, **keywords: Any) -> Any:
    return make_bare(f"PCM/{name}-Reach-v0", **keywords)


def element(env: Any, name: str) -> int:
    return [own.name for own in env.elements].index(name)


# Mechanisms and loads


@pytest.mark.parametrize("name", NAMES)
def test_mechanisms_differ_from_episode_to_episode_by_what_is_allowed(name: str) -> None:
    env = reach(name, randomisation=DEVIATIONS, variants=3)
    nominal, seen = env.mechanism, set()
    for seed in range(12):
        env.reset(seed=seed)
        own = env.equilibrium
        assert (own.is_stable, own.residual < 1e-10) == (True, True)
        for leg, default in zip(own.mechanism.legs, nominal.legs, strict=True):
            assert abs(leg.rod.bending_stiffness / default.rod.bending_stiffness - 1.0) <= 0.2
            assert abs(leg.rod.length / default.rod.length - 1.0) <= 0.05
            assert np.abs(np.subtract(leg.actuator.base, default.actuator.base)).max() <= 0.02
            assert leg.attachment == default.attachment
        seen.add(own.mechanism)
    assert len(seen) == 3
    assert nominal not in seen


def test_attachments_of_a_platform_can_differ() -> None:
    env = reach("3PFR", randomisation={"attachment": 0.01}, variants=2)
    env.reset(seed=0)
    for leg, default in zip(env.equilibrium.mechanism.legs, env.mechanism.legs, strict=True):
        assert 0.0 < np.abs(np.subtract(leg.attachment, default.attachment)).max() <= 0.01
        assert leg.rod.length == pytest.approx(default.rod.length, rel=1e-15)


def test_numbers_of_variants_mean_the_same_as_those_of_the_mechanism() -> None:
    """Positions are told in the lengths of the mechanism's own rods, not in those of its variants."""
    env = reach("2RFR", randomisation={"length": 0.1}, variants=2)
    for seed in range(4):
        observation, _ = env.reset(seed=seed)
        np.testing.assert_allclose(observation["achieved_goal"], env.equilibrium.pose / env.mechanism.units.length)
        assert env.equilibrium.mechanism.legs[0].rod.length != env.mechanism.legs[0].rod.length


@pytest.mark.parametrize("name", NAMES)
def test_goals_can_be_reached_whatever_is_drawn(name: str) -> None:
    env = reach(name, difficulty="near", randomisation=DEVIATIONS, load=LOADS, variants=3, hold_steps=1)
    for seed in range(8):
        env.reset(seed=seed)
        while np.abs(env.witness.inputs - env.equilibrium.inputs).max() > 1e-9:
            way = (env.witness.inputs - env.equilibrium.inputs) / env.max_action
            *_, info = env.step(way / max(np.abs(way).max(), 1.0))
            assert info["cost"] == 0.0
        assert info["is_success"]


@pytest.mark.parametrize("name", ["2RFR", "3PFR"])
def test_loads_are_drawn_from_their_range_and_told(name: str) -> None:
    env = reach(name, load=LOADS, variants=4)
    names = [own.name for own in env.elements]
    loads = set()
    for seed in range(12):
        observation, _ = env.reset(seed=seed)
        load = env.equilibrium.load
        loads.add(tuple(load))
        for axis in range(2):
            low, high = LOADS[0][axis], LOADS[1][axis]
            assert low <= load[axis] <= high
            told = observation["observation"][names.index(f"load_{axis + 1}")]
            assert told == pytest.approx((2.0 * load[axis] - low - high) / (high - low))
    assert len(loads) == 4
    unknown = reach(name, load=LOADS, variants=4, observe_load=False)
    assert "load_1" not in [own.name for own in unknown.elements]
    assert_same(unknown.reset(seed=0)[0]["achieved_goal"], env.reset(seed=0)[0]["achieved_goal"])


def test_loads_that_home_cannot_carry_are_refused() -> None:
    with pytest.raises(ValueError, match="load and randomisation must leave a stable home"):
        reach("2RFR", load=((0.0, -60.0), (0.0, -50.0)), variants=2)


# Actuators


@pytest.mark.parametrize("name", NAMES)
def test_lag_is_of_first_order(name: str) -> None:
    """After one command the inputs approach it by a factor of exp(-1 / lag) per step."""
    env = reach(name, actuator_lag=2.5)
    env.reset(seed=0, options={"equilibrium": pcm_gym.home_equilibrium(env.mechanism)})
    start = env.equilibrium.inputs
    action = np.full(env.action_space.shape, 0.6, np.float32)
    for step in range(1, 6):
        env.step(action if step == 1 else 0.0 * action)
        expected = start + float(action[0]) * env.max_action * (1.0 - math.exp(-step / 2.5))
        np.testing.assert_allclose(env.equilibrium.inputs, expected, rtol=0.0, atol=1e-12)


def test_rates_are_limited() -> None:
    env = reach("2RFR", rate_limit=(0.03, 0.2))
    env.reset(seed=0, options={"equilibrium": pcm_gym.home_equilibrium(env.mechanism)})
    start = env.equilibrium.inputs
    env.step(np.array([1.0, 1.0], np.float32))
    np.testing.assert_allclose(env.equilibrium.inputs - start, [0.03, 0.1], atol=1e-12)
    env.step(np.array([0.0, 0.0], np.float32))
    np.testing.assert_allclose(env.equilibrium.inputs - start, [0.06, 0.1], atol=1e-12)


def test_play_is_crossed_before_the_clamp_turns_back() -> None:
    env = reach("2RFR", backlash=0.04)
    env.reset(seed=0, options={"equilibrium": pcm_gym.home_equilibrium(env.mechanism)})
    start = env.equilibrium.inputs[0]
    moves = []
    for action in (1.0, -0.3, -0.3, -0.3):
        env.step(np.array([action, 0.0], np.float32))
        moves.append(env.equilibrium.inputs[0] - start)
    np.testing.assert_allclose(moves, [0.08, 0.08, 0.06, 0.03], atol=1e-7)


def test_commands_are_told_where_the_clamps_do_not_follow_at_once() -> None:
    env = reach("2RFR", actuator_lag=3.0)
    env.reset(seed=0, options={"equilibrium": pcm_gym.home_equilibrium(env.mechanism)})
    lower, upper = env.mechanism.lower_limits, env.mechanism.upper_limits
    start = env.equilibrium.inputs
    observation, *_ = env.step(np.array([0.5, -0.5], np.float32))
    command = start + np.array([0.05, -0.05])
    first = element(env, "command_1")
    expected = (2.0 * command - lower - upper) / (upper - lower)
    np.testing.assert_allclose(observation["observation"][first : first + 2], expected, atol=1e-12)
    assert "command_1" not in [own.name for own in reach("2RFR").elements]


def test_limits_hold_for_the_commands() -> None:
    env = reach("2PFR", mechanism="2PFR-paper", actuator_lag=2.0)
    env.reset(seed=0)
    cut = []
    for _ in range(60):
        *_, info = env.step(np.ones(2, np.float32))
        cut.append(info["at_limit"])
        assert (info["event"] == pcm_gym.Event.ACTUATOR_LIMIT) == info["at_limit"]
        assert env.equilibrium.within_limits
    assert (cut[0], cut[-1]) == (False, True)
    np.testing.assert_allclose(env.equilibrium.inputs, env.mechanism.upper_limits, rtol=0.0, atol=1e-6)


def test_a_refused_increment_is_forgotten() -> None:
    env = reach("2RFR", actuator_lag=2.0, on_instability="hold")
    generator, refusals = np.random.default_rng(0), 0
    for seed in range(30):
        env.reset(seed=seed)
        action = np.sign(generator.normal(size=2))
        for _ in range(60):
            before = env.equilibrium.inputs
            *_, info = env.step(action)
            if info["cost_unstable"]:
                refusals += 1
                np.testing.assert_array_equal(env.equilibrium.inputs, before)
                env.step(np.zeros(2))
                np.testing.assert_allclose(env.equilibrium.inputs, before, rtol=0.0, atol=1e-12)
                break
    assert refusals > 3


# Sensors


def test_noise_is_on_all_that_is_measured_and_on_nothing_else() -> None:
    noisy, exact = (make_native("PCM/3PFR-Reach-v0", 500, observation_noise=noise) for noise in (0.01, 0.0))
    home = pcm_gym.home_equilibrium(noisy._simulation.settings.mechanism)
    seen, truth = (env.reset(seed=0, options={"equilibrium": home})[0] for env in (noisy, exact))
    assert_same(seen["achieved_goal"], truth["achieved_goal"])
    error = seen["observation"] - truth["observation"]
    deviation = error.std(axis=0)
    assert noisy.observation_space.contains(seen)
    assert (deviation[-3:] == 0.0).all()
    inside = (np.abs(truth["observation"][0]) < 0.9)[:-3]
    np.testing.assert_allclose(deviation[:-3][inside], 0.01, rtol=0.2)
    np.testing.assert_allclose(error.mean(axis=0)[:-3][inside], 0.0, atol=0.003)


# All together


@pytest.mark.parametrize("mode", list(AutoresetMode))
@pytest.mark.parametrize("environment_id", ["PCM/2RFR-Reach-v0", "PCM/2PFR-Track-v0"])
def test_batch_equals_single_environments_with_everything_on(environment_id: str, mode: AutoresetMode) -> None:
    keywords = {**ALL, "max_episode_steps": 15}
    native = make_native(environment_id, 4, autoreset_mode=mode, **keywords)
    sync = gymnasium.make_vec(
        environment_id, num_envs=4, vectorization_mode="sync", vector_kwargs={"autoreset_mode": mode}, **keywords
    )
    assert native.observation_space == sync.observation_space
    assert_same(native.reset(seed=3), sync.reset(seed=3))
    for action in sweeping_actions(40, native.action_space.shape, seed=4):
        found, expected = native.step(action), sync.step(action)
        assert_same(found, expected)
        assert native.observation_space.contains(found[0])
        if mode is AutoresetMode.DISABLED:
            for row in np.flatnonzero(found[2] | found[3]):
                options = {"reset_mask": np.arange(4) == row}
                assert_same(native.reset(options=options), sync.reset(options=dict(options)))


def test_specification_with_everything_on_survives_json() -> None:
    spec = gymnasium.make("PCM/2RFR-Reach-v0", **ALL).spec
    assert spec is not None
    again = EnvSpec.from_json(spec.to_json())
    assert json.loads(again.to_json()) == json.loads(spec.to_json())
    assert_same(roll_single(gymnasium.make(again), 1, 10), roll_single(gymnasium.make(spec), 1, 10))


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("randomisation", {"colour": 0.1}),
        ("randomisation", {"length": -0.1}),
        ("randomisation", {"stiffness": 1.0}),
        ("randomisation", {"base": math.nan}),
        ("randomisation", {"attachment": 0.1}),
        ("randomisation", 0.1),
        ("load", ((0.0, 1.0), (0.0, 0.5))),
        ("load", ((0.0, 1.0), (0.0, 0.5), (0.0, 0.0))),
        ("variants", 0),
        ("variants", 129),
        ("variants", 1.5),
        ("actuator_lag", -1.0),
        ("actuator_lag", math.inf),
        ("rate_limit", 0.0),
        ("rate_limit", (0.1, 0.1, 0.1)),
        ("backlash", -0.1),
        ("observation_noise", -0.1),
        ("observe_load", "yes"),
        ("hold_steps", 0),
    ],
)
def test_bad_arguments_are_named(name: str, value: Any) -> None:
    with pytest.raises((ValueError, TypeError), match=name):
        reach("2RFR", **{name: value})
