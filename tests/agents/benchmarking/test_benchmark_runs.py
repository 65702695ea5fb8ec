"""A benchmark that is killed, or of which a part fails, comes to what it comes to otherwise."""

import multiprocessing
import os
import random
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import pytest
import yaml

from agents.benchmarking.cells import Cell, CellResult, ResultsFolder
from agents.benchmarking.config import load_benchmark
from agents.benchmarking.lock import alone
from agents.benchmarking.processes import log_of, run_cells
from agents.benchmarking.work import Asked
from agents.learners.settings import UsageError

EPISODES = 4
BENCHMARK: dict[str, Any] = {
    "name": "x",
    "environments": ["PCM/2RFR-Reach-v0"],
    "tiers": ["near"],
    "references": ["standing still", "resolved rate"],
    "learners": {"ppo": 300},
    "seeds": [0],
    "episodes": EPISODES,
}
INTERRUPTED = 130


def write(folder: Path) -> Path:
    folder.mkdir(exist_ok=True)
    path = folder / "x.yaml"
    path.write_text(yaml.safe_dump(BENCHMARK | {"folder": str(folder / "results")}))
    return path


def start(folder: Path) -> "subprocess.Popen[str]":
    code = [sys.executable, "-m", "agents.benchmark", str(write(folder)), "--runs-dir", str(folder / "runs")]
    return subprocess.Popen(code, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)


def results(folder: Path) -> list[dict[str, Any]]:
    """What the cells came to, times left aside."""
    return [own.model_dump(exclude={"seconds_per_decision"}) for own in ResultsFolder(folder / "results").results()]


def run(cells: list[Cell], folder: Path) -> dict[str, str | None]:
    (folder / "runs").mkdir(exist_ok=True)
    told: dict[str, str | None] = {}
    kept = ResultsFolder(folder / "results")
    kept.create()
    run_cells(cells, Asked(folder / "runs", EPISODES), kept, 1, lambda cell, why: told.update({cell.learner: why}))
    return told


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A benchmark whose training could not begin at first, as something else was in its folder, and was tried again."""
    folder = tmp_path_factory.mktemp("undisturbed")
    cells = load_benchmark(write(folder)).cells()
    (foreign := folder / "runs" / cells[-1].name).mkdir(parents=True)
    (foreign / "thesis.tex").touch()
    told = run(cells[::-1], folder)  # what fails comes first
    assert told == {"ppo": f"{foreign} is not a run (config.yaml is missing), so it is not deleted", **told}
    assert told["standing still"] is told["resolved rate"] is None
    assert [own["learner"] for own in results(folder)] == ["resolved rate", "standing still"]
    assert (folder / "results" / "cells" / f"{cells[-1].name}.failed").read_text().strip() == told["ppo"]
    (foreign / "thesis.tex").unlink()
    assert run(cells[-1:], folder) == {"ppo": None}
    return folder


def test_a_cell_that_fails_says_why_stops_nobody_and_is_tried_again(undisturbed: Path) -> None:
    found = {own.learner: own for own in ResultsFolder(undisturbed / "results").results()}
    assert set(found) == {"standing still", "resolved rate", "ppo"}
    assert not list((undisturbed / "results" / "cells").glob("*.failed"))
    assert found["ppo"].steps >= BENCHMARK["learners"]["ppo"]
    assert found["standing still"].success == 0.0
    assert found["resolved rate"].success > 0.0
    assert isinstance(found["ppo"], CellResult)


def test_a_worker_that_is_killed_costs_its_cell_and_nothing_else(tmp_path: Path) -> None:
    def kill_first() -> None:
        while not (children := multiprocessing.active_children()):
            time.sleep(0.01)
        os.kill(children[0].pid or 0, signal.SIGKILL)

    cells = load_benchmark(write(tmp_path)).cells()[:2]
    threading.Thread(target=kill_first, daemon=True).start()
    told = run(cells, tmp_path)
    assert told["standing still"] == "its process was ended: exit code -9"
    assert told["resolved rate"] is None


def test_two_at_once_are_refused(tmp_path: Path) -> None:
    with alone(tmp_path), pytest.raises(UsageError, match="another process runs this benchmark"), alone(tmp_path):
        pass


@pytest.mark.slow
def test_killed_at_random_moments_it_comes_to_the_same(undisturbed: Path, tmp_path: Path) -> None:
    moments = random.Random(0)
    for _ in range(4):
        process = start(tmp_path)
        try:
            process.communicate(timeout=moments.uniform(2.0, 12.0))
            break  # all is done
        except subprocess.TimeoutExpired:
            process.kill()
            process.communicate()
    process = start(tmp_path)
    output, _ = process.communicate()
    assert process.returncode == 0, output
    assert "3 of 3 cells" in output
    assert results(tmp_path) == results(undisturbed)
    assert len((tmp_path / "results" / "results.csv").read_text().splitlines()) == 4


@pytest.mark.slow
def test_an_interruption_ends_it_with_a_sentence(tmp_path: Path) -> None:
    signal.signal(signal.SIGINT, signal.default_int_handler)  # whoever starts this in the background ignores it
    process = start(tmp_path)
    log = log_of(load_benchmark(write(tmp_path)).cells()[0], Asked(tmp_path / "runs" / "x", EPISODES))
    while not log.exists():  # until then nothing has begun that could be interrupted
        assert process.poll() is None
        time.sleep(0.1)
    process.send_signal(signal.SIGINT)
    output, _ = process.communicate()
    assert process.returncode == INTERRUPTED, output
    assert "Interrupted; the same command goes on." in output
