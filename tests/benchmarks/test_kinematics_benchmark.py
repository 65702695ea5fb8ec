"""The benchmark of the position problem: its searches from random starts are right, and it compares what they meet."""

import itertools
import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from benchmarks import kinematics
from benchmarks.__main__ import app
from benchmarks.multistart import METHODS, Equations, Method, search
from benchmarks.problems import MECHANISMS, Problem, make_problems
from pcm_gym.solving import Equilibrium

KINDS = [pytest.param(name, inverse, id=f"{name}-{inverse}") for name in MECHANISMS for inverse in (False, True)]


@pytest.mark.parametrize(("name", "is_inverse"), KINDS)
def test_the_jacobian_is_that_of_finite_differences(name: str, is_inverse: bool) -> None:
    (problem,) = make_problems(name, 1, is_inverse=is_inverse)
    equations = Equations(problem)
    states = equations.starts(np.random.default_rng(0), 20)
    step = 1e-5
    _, jacobians = equations(states)
    for column, unit in enumerate(np.eye(equations.size)):
        differences = (equations(states + step * unit)[0] - equations(states - step * unit)[0]) / (2.0 * step)
        scale = np.abs(jacobians[:, :, column]).max(axis=1, keepdims=True)
        assert np.abs((differences - jacobians[:, :, column]) / scale).max(axis=1).mean() < 1e-3


def equilibrium_of(problem: Problem, state: np.ndarray) -> Equilibrium:
    """Return a state of the searches as the package sees it."""
    mechanism, units = problem.mechanism, problem.mechanism.units
    rods, free = np.split(state, [2 * mechanism.leg_count])
    pose, inputs = (problem.given / units.pose, free * units.inputs) if problem.is_inverse else (free, problem.given)
    return Equilibrium(mechanism, np.concatenate([rods, pose]), inputs, problem.load)


@pytest.mark.parametrize("method", METHODS.values(), ids=METHODS.keys())
@pytest.mark.parametrize(("name", "is_inverse"), KINDS)
def test_searches_meet_different_true_equilibria(name: str, is_inverse: bool, method: Method) -> None:
    """By the residual of the package's own kernels, with which the searches share no code."""
    problem = make_problems(name, 3, is_inverse=is_inverse)[2]  # the first with a load
    assert problem.load.any()
    equations = Equations(problem)
    met = np.empty((0, equations.size))
    for states in itertools.islice(search(equations, method, np.random.default_rng(0)), 400):
        met = np.vstack([met, states])
        if len(met) > 1:
            break
    assert len(met) > 1
    assert np.array_equal(equations.are_same(met, met), np.eye(len(met), dtype=bool))
    for state in met:
        equilibrium = equilibrium_of(problem, state)
        assert equilibrium.residual < 1e-6
        assert max(rod.rho for rod in equilibrium.rods) <= problem.rho_max * (1.0 + 1e-12)
        np.testing.assert_allclose(equations.state_of(equilibrium), state, rtol=1e-14)


def compared(monkeypatch: pytest.MonkeyPatch, problem: Problem, batches: list[np.ndarray]) -> dict[str, float]:
    """Return the benchmark's figures of a search that yields these states and then no more."""

    def told(equations: Equations, rng: np.random.Generator) -> Iterator[np.ndarray]:
        yield from batches
        yield from itertools.repeat(np.empty((0, equations.size)))

    monkeypatch.setattr(kinematics, "METHODS", {"told": told})
    figures = kinematics.solve_and_search(problem, 0.1)()
    return {key.removeprefix("told: "): value for key, value in figures.items()}


def test_what_a_search_meets_is_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    problem, other = make_problems("2PFR", 2, is_inverse=False)
    wanted, foreign = (np.array([Equations(p).state_of(e) for e in p.solve()]) for p in (problem, other))

    whole = compared(monkeypatch, problem, [wanted[:1], wanted[1:]])
    assert whole["solutions"] == len(wanted)
    assert whole["is_complete"] == 1.0
    assert whole["missed_in_long_time"] == whole["not_in_our_set"] == 0.0
    assert whole["times_ours"] > 0.0

    part = compared(monkeypatch, problem, [wanted[1:], wanted[1:], foreign])
    assert part["is_complete"] == 0.0
    assert part["missed_in_long_time"] == 1.0
    assert part["not_in_our_set"] == len(foreign)
    assert part["times_ours"] * part["seconds"] >= 0.1

    nothing = compared(monkeypatch, problem, [])
    assert nothing["missed_in_our_time"] == nothing["missed_in_long_time"] == len(wanted)


def test_problems_are_the_same_every_time() -> None:
    for first, second in zip(*(make_problems("2RFR", 3, is_inverse=True) for _ in range(2)), strict=True):
        assert first.mechanism == second.mechanism
        np.testing.assert_array_equal(first.given, second.given)
        np.testing.assert_array_equal(first.load, second.load)


def test_the_command_runs_and_writes_finite_figures(tmp_path: Path) -> None:
    path = tmp_path / "figures.json"
    result = CliRunner().invoke(app, ["kinematics", "--problems", "1", "--seconds", "0.05", "--json", str(path)])
    assert result.exit_code == 0, result.output
    figures = json.loads(path.read_text())
    assert figures["machine"]
    assert len(figures["tables"]) == 3
    for kind in ("forward", "inverse"):
        for name in MECHANISMS:
            (members,) = figures[f"{kind} {name}"].values()
            assert np.isfinite([value for summary in members.values() for value in summary.values()]).all()
            assert members["solutions"]["median"] > 0.0
            for method in METHODS:
                assert method in result.output
                assert members[f"{method}: not_in_our_set"]["most"] == 0.0
