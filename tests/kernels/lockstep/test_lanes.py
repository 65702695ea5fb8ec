"""Rows in lock-step against the scalar code that they may take the place of, and against themselves."""

import os
import subprocess
import sys
from pathlib import Path

import numba
import numpy as np
import pytest

from pcm_gym.environments.batch import MechanismVectorEnv
from pcm_gym.environments.settings import Settings
from pcm_gym.environments.simulation import Simulation
from pcm_gym.kernels.numerics import threads
from pcm_gym.kernels.rods.elliptic import sine_and_cosine
from pcm_gym.kernels.rods.rod import RodPoint, rod, rod_in_lanes
from pcm_gym.kernels.statics.states import States
from pcm_gym.kernels.stepping.report import Costs, Moves, Report
from pcm_gym.kernels.stepping.transition import describe_batch, step_alone, step_batch
from pcm_gym.solving import Event
from tests.environments.rollouts import digest

NAMES = ("2RFR", "2PFR", "3PFR")
LOADS = {"2RFR": (0.25, -0.5), "2PFR": (0.5, -0.25), "3PFR": (0.125, -0.25, 0.05)}
ROOT = Path(__file__).parents[3]


@numba.njit(error_model="numpy")
def all_in_lanes(g: np.ndarray, out: np.ndarray, holds: np.ndarray) -> None:
    for n in range(len(g)):
        point, _, holds[n] = rod_in_lanes(g[n, 0], g[n, 1])
        for k in range(14):
            out[n, k] = point[k]


def from_half_angles(rho: np.ndarray, kappa_c: np.ndarray) -> np.ndarray:
    b = 2.0 * np.arcsin(kappa_c)
    return np.column_stack([rho**2 * np.cos(b), -(rho**2) * np.sin(b)])


def test_sine_and_cosine_are_those_of_the_library() -> None:
    generator = np.random.default_rng(0)
    edges = np.pi / 4.0 * np.arange(-16.0, 17.0)
    angles = np.concatenate([edges, generator.uniform(-20.0, 20.0, 20_000), generator.uniform(-1e5, 1e5, 20_000)])
    found = np.array([sine_and_cosine(float(angle)) for angle in angles])
    np.testing.assert_allclose(found, np.column_stack([np.sin(angles), np.cos(angles)]), rtol=0.0, atol=3e-16)


def test_rod_in_lanes_is_the_rod() -> None:
    """Every load and half angle that the mask lets through, its edges included; the taut end is the hard one."""
    generator = np.random.default_rng(1)
    rho = np.exp(generator.uniform(np.log(0.2236068), np.log(40.0), 40_000))
    kappa_c = np.exp(generator.uniform(np.log(1e-6), 0.0, 40_000)) * generator.choice([-1.0, 1.0], 40_000)
    rho[:100], kappa_c[100:200] = 0.2236068, 1.0000001e-6
    g = from_half_angles(rho, kappa_c)
    found, holds = np.empty((len(g), 14)), np.zeros(len(g), np.bool_)
    all_in_lanes(g, found, holds)
    expected = np.array([rod(*map(float, row)) for row in g])
    assert holds.mean() > 0.99
    # relative to the largest value of the same kind, whose digits the others share
    kinds = {"tip": (0, 2), "force": (2, 4), "tip by g": (4, 8), "force by g": (8, 12), "mode": (13, 14)}
    for name, (first, last) in kinds.items():
        scale = np.abs(expected[:, first:last]).max(axis=1, keepdims=True) + 1.0
        error = np.abs(found - expected)[:, first:last] / scale
        assert error[holds].max() < 2e-12, name
    np.testing.assert_array_equal(found[holds, 12], expected[holds, 12])


@pytest.mark.parametrize(
    "g",
    [
        (0.0, 0.0),
        (0.04, 0.0),
        (0.0, -0.0499),
        (2.6e5, 1.0),
        (np.nan, 1.0),
        (np.inf, 0.0),
        (100.0, 0.0),
        (100.0, 1e-5),
        (5e-324, 0.0),
    ],
)
def test_mask_leaves_out_what_only_the_scalar_rod_can_do(g: tuple[float, float]) -> None:
    found, holds = np.empty((1, 14)), np.ones(1, np.bool_)
    all_in_lanes(np.array([g]), found, holds)
    assert not holds[0]


def test_formulas_are_the_same_without_compilation() -> None:
    point, _, holds = rod_in_lanes.py_func(3.0, -4.0)  # type: ignore[attr-defined]
    assert holds
    np.testing.assert_allclose(RodPoint(*point), rod(3.0, -4.0), rtol=1e-13)


def simulation_of(name: str, rows: int, *, is_loaded: bool, thread_count: int = 1) -> Simulation:
    load = LOADS[name] if is_loaded else None
    settings = Settings.from_arguments(name, {"load": load})
    simulation = Simulation(settings, rows, thread_count)
    simulation.reset_rows(np.arange(rows), [np.random.default_rng(row) for row in range(rows)], None)
    return simulation


