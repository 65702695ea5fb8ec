"""Tasks and mechanisms that a user's file defines are environments like those of the package."""

import inspect
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import gymnasium
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils.env_checker import check_env

import pcm_gym
from pcm_gym.environments.arguments import CONSTRUCTION
from pcm_gym.mechanism import catalogue
from pcm_gym.tasks import TASKS, Generators, starts_of
from tests.environments.rollouts import (
    INFO_TYPES,
    assert_same,
    make,
    make_bare,
    make_native,
    roll_single,
    sweeping_actions,
)


@dataclass(frozen=True)
class Lift(pcm_gym.Task):
    """Bring the end-effector `rise` mean rod lengths higher, wherever that is."""

    rise: float = 0.05

    def __post_init__(self) -> None:
        if not 0.0 < self.rise < 0.5:
            raise ValueError(f"rise must be between 0 and 0.5, got {self.rise}")

    def sample(self, scene: pcm_gym.Scene, generators: Generators, threads: int = 1) -> pcm_gym.Episodes:
        start = starts_of(scene, generators, threads)
        goals = self.goals.of_states(start.x, start.inputs)
        goals[:, 1] += self.rise
        return pcm_gym.Episodes(start, goals[:, None])

    @property
    def behaviours(self) -> tuple[Any, ...]:
        return ("terminate", "hold")

    def score(self, achieved: np.ndarray, desired: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        below = desired[:, 1] - achieved[:, 1]
        return np.exp(-np.maximum(below, 0.0) / self.rise), below <= 0.0

    def metrics(self, achieved: np.ndarray, desired: np.ndarray) -> dict[str, np.ndarray]:
        return {"below": desired[:, 1] - achieved[:, 1]}


@dataclass(frozen=True)
class Grasping(Lift):
    """A task whose argument has the name of one of the environment."""

    load: float = 1.0


@dataclass(frozen=True)
class Parallel(Lift):
    """A task whose argument has the name of one of the batch."""

    threads: int = 1


class Elsewhere:
    @dataclass(frozen=True)
    class Lift(Lift):
        """Another task of the same name."""


def three_rfr(turn: float = 0.9) -> pcm_gym.Mechanism:
    """Three rods that motors on a circle turn, and a triangular platform; home is stable, and turned against them."""
    legs = []
    for direction in np.pi / 2.0 + 2.0 * np.pi / 3.0 * np.arange(3):
        outwards = np.array([math.cos(direction), math.sin(direction)])
        motor = pcm_gym.Revolute(tuple(0.8 * outwards), direction + math.pi + turn, limits=(-1.0, 1.0))
        legs.append(pcm_gym.Leg(motor, pcm_gym.Rod(), tuple(0.2 * outwards)))
    return pcm_gym.Mechanism("3RFR", tuple(legs), description="three rods, rotating actuators, platform")


@pytest.fixture(autouse=True)
def _tables_as_they_were(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    tables: list[dict[str, Any]] = [gymnasium.registry, TASKS, catalogue._MAKERS]
    before = [dict(table) for table in tables]
    yield
    for table, content in zip(tables, before, strict=True):
        table.clear()
        table.update(content)


# Tasks


@pytest.fixture
def lift_id() -> str:
    pcm_gym.register_environment("My/2RFR-Lift-v0", mechanism="2RFR", task=Lift, time_limit=40, rise=0.1)
    return "My/2RFR-Lift-v0"


def test_task_is_an_environment_like_others(lift_id: str) -> None:
    env = make_bare(lift_id)
    check_env(env, skip_render_check=True)
    assert make(lift_id).spec.max_episode_steps == 40
    assert (env.task.rise, make_bare(lift_id, rise=0.2).task.rise) == (0.1, 0.2)
    assert env.witness is None
    pytest.importorskip("stable_baselines3.common.env_checker").check_env(env, warn=True, skip_render_check=True)


def test_batch_of_a_task_equals_the_single_environment(lift_id: str) -> None:
    batch, single = make_native(lift_id, 3), make_bare(lift_id)
    begun, infos = batch.reset(seed=0)
    observation, info = single.reset(seed=1)
    for action in sweeping_actions(30, batch.action_space.shape, seed=2):
        assert_same({key: array[1] for key, array in begun.items()}, observation)
        assert {key: infos[key][1] for key in info} == info
        begun, reward, terminated, _, infos = batch.step(action)
        observation, *expected, info = single.step(action[1])
        assert [reward[1], terminated[1]] == expected[:2]
        if terminated[1]:
            break


def test_score_of_a_task_is_reward_and_success(lift_id: str) -> None:
    """Whoever gets up and stays there succeeds, in the step in which the height is held for the third time."""
    env = make_bare(lift_id, difficulty=None)
    rows: list[tuple[bool, bool]] = []
    env.reset(seed=1)
    while len(rows) < 60:
        slope = env.equilibrium.forward_jacobian[1]
        observation, reward, _, _, info = env.step(0.5 * slope / np.abs(slope).max())
        assert reward == pytest.approx(math.exp(-max(info["below"], 0.0) / 0.1), rel=1e-14)
        assert env.compute_reward(observation["achieved_goal"], observation["desired_goal"], {}) == reward
        rows.append((info["below"] <= 0.0 and info["index"] == 0, info["is_success"]))
    is_there = [there for there, _ in rows]
    assert [success for _, success in rows] == [all(is_there[max(n - 2, 0) : n + 1]) and n >= 2 for n in range(60)]
    assert any(is_there)


def test_infos_tell_the_metrics_of_a_task_beside_the_usual(lift_id: str) -> None:
    _, info = make_bare(lift_id).reset(seed=0)
    assert {key: type(value) for key, value in info.items()} == {**INFO_TYPES, "below": float}
    assert info["below"] == pytest.approx(0.1)


def test_specification_is_json_from_which_the_environment_is_made(lift_id: str) -> None:
    spec = EnvSpec.from_json(gymnasium.spec(lift_id).to_json())
    assert_same(roll_single(gymnasium.make(spec).unwrapped, 0, 20), roll_single(make_bare(lift_id), 0, 20))


def test_task_may_be_given_by_class_or_as_it_is_or_by_name() -> None:
    mechanism = pcm_gym.get_mechanism("2PFR")
    assert pcm_gym.register_task(Lift) == "Lift"
    given = Lift(pcm_gym.Goals(mechanism, success_distance=0.03), rise=0.2)
    arguments: dict[str, Any] = {"rise": 0.2, "success_distance": 0.03}
    made: list[Any] = [
        pcm_gym.MechanismEnv("2PFR", task=given),
        pcm_gym.MechanismEnv("2PFR", task=Lift, **arguments),
        pcm_gym.MechanismEnv("2PFR", task="Lift", **arguments),
        pcm_gym.MechanismVectorEnv(1, mechanism="2PFR", task=given)._simulation.settings,
    ]
    assert [env.task for env in made] == [given] * 4
    assert repr(given) == "Lift(rise=0.2)"


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"task": Lift, "rise": 0.0}, ValueError, "rise must be between"),
        ({"task": Lift, "raise": 0.1}, TypeError, "'raise' is no argument of an environment with task 'Lift'.*'rise'"),
        ({"task": Lift, "path": "circle"}, ValueError, "path must be None for task 'Lift'"),
        (
            {"task": Lift, "on_instability": "snap"},
            ValueError,
            r"must be one of \['terminate', 'hold'\] for Lift",
        ),
        ({"task": Grasping}, TypeError, "'load' must not be an argument of task 'Grasping'"),
        ({"task": Parallel}, TypeError, "'threads' must not be an argument of task 'Parallel'"),
        ({"task": "Lift"}, ValueError, r"task must be one of \['Reach', 'Track', 'Switch'\]"),
        ({"task": Elsewhere}, TypeError, "task must be"),
        ({"task": Lift(pcm_gym.Goals(pcm_gym.get_mechanism("3PFR")))}, ValueError, "task must have goals of mechanism"),
        ({"task": Lift(pcm_gym.Goals(pcm_gym.get_mechanism("2RFR"))), "rise": 0.1}, TypeError, "rise must be given to"),
        ({"rise": 0.1}, TypeError, "'rise' is no argument of an environment with task 'Reach'.*'load'.*'difficulty'"),
    ],
)
@pytest.mark.parametrize("kind", [pcm_gym.MechanismEnv, pcm_gym.MechanismVectorEnv])
def test_wrong_arguments_of_tasks_are_named(kind: Any, arguments: Any, error: Any, message: str) -> None:
    with pytest.raises(error, match=message):
        kind(**arguments)


