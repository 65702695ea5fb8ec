"""Asking without moving: a step does what was told of it, and asking leaves no trace."""

import itertools
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

import pcm_gym
from pcm_gym.kernels.stepping.transition import GIVE_UP, step_in_lanes
from tests.environments.rollouts import (
    MECHANISMS,
    assert_same,
    make_bare,
    make_native,
    sweeping_actions,
)

NAMES = MECHANISMS
BEHAVIOURS = ("terminate", "snap", "hold", "continue")
NUMBERS = (
    "index",
    "stability_margin",
    "singularity_margin",
    "residual",
    "cost",
    "cost_unstable",
    "cost_singular",
    "event",
    "at_limit",
    "cost_solver",
)
ACTUATORS: dict[str, dict[str, Any]] = {
    "ideal": {},
    "lag": {"actuator_lag": 1.5},
    "rate limit": {"rate_limit": 0.05},
    "backlash": {"backlash": 0.02},
    "all": {"actuator_lag": 1.5, "rate_limit": 0.05, "backlash": 0.02, "observation_noise": 0.1},
}
RANDOMISED = {"randomisation": {"stiffness": 0.1, "length": 0.02, "base": 0.01}, "variants": 2}


KINDS = dict.fromkeys(("index", "event", "losses"), np.int64) | dict.fromkeys(
    ("at_limit", "is_dwelling", "terminated"), np.bool_
)


def choices_around(generator: np.random.Generator, action: np.ndarray) -> np.ndarray:
    """Four actions, of which the third is the one that is taken."""
    choices = generator.uniform(-1.0, 1.0, (4, *action.shape)).astype(np.float32)
    choices[2] = action
    return choices


def assert_told(told: pcm_gym.Preview, place: Any, step: tuple[Any, ...], env: Any, row: int = 0) -> None:
    """What was told, at one place, is what has come, in one row, to the last bit."""
    _, reward, terminated, _, info = step
    if isinstance(reward, np.ndarray):
        reward, terminated = reward[row], terminated[row]
        info = {key: values[row] for key, values in info.items()}
    for key in NUMBERS:
        assert getattr(told, key)[place] == info[key], key
    assert told.reward[place] == reward
    assert told.terminated[place] == terminated
    here = env._simulation.equilibrium(row)
    assert told.pose[place].tobytes() == here.pose.tobytes()
    assert told.inputs[place].tobytes() == here.inputs.tobytes()


@pytest.mark.parametrize("behaviour", BEHAVIOURS)
@pytest.mark.parametrize("name", NAMES)
def test_a_step_does_what_was_told_of_it(name: str, behaviour: str) -> None:
    environment_id, lost, cut = f"PCM/{name}-Reach-v0", 0.0, 0.0
    for case, actuators in enumerate(ACTUATORS.values()):
        variants = RANDOMISED if len(actuators) != 1 else {}
        keywords = variants | actuators
        env = make_bare(environment_id, on_instability=behaviour, **keywords)
        generator = np.random.default_rng(case)
        for seed in range(4):
            env.reset(seed=seed)
            for action in sweeping_actions(40, env.action_space.shape, seed=10 * case + seed):
                told = env.preview(choices_around(generator, action))
                step = env.step(action)
                assert_told(told, 2, step, env)
                lost, cut = lost + step[4]["cost_unstable"], cut + step[4]["at_limit"]
                if step[2] or step[3]:
                    break
    assert lost > 0.0
    assert cut > 0.0 or name == "2RFR"


@pytest.mark.parametrize("behaviour", BEHAVIOURS)
@pytest.mark.parametrize("actuators", ACTUATORS)
def test_steps_of_a_batch_do_what_was_told_of_them(actuators: str, behaviour: str) -> None:
    count, generator = 6, np.random.default_rng(1)
    keywords = {"on_instability": behaviour, **RANDOMISED, **ACTUATORS[actuators]}
    env = make_native("PCM/2RFR-Reach-v0", count, **keywords)
    env.reset(seed=0)
    waiting = np.zeros(count, dtype=bool)
    for actions in sweeping_actions(60, env.action_space.shape, seed=2):
        told = env.preview(choices_around(generator, actions).swapaxes(0, 1))
        step = env.step(actions)
        for row in np.flatnonzero(~waiting).tolist():
            assert_told(told, (row, 2), step, env, row)
        waiting = step[2] | step[3]