def copied(states: States) -> States:
    return States(*(array.copy() for array in states))


def stepped(simulation: Simulation, states: States, actions: np.ndarray, blocks: list[np.ndarray]) -> Report:
    settings = simulation.settings
    report = simulation._empty_report()
    for rows in blocks:
        step_batch(settings.mechanism.leg_table, states, rows, Moves(actions, settings.stride), settings.rules, report)
    return report


@pytest.mark.parametrize("name", NAMES)
def test_states_at_rest_are_described_as_rows_that_stand_still_alone(name: str) -> None:
    """Strongly loaded states too, and the home state, at whose poles only the scalar code can judge."""
    simulation = simulation_of(name, 200, is_loaded=True)
    settings, states = simulation.settings, simulation.rows.states
    legs, rows, still = settings.mechanism.leg_table, np.arange(201), np.zeros((201, settings.mechanism.leg_count))
    home = Settings.from_arguments(name, {}).scenes()[0]
    states = States(*(np.append(a, b, axis=0) for a, b in zip(states, home.at_equilibrium(home.home, 1), strict=True)))
    found, expected = (Simulation(settings, 201)._empty_report() for _ in range(2))
    describe_batch(legs, states, rows, found)
    step_alone(
        legs, states, rows, Moves(still, settings.stride), settings.rules._replace(singular_margin=0.0), expected
    )
    for name in ("index", "event", "is_stable"):
        np.testing.assert_array_equal(found.verdicts[name], expected.verdicts[name])
    assert found.verdicts["residual"].max() < 1e-11
    # near a pole of a rod's stiffness the two formulas multiply rounding errors, the margin once more
    np.testing.assert_allclose(found.features[:, :-1], expected.features[:, :-1], rtol=0.0, atol=1e-6)
    np.testing.assert_allclose(found.features[:, -1], expected.features[:, -1], rtol=0.0, atol=1e-4)
    assert not any(found.verdicts[name].any() for name in Costs.__annotations__)


@pytest.mark.parametrize("is_loaded", [False, True], ids=["free", "loaded"])
@pytest.mark.parametrize("walk", ["random", "straight"])
@pytest.mark.parametrize("name", NAMES)
def test_batch_is_every_row_tracked_alone(name: str, walk: str, is_loaded: bool) -> None:
    """Straight walks at full speed, some twice as far as an agent may go, run into limits, folds and poles."""
    count, generator = 300, np.random.default_rng(2)
    simulation = simulation_of(name, count, is_loaded=is_loaded)
    mechanism = simulation.settings.mechanism
    legs, settings = mechanism.leg_table, simulation.settings
    held = generator.choice([-1.0, 1.0], (count, mechanism.leg_count))
    events, same = np.zeros(len(Event), dtype=int), 0
    for _ in range(30):
        actions = held if walk == "straight" else generator.uniform(-1.0, 1.0, held.shape)
        alone, expected, found = copied(simulation.rows.states), simulation._empty_report(), simulation._empty_report()
        for chosen, factor in ((np.arange(1, count, 2), 1.0), (np.arange(0, count, 2), 2.0)):
            moves = Moves(actions, factor * settings.stride)
            step_batch(legs, simulation.rows.states, chosen, moves, settings.rules, found)
            step_alone(legs, alone, chosen, moves, settings.rules, expected)
        for name in ("index", "event", "is_lost", "is_stable", *Costs.__annotations__):
            np.testing.assert_array_equal(found.verdicts[name], expected.verdicts[name])
        np.testing.assert_array_equal(found.verdicts["fraction"] == 1.0, expected.verdicts["fraction"] == 1.0)
        np.testing.assert_array_equal(simulation.rows.states.inputs, alone.inputs)
        same += ((simulation.rows.states.x == alone.x).all(axis=1) & (found.verdicts["event"] == 0)).sum()
        scale = 1.0 + np.abs(alone.x).max(axis=1, keepdims=True)
        # both end when the next correction would be below 1e-13; near a pole of a rod's stiffness lanes may keep errors
        # of closure and force of up to 1e-12; beside a fold such errors are divided by how near it is
        apart = (np.abs(simulation.rows.states.x - alone.x) / scale).max(axis=1)
        assert (apart * np.minimum(1.0, expected.verdicts["singularity_margin"])).max() < 1e-11
        assert found.verdicts["residual"].max() < 1e-11
        is_calm = expected.verdicts["residual"] < 1e-12
        features, expected_features = found.features[is_calm], expected.features[is_calm]
        np.testing.assert_allclose(features[:, :-1], expected_features[:, :-1], rtol=0.0, atol=1e-6)
        # the margin is a derivative of the stiffness, which multiplies rounding errors once more near a pole
        np.testing.assert_allclose(features[:, -1], expected_features[:, -1], rtol=0.0, atol=1e-4)
        events += np.bincount(found.verdicts["event"], minlength=len(Event))
    assert same < 0.5 * events[0], "most rows must go in lock-step, or nothing is compared"
    assert events[1:].sum() > 0


