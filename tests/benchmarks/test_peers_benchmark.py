"""The peers of ``python -m benchmarks peers``: exact path, accuracy as stated, absence said. No time is asserted."""

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from benchmarks.__main__ import app
from benchmarks.peers import catalogue, table
from benchmarks.peers.following import Peer, Places, Step, follow
from benchmarks.peers.ours import home
from benchmarks.peers.problem import HOME, INCREMENT, STEPS, exact_path
from benchmarks.timing import Summary
from pcm_gym import BranchTracker, Event

PLACES = np.arange(3)


def tips_after(name: str, count: int) -> np.ndarray:
    peer, path = (catalogue.OURS | catalogue.FOLLOWERS)[name], exact_path()
    place: Any = np.intp(0)  # the one place of a peer that steps a single mechanism
    step = peer.prepare(place)
    return np.array([step(path.inputs[place]).copy() for place in range(1, count + 1)])


def test_the_exact_path_begins_at_the_published_home() -> None:
    path = exact_path()
    np.testing.assert_allclose(path.inputs[0], HOME, atol=1e-15)
    np.testing.assert_allclose(path.tips[0], [0.0, 0.927501479], atol=1e-9)
    np.testing.assert_allclose(np.hypot(*path.unknowns[0, :2]), 2.404959, atol=1e-6)


def test_the_path_is_closed_in_steps_of_one_degree() -> None:
    inputs = exact_path().inputs
    increments = np.linalg.norm(np.roll(inputs, -1, axis=0) - inputs, axis=1)
    assert len(inputs) == STEPS
    np.testing.assert_allclose(increments, INCREMENT, rtol=1e-12)


def test_every_equilibrium_of_the_path_is_stable_and_its_tip_that_of_shooting() -> None:
    start, path = home(), exact_path()
    tracker = BranchTracker(start.mechanism, start)
    for inputs, tip in zip(path.inputs, path.tips, strict=True):
        step = tracker.step(inputs)
        assert step.event == Event.NONE
        assert step.equilibrium.is_stable
        np.testing.assert_allclose(step.equilibrium.pose, tip, atol=1e-12)


@pytest.mark.parametrize(
    ("name", "accuracy"),
    [
        (catalogue.ONE, 1e-12),
        ("pcm_gym, BranchTracker", 1e-12),
        ("Numba RK4 shooting", 5e-7),
        ("SciPy odeint and root", 2e-6),
        ("SciPy solve_bvp, 1e-3", 2e-6),
        ("SciPy solve_bvp, 1e-6", 1e-8),
    ],
)
def test_peers_reach_their_accuracy_against_shooting_of_order_8(name: str, accuracy: float) -> None:
    np.testing.assert_allclose(tips_after(name, 5), exact_path().tips[1:6], atol=accuracy)


@pytest.mark.parametrize("name", [catalogue.BATCH, "Numba RK4 shooting, batch of 1024"])
def test_rows_of_a_batch_follow_from_their_own_places(name: str) -> None:
    peer, path = (catalogue.OURS | catalogue.FOLLOWERS)[name], exact_path()
    step = peer.prepare(PLACES)
    for n in (1, 2):
        np.testing.assert_allclose(step(path.inputs[PLACES + n]), path.tips[PLACES + n], atol=5e-7)


def test_chains_of_links_rest_near_the_exact_tips() -> None:
    pytest.importorskip("mujoco")
    np.testing.assert_allclose(tips_after("MuJoCo chain, 20 links", 5), exact_path().tips[1:6], atol=1e-3)


def test_the_largest_error_of_the_steps_that_were_taken_is_reported() -> None:
    path = exact_path()

    def prepare(_: Places) -> Step:
        return lambda inputs: path.tips[(path.inputs == inputs).all(axis=1)][0] + [3e-4, 4e-4]

    figures = follow(Peer(prepare, "", ""), 0.0)()
    np.testing.assert_allclose(figures["tip_error"], 5e-4, rtol=1e-9)
    assert figures["steps_per_second"] > 0.0


@pytest.mark.parametrize(
    ("package", "name"),
    [
        ("mujoco", "MuJoCo chain, 20 links"),
        ("elastica", "PyElastica loop, 20 elements"),
        ("gym_softrobot", "gym-softrobot"),
        ("envpool", "CartPole, EnvPool, batch of 1024"),
    ],
)
def test_peers_without_their_package_are_absent_with_the_reason(
    monkeypatch: pytest.MonkeyPatch, package: str, name: str
) -> None:
    monkeypatch.setattr(catalogue, "OURS", {})
    monkeypatch.setitem(sys.modules, package, None)
    ready = catalogue.prepare([name], 0.01, lambda: None)
    assert ready.measures == {}
    assert package in ready.absent[name]


def test_the_command_measures_reports_and_writes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mujoco", None)
    figures, page = tmp_path / "figures.json", tmp_path / "page.md"
    page.write_text("before\n<!-- measured -->\nof an earlier run\n<!-- end -->\nafter\n")
    options = ["--only", "odeint", "--only", "20 links", "--repeats", "2", "--seconds", "0.01"]
    result = CliRunner().invoke(app, ["peers", *options, "--json", str(figures), "--page", str(page)])
    assert result.exit_code == 0, result.output
    written = json.loads(figures.read_text())
    assert list(written["peers"]) == [*catalogue.OURS, "SciPy odeint and root"]
    assert list(written["absent"]) == ["MuJoCo chain, 20 links"]
    text = page.read_text()
    assert text.startswith("before\n<!-- measured -->\n\n| ")
    assert text.endswith("\n<!-- end -->\nafter\n")
    assert "of an earlier run" not in text
    assert "| SciPy odeint and root |" in text
    assert "| MuJoCo chain, 20 links | absent |" in text


def test_unknown_peers_are_refused() -> None:
    result = CliRunner().invoke(app, ["peers", "--only", "abacus"])
    assert result.exit_code == 2
    assert "abacus" in result.output


def test_a_page_without_marks_is_refused(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("no marks")
    rate = {"steps_per_second": Summary.of([1.0])}
    with pytest.raises(ValueError, match="no marks"):
        table.write_page(page, {}, {catalogue.BATCH: rate, catalogue.ONE: rate}, {}, {})
