"""Wrong arguments of environments are refused with a message that names them."""

import re
from typing import Any

import gymnasium
import numpy as np
import pytest

import pcm_gym
from pcm_gym.environments.batch import MechanismVectorEnv
from pcm_gym.environments.single import MechanismEnv
from pcm_gym.solving import Equilibrium
from tests.reference.mechanisms import find_equilibria

BAD_ARGUMENTS = [
    ("mechanism", "4RFR"),
    ("mechanism", 3),
    ("mechanism", None),
    ("reward_type", "shaped"),
    ("reward_type", None),
    ("on_instability", "explode"),
    ("load", (0.0,)),
    ("load", (0.0, 0.0, 0.0)),
    ("load", (0.0, np.nan)),
    ("load", "heavy"),
    ("load", (0.0, -5.0)),  # buckles on the way
    ("max_action", 0.0),
    ("max_action", (0.1, -0.1)),
    ("max_action", np.nan),
    ("max_action", np.inf),
    ("max_action", (0.1, 0.1, 0.1)),
    ("max_action", [[0.1, 0.1], [0.1, 0.1]]),
    ("max_action", "fast"),
    ("success_distance", 0.0),
    ("success_distance", -0.1),
    ("success_distance", np.nan),
    ("success_distance", "near"),
    ("success_distance", (0.1, 0.2)),
    ("singular_margin", 0.0),
    ("singular_margin", -1.0),
    ("singular_margin", np.inf),
    ("singular_margin", "near"),
    ("render_mode", "ansi"),
]
BAD_BATCH_ARGUMENTS = [
    ("num_envs", 0),
    ("num_envs", -2),
    ("num_envs", 2.5),
    ("num_envs", "two"),
    ("autoreset_mode", "sometimes"),
    ("autoreset_mode", None),
    ("max_episode_steps", 0),
    ("max_episode_steps", -2),
    ("max_episode_steps", 2.5),
    ("max_episode_steps", "long"),
    ("render_mode", "ansi"),
]


@pytest.mark.parametrize(("name", "value"), BAD_ARGUMENTS)
@pytest.mark.parametrize("kind", [MechanismEnv, MechanismVectorEnv])
def test_bad_arguments_are_named(kind: Any, name: str, value: Any) -> None:
    with pytest.raises((ValueError, TypeError), match=f"{name} must be" if name == "mechanism" else name):
        kind(**{name: value})


@pytest.mark.parametrize(("name", "value"), BAD_BATCH_ARGUMENTS)
def test_bad_arguments_of_the_batch_are_named(name: str, value: Any) -> None:
    with pytest.raises((ValueError, TypeError), match=name):
        MechanismVectorEnv(**{name: value})


def test_unknown_arguments_are_refused() -> None:
    with pytest.raises(TypeError, match="sped"):
        gymnasium.make("PCM/2RFR-Reach-v0", sped=3)


@pytest.mark.parametrize("kind", [MechanismEnv, MechanismVectorEnv])
def test_unknown_arguments_are_answered_with_those_that_there_are(kind: Any) -> None:
    with pytest.raises(TypeError, match="'sped' is no argument of an environment") as caught:
        kind(sped=3)
    expected = {"mechanism", *pcm_gym.EnvironmentArguments.__annotations__} - {"path"}  # which is that of Track
    assert set(re.findall(r"'(\w+)'", str(caught.value))) == {"sped", "Reach"} | expected


def test_arguments_of_other_tasks_and_behaviours_that_a_task_refuses_are_named() -> None:
    with pytest.raises(ValueError, match="path must be None for task 'Reach', got 'circle'"):
        MechanismEnv(path="circle")
    with pytest.raises(ValueError, match=r"on_instability must be one of \['snap'\] for Switch\(difficulty='fall'\)"):
        MechanismEnv(task="Switch", difficulty="fall")


def test_step_sizes_may_be_one_or_one_per_leg() -> None:
    assert MechanismEnv(max_action=0.2).max_action.tolist() == [0.2, 0.2]
    assert MechanismEnv(max_action=[0.2, 0.1]).max_action.tolist() == [0.2, 0.1]


@pytest.fixture(scope="module")
def env() -> MechanismEnv:
    return MechanismEnv("2RFR")


@pytest.fixture(scope="module")
def other_home() -> Equilibrium:
    return pcm_gym.home_equilibrium(pcm_gym.get_mechanism("2PFR"))


def unstable_state(env: MechanismEnv) -> Equilibrium:
    """An equilibrium at home's inputs whose rods are in higher buckling modes."""
    home = pcm_gym.home_equilibrium(env.mechanism)
    found = find_equilibria(env.mechanism, home.inputs, home.load, np.random.default_rng(0), starts=3000)
    return next(equilibrium for equilibrium in found if not equilibrium.is_stable)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("inputs", (0.0,)),
        ("inputs", (0.0, 0.0, 0.0)),
        ("inputs", (0.0, np.nan)),
        ("inputs", "home"),
        ("inputs", None),
        ("inputs", (9.0, 1.0)),  # outside of the limits
        ("inputs", (4.7, 4.7)),  # beyond a fold
        ("equilibrium", "home"),
        ("equilibrium", None),
        ("goal", (0.1,)),
        ("goal", (0.1, 0.2, 0.3)),
        ("goal", (0.1, np.inf)),
        ("goal", "there"),
        ("goal", (0.0, 30.0)),  # out of reach, and of the observation's space
        ("load", (1.0,)),
        ("load", (1.0, 2.0, 3.0)),
        ("load", (np.nan, 0.0)),
        ("load", "heavy"),
        ("load", (0.0, -5.0)),
        ("gaol", (0.0, 0.5)),
    ],
)
def test_bad_options_are_named_and_change_nothing(env: MechanismEnv, name: str, value: Any) -> None:
    env.reset(seed=0)
    before = env.equilibrium.state.copy()
    with pytest.raises((ValueError, TypeError), match=name):
        env.reset(seed=0, options={name: value})
    np.testing.assert_array_equal(env.equilibrium.state, before)


def test_equilibria_that_cannot_be_starts_are_named(env: MechanismEnv, other_home: Equilibrium) -> None:
    outside = Equilibrium(env.mechanism, env.equilibrium.state, np.array([9.0, 0.0]), np.zeros(2))
    home = pcm_gym.home_equilibrium(env.mechanism)
    unsolved = Equilibrium(env.mechanism, home.state, home.inputs + 1e-3, np.zeros(2))
    for wrong in (other_home, unstable_state(env), outside, unsolved):
        with pytest.raises(ValueError, match="equilibrium"):
            env.reset(options={"equilibrium": wrong})


def test_options_that_only_a_batch_knows_are_refused(env: MechanismEnv) -> None:
    with pytest.raises(ValueError, match="reset_mask"):
        env.reset(options={"reset_mask": np.array([True])})


def test_goals_are_checked_for_platforms() -> None:
    env = MechanismEnv("3PFR")
    with pytest.raises(ValueError, match="goal"):
        env.reset(options={"goal": (0.0, 0.0)})
    env.reset(options={"goal": (0.0, 0.0, 6.5)})
    assert env.goal[2] == pytest.approx(6.5 - 2.0 * np.pi)