@pytest.mark.parametrize("name", NAMES)
def test_rows_do_not_depend_on_their_neighbours(name: str) -> None:
    """Alone, in blocks of any size, in any order: the same bits."""
    count, generator = 1000, np.random.default_rng(3)
    simulation = simulation_of(name, count, is_loaded=True)
    actions = generator.uniform(-1.0, 1.0, (count, simulation.settings.mechanism.leg_count))
    whole = copied(simulation.rows.states)
    expected = stepped(simulation, whole, actions, [np.arange(count)])
    for size in (1, 2, 7, 8, 9, 64, 65, 1000):
        order = generator.permutation(count)
        states = copied(simulation.rows.states)
        report = stepped(simulation, states, actions, [order[n : n + size] for n in range(0, count, size)])
        for found, array in zip((*states, *report), (*whole, *expected), strict=True):
            assert found.tobytes() == array.tobytes(), size


@pytest.mark.parametrize("name", NAMES)
def test_results_do_not_depend_on_the_number_of_threads(name: str) -> None:
    envs = [MechanismVectorEnv(300, mechanism=name, threads=count, max_episode_steps=20) for count in (1, 2, 5)]
    generator = np.random.default_rng(4)
    digests = [[digest(env.reset(seed=0))] for env in envs]
    for _ in range(60):
        actions = generator.uniform(-1.0, 1.0, envs[0].action_space.shape).astype(np.float32)
        for env, found in zip(envs, digests, strict=True):
            found.append(digest(env.step(actions)))
    assert digests[0] == digests[1] == digests[2]


def test_every_job_is_run_once_whatever_the_number_of_threads() -> None:
    for thread_count in (1, 2, 3, 16):
        covered = np.zeros(1000, dtype=int)

        def cover(first: int, last: int, covered: np.ndarray = covered) -> None:
            covered[first:last] += 1

        threads.run_all(threads.pieces_of(cover, 1000, thread_count), thread_count)
        assert (covered == 1).all()
        threads.run_all([], thread_count)


def test_jobs_may_use_threads_themselves() -> None:
    counts = []

    def inner(first: int, last: int) -> None:
        counts.append(last - first)

    def outer() -> None:
        threads.run_all(threads.pieces_of(inner, 1024, 2), 2)

    threads.run_all([outer] * 6, 2)
    assert sum(counts) == 6 * 1024


def test_error_of_a_helper_is_raised() -> None:
    def fail(first: int, last: int) -> None:
        raise ZeroDivisionError(first, last)

    with pytest.raises(ZeroDivisionError):
        threads.run_all(threads.pieces_of(fail, 1024, 2), 2)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="the system cannot fork")
def test_threads_are_made_anew_after_a_fork() -> None:
    code = """
import os, numpy as np
from pcm_gym.environments.batch import MechanismVectorEnv
env = MechanismVectorEnv(512, mechanism="2PFR", threads=2)
env.reset(seed=0)
first = env.step(np.zeros((512, 2), np.float32))[0]["observation"]
child = os.fork()
again = env.step(np.zeros((512, 2), np.float32))[0]["observation"]
if child == 0:
    os._exit(0 if np.isfinite(again).all() else 1)
print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
"""
    result = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", code], cwd=ROOT, capture_output=True, text=True, timeout=120, check=True
    )
    assert result.stdout.split() == ["0"]


@pytest.mark.parametrize(
    ("variables", "expected"),
    [
        ({"OMP_NUM_THREADS": "1"}, "1"),
        ({"NUMBA_NUM_THREADS": "1"}, "1"),
        ({"OMP_NUM_THREADS": "1,2"}, "1"),
        ({"OMP_NUM_THREADS": "100000"}, None),
        ({"OMP_NUM_THREADS": "many"}, None),
    ],
)
def test_number_of_threads_follows_the_usual_variables(variables: dict[str, str], expected: str | None) -> None:
    environment = {key: value for key, value in os.environ.items() if not key.endswith("_NUM_THREADS")} | variables
    code = "from pcm_gym.kernels.numerics.threads import default_thread_count; print(default_thread_count())"
    result = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, env=environment, capture_output=True, text=True, check=True
    )
    assert result.stdout.strip() == (expected or str(len(os.sched_getaffinity(0))))


@pytest.mark.parametrize(("value", "error"), [(0, ValueError), (-1, ValueError), (1.5, TypeError), ("two", TypeError)])
def test_bad_number_of_threads_is_named(value: object, error: type[Exception]) -> None:
    with pytest.raises(error, match="threads"):
        MechanismVectorEnv(2, threads=value)  # type: ignore[arg-type]
