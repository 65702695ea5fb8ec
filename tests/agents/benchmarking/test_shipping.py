"""What is shipped is chosen by episodes of the training's part, and what its card says is seen again by anybody."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pcm_gym
from agents.benchmarking.cells import ResultsFolder
from agents.benchmarking.config import BenchmarkConfig
from agents.benchmarking.processes import run_cells
from agents.benchmarking.shipping import ship
from agents.benchmarking.work import Asked
from agents.commands.evaluate import evaluate
from agents.learners.settings import UsageError
from pcm_gym.policies import Policy
from pcm_gym.policies.shipped import KINDS, PolicyKey

ID = "PCM/2RFR-Reach-v0"
EPISODES = 6


def benchmark_in(folder: Path) -> BenchmarkConfig:
    content: dict[str, Any] = {"environments": [ID], "tiers": ["near"], "references": [], "seeds": [0, 10_000]}
    return BenchmarkConfig(name="x", folder=folder / "results", learners={"ppo": 300}, episodes=EPISODES, **content)


def test_the_best_the_safest_and_the_smallest_of_a_benchmark_become_policies(tmp_path: Path) -> None:
    benchmark, runs, shipped = benchmark_in(tmp_path), tmp_path / "runs", tmp_path / "shipped"
    runs.mkdir()
    results = ResultsFolder(benchmark.folder)
    results.create()
    run_cells(benchmark.cells(), Asked(runs, EPISODES), results, 1, lambda cell, why: None)
    told: list[str] = []
    assert ship(benchmark, runs, shipped, told.append) == len(KINDS) == len(told)
    names = {PolicyKey(ID, "near", kind).file_name for kind in KINDS}
    assert {path.name for path in shipped.iterdir()} == names
    for name in names:
        card = Policy.load(shipped / name).card
        assert card["environment"] == {"id": ID, "kwargs": {"split": "train", "difficulty": "near"}}
        assert card["evaluation"]["summaries"][0]["episodes"] == EPISODES
        evaluate(shipped / name)  # ends with exit code 1 where the scores are not those of the card


def test_where_nothing_was_trained_nothing_is_shipped(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="no agent of benchmark 'x' has been trained there"):
        ship(benchmark_in(tmp_path), tmp_path / "runs", tmp_path / "shipped", print)


def test_the_size_of_a_policy_is_the_count_of_its_numbers() -> None:
    for key in pcm_gym.shipped_policies():
        with np.load(Path(pcm_gym.policies.shipped.FOLDER) / key.file_name, allow_pickle=False) as archive:
            numbers = sum(archive[name].size for name in archive.files if name.startswith(("weights_", "bias_")))
        assert pcm_gym.load_policy(*key).size == numbers