def test_name_of_a_task_is_taken_once_but_a_class_may_be_defined_again(lift_id: str) -> None:
    with pytest.raises(ValueError, match="name must be a new one, got 'Lift'"):
        pcm_gym.register_task(Elsewhere.Lift)
    pcm_gym.register_task(Elsewhere.Lift, "Other")
    again = type("Lift", (Lift,), {"__module__": Lift.__module__, "__qualname__": Lift.__qualname__})
    pcm_gym.register_environment("My/2RFR-Lift-v0", mechanism="2RFR", task=again, time_limit=40, rise=0.1)
    assert type(make_bare(lift_id).task) is again


def test_names_that_a_task_may_not_use_are_all_that_environments_take() -> None:
    for kind in (pcm_gym.MechanismEnv, pcm_gym.MechanismVectorEnv):
        assert {*inspect.signature(kind).parameters} <= {*CONSTRUCTION, "arguments"}
    assert {*inspect.signature(pcm_gym.MechanismVectorEnv).parameters} == {*CONSTRUCTION, "arguments"}


@pytest.mark.parametrize("wrong", ["Reach", None, int, Lift(pcm_gym.Goals(pcm_gym.get_mechanism("2RFR")))])
def test_only_classes_of_tasks_and_mechanisms_can_be_registered(wrong: Any) -> None:
    with pytest.raises(TypeError, match="task must be"):
        pcm_gym.register_task(wrong)
    with pytest.raises(TypeError, match="mechanism must be a Mechanism"):
        pcm_gym.register_mechanism(wrong)


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"mechanism": "4RFR"}, ValueError, "mechanism must be one of.*'2RFR'.*got '4RFR'"),
        ({"time_limit": 0}, ValueError, "time_limit must be at least 1"),
        ({"time_limit": 2.5}, TypeError, "time_limit must be a whole number"),
    ],
)
def test_registration_refuses_what_could_never_be_made(arguments: Any, error: Any, message: str) -> None:
    with pytest.raises(error, match=message):
        pcm_gym.register_environment("My/2RFR-Reach-v0", **({"mechanism": "2RFR"} | arguments))
    assert "My/2RFR-Reach-v0" not in gymnasium.registry