@pytest.mark.parametrize("environment_id", ["PCM/2RFR-Track-v0", "PCM/3PFR-Track-v0", "PCM/2RFR-Switch-v0"])
@pytest.mark.parametrize("reward_type", ["dense", "sparse"])
def test_the_reward_is_for_the_goal_that_counts_then(environment_id: str, reward_type: str) -> None:
    env = make_bare(environment_id, reward_type=reward_type, success_distance=0.05, actuator_lag=1.0)
    env.reset(seed=0)
    for action in sweeping_actions(20, env.action_space.shape, seed=3):
        told = env.preview(action[None])
        assert_told(told, 0, env.step(action), env)


@pytest.mark.parametrize("actuators", ["ideal", "lag"])
def test_a_failure_of_the_solver_is_told(actuators: str) -> None:
    """A state that is no equilibrium stands in for a natural failure: the solver cannot follow a branch from it."""
    env = make_bare("PCM/2RFR-Reach-v0", **ACTUATORS[actuators])
    env.reset(seed=0)
    env._simulation.rows.x[0, :4] += 0.5
    told, step = env.preview(np.ones((1, 2))), env.step(np.ones(2))
    assert_told(told, 0, step, env)
    assert (step[4]["event"], told.cost_solver[0]) == (pcm_gym.Event.SOLVER_FAILURE, 1.0)


@pytest.mark.parametrize("actuators", ["ideal", "all"])
def test_asking_leaves_no_trace(actuators: str) -> None:
    asked, other = (
        make_native("PCM/3PFR-Track-v0", 3, autoreset_mode=AutoresetMode.SAME_STEP, **ACTUATORS[actuators])
        for _ in range(2)
    )
    assert_same(asked.reset(seed=0), other.reset(seed=0))
    for actions in sweeping_actions(40, asked.action_space.shape, seed=0):
        asked.preview(np.stack([actions, -actions], axis=1))
        assert_same(asked.step(actions), other.step(actions))
    assert_same(asked.save_state(), other.save_state())


def test_asking_again_gives_equal_bits_in_memory_of_its_own() -> None:
    env = make_native("PCM/2RFR-Reach-v0", 3, **ACTUATORS["all"])
    env.reset(seed=0)
    actions = np.random.default_rng(0).uniform(-1.0, 1.0, (3, 5, 2))
    first = vars(env.preview(actions))
    kept = {key: array.copy() for key, array in first.items()}
    second = vars(env.preview(actions))
    for one, other in itertools.product(first.values(), [*second.values(), *env._simulation.rows]):
        assert not np.shares_memory(one, other)
    for one, other in itertools.combinations(first.values(), 2):
        assert not np.shares_memory(one, other)
    for array in first.values():
        array[...] = 1
    assert_same(second, kept)
    assert_same(vars(env.preview(actions)), kept)


@pytest.mark.parametrize("actuators", ["ideal", "all"])
def test_answers_depend_neither_on_threads_nor_on_what_else_is_asked(actuators: str) -> None:
    keywords = RANDOMISED | ACTUATORS[actuators]
    alone, shared = (make_native("PCM/2RFR-Reach-v0", 70, threads=threads, **keywords) for threads in (1, 3))
    for env in (alone, shared):
        env.reset(seed=0)
        for action in sweeping_actions(15, env.action_space.shape, seed=1):
            env.step(action)
    actions = np.random.default_rng(0).uniform(-1.0, 1.0, (70, 7, 2))
    together = vars(shared.preview(actions))
    assert_same(together, vars(alone.preview(actions)))
    for k in (0, 6):
        for key, values in vars(alone.preview(actions[:, k : k + 1])).items():
            assert values[:, 0].tobytes() == together[key][:, k].tobytes(), key


@pytest.mark.parametrize("name", NAMES)
def test_those_who_give_up_are_not_moved_and_arrivals_are_the_same(name: str) -> None:
    """What lock-step does not follow is reported as not solved for; nothing else differs by a bit."""
    environment_id = f"PCM/{name}-Reach-v0"
    env = make_native(environment_id, 200)
    env.reset(seed=0)
    simulation, generator = env._simulation, np.random.default_rng(0)
    actions, given_up = generator.choice([-1.0, 1.0], env.action_space.shape), 0
    for _ in range(25):
        start = simulation.motion
        quick, exact = (start.copied(np.arange(200)) for _ in range(2))
        found = simulation.foresee(quick, actions, simulation.settings.rules._replace(behaviour=GIVE_UP))
        expected = simulation.foresee(exact, actions)
        gave_up = found.verdicts["event"] == pcm_gym.Event.SOLVER_FAILURE
        given_up += gave_up.sum()
        for moved, old, own in zip(quick.states, start.states, exact.states, strict=True):
            assert moved[gave_up].tobytes() == old[gave_up].tobytes()
            assert moved[~gave_up].tobytes() == own[~gave_up].tobytes()
        np.testing.assert_array_equal(found.verdicts[~gave_up], expected.verdicts[~gave_up])
        assert found.features[~gave_up].tobytes() == expected.features[~gave_up].tobytes()
        assert (found.verdicts["singularity_margin"][gave_up] == 0.0).all()
        env.step(actions)
    assert 10 < given_up < 2500