def test_arrays_among_the_arguments_may_be_registered_again_and_have_a_json() -> None:
    for _ in range(2):
        pcm_gym.register_environment("My/2RFR-Reach-v0", mechanism="2RFR", max_action=np.array([0.1, 0.05]))
    spec = gymnasium.spec("My/2RFR-Reach-v0")
    assert EnvSpec.from_json(spec.to_json()) == spec
    assert make_bare("My/2RFR-Reach-v0").max_action.tolist() == [0.1, 0.05]


@dataclass(frozen=True)
class Fixed(pcm_gym.Task):
    """A task that draws the same episode again and again, out of one array."""

    drawn: ClassVar[list[np.ndarray]] = []

    def sample(self, scene: pcm_gym.Scene, generators: Generators, threads: int = 1) -> pcm_gym.Episodes:
        start = scene.at_equilibrium(scene.home, len(generators))
        if not self.drawn:
            self.drawn.append(self.goals.of_states(start.x, start.inputs)[:, None])
        return pcm_gym.Episodes(start, self.drawn[0])


def test_goal_that_is_asked_for_leaves_what_the_task_has_drawn() -> None:
    env = pcm_gym.MechanismEnv("2RFR", task=Fixed)
    drawn = env.reset(seed=0)[0]["desired_goal"].copy()
    asked = env.reset(seed=0, options={"goal": (0.1, 0.7)})[0]["desired_goal"]
    assert asked.tolist() == [0.1, 0.7]
    assert env.reset(seed=0)[0]["desired_goal"].tolist() == drawn.tolist()


# Mechanisms


def test_home_of_the_3rfr_is_stable() -> None:
    home = pcm_gym.home_equilibrium(three_rfr())
    assert home.is_stable
    assert home.residual < 1e-10
    assert home.singularity_margin > 0.5


def test_mechanism_is_an_environment_by_one_call() -> None:
    name = "My/3RFR-Reach-v0"
    pcm_gym.register_environment(name, mechanism=three_rfr(), task="Reach", time_limit=100)
    assert pcm_gym.get_mechanism("3RFR") == three_rfr()
    env = make_bare(name)
    check_env(env, skip_render_check=True)
    assert [element.unit for element in env.elements].count("half range") == 3
    assert [element.name for element in env.elements if "clamp_3" in element.name and "load" not in element.name] == [
        "cos_clamp_3",
        "sin_clamp_3",
    ]
    batch = make_native(name, 8)
    batch.reset(seed=0)
    for action in sweeping_actions(40, batch.action_space.shape, seed=0):
        observation, _, _, _, infos = batch.step(action)
        assert batch.observation_space.contains(observation)
        assert infos["residual"].max() < 1e-9
    assert name not in pcm_gym.environment_ids()
    assert make_bare(EnvSpec.from_json(gymnasium.spec(name).to_json())).mechanism == three_rfr()


def test_registering_again_changes_nothing_and_something_else_is_refused() -> None:
    def register(**changes: Any) -> None:
        arguments: dict[str, Any] = {"mechanism": three_rfr(), "task": "Track", "time_limit": 50, "path": "circle"}
        pcm_gym.register_environment("My/3RFR-Track-v0", **(arguments | changes))

    register()
    before = gymnasium.spec("My/3RFR-Track-v0")
    register()
    assert gymnasium.spec("My/3RFR-Track-v0") is before
    with pytest.raises(ValueError, match="name must be a new one, got '3RFR'"):
        register(mechanism=three_rfr(turn=0.8))
    with pytest.raises(ValueError, match="environment_id must be a new one"):
        register(path="eight")
    with pytest.raises(TypeError, match="'sped' is no argument"):
        register(sped=3)


USERS_FILE = """
from dataclasses import dataclass
import pcm_gym

@dataclass(frozen=True)
class Gentle(pcm_gym.Task):
    slack: float = 0.1

    def sample(self, scene, generators, threads=1):
        states = scene.at_equilibrium(scene.home, len(generators))
        return pcm_gym.Episodes(states, self.goals.of_states(states.x, states.inputs)[:, None], states)

    def score(self, achieved, desired):
        is_near = abs(achieved - desired).max(axis=1) < self.slack
        return 1.0 * is_near, is_near

pcm_gym.register_environment("My/Gentle-v0", mechanism="2PFR", task=Gentle, slack=0.2)
"""


def test_id_may_name_the_users_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "users_file.py").write_text(USERS_FILE, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    env = gymnasium.make("users_file:My/Gentle-v0")
    env.reset(seed=0)
    assert env.step(np.zeros(2, np.float32))[1] == 1.0