def test_shapes_are_those_of_the_actions() -> None:
    single, batch = make_bare("PCM/3PFR-Reach-v0"), make_native("PCM/3PFR-Reach-v0", 2)
    single.reset(seed=0)
    batch.reset(seed=0)
    for count in (0, 1, 4):
        for env, leading in ((single, (count,)), (batch, (2, count))):
            for key, array in vars(env.preview(np.zeros((*leading, 3)))).items():
                own = (3,) if key in ("pose", "inputs") else ()
                assert array.shape == leading + own
                assert array.dtype == KINDS.get(key, np.float64)


def test_any_layout_is_taken_and_compiles_nothing_anew() -> None:
    single, batch = make_bare("PCM/2RFR-Reach-v0"), make_native("PCM/2RFR-Reach-v0", 3)
    single.reset(seed=0)
    batch.reset(seed=0)
    actions = np.random.default_rng(0).uniform(-1.0, 1.0, (3, 4, 2)).astype(np.float32)
    read_only = actions.copy()
    read_only.flags.writeable = False
    layouts = [actions, actions.astype(np.float64), np.asfortranarray(actions), read_only, actions.tolist()]
    layouts += [np.repeat(actions, 2, axis=1)[:, ::2], np.asfortranarray(actions, dtype=np.float64)]
    expected = vars(batch.preview(actions))
    batch.step(actions[:, 0])
    batch.reset(seed=0)
    dispatcher: Any = step_in_lanes
    compiled = len(dispatcher.signatures)
    for layout in layouts:
        assert_same(vars(batch.preview(layout)), expected)
        chosen = layout[0]
        assert_same(vars(single.preview(chosen)), {key: array[0] for key, array in expected.items()})
    strict = np.asfortranarray(actions[:, 0], dtype=np.float64)
    strict.flags.writeable = False
    batch.step(strict)
    single.step(strict[0])
    assert len(dispatcher.signatures) == compiled


@pytest.mark.parametrize(
    ("actions", "message"),
    [
        (np.zeros(2), r"actions must have shape \(k, 2\), got \(2,\)"),
        (np.zeros((4, 3)), r"actions must have shape \(k, 2\), got \(4, 3\)"),
        (np.zeros((1, 4, 2)), r"actions must have shape \(k, 2\), got \(1, 4, 2\)"),
        ([[0.0, 0.0], [np.nan, 1.0]], r"actions must be finite, got \[\[nan, 1.0\]\]"),
        ([[0.0, np.inf]], r"actions must be finite, got \[\[0.0, inf\]\]"),
        ("up", "actions must be an array of numbers, got 'up'"),
        ([[0.0], [0.0, 1.0]], "actions must be an array of numbers, got"),
    ],
)
def test_bad_actions_are_named(actions: Any, message: str) -> None:
    env = make_bare("PCM/2RFR-Reach-v0")
    env.reset(seed=0)
    with pytest.raises((ValueError, TypeError), match=message):
        env.preview(actions)


@pytest.mark.parametrize("shape", [(3, 2), (2, 4, 2), (3, 4, 3)])
def test_actions_of_a_batch_have_its_number_of_rows(shape: tuple[int, ...]) -> None:
    env = make_native("PCM/2RFR-Reach-v0", 3)
    env.reset(seed=0)
    with pytest.raises(ValueError, match=r"actions must have shape \(3, k, 2\), got"):
        env.preview(np.zeros(shape))


def test_a_batch_cannot_be_asked_before_its_first_reset() -> None:
    env = make_native("PCM/2RFR-Reach-v0", 2)
    with pytest.raises(gymnasium.error.ResetNeeded, match="preview"):
        env.preview(np.zeros((2, 1, 2)))
