"""Table and page say what the files of the cells say, and what is missing."""

import csv
import json
import re
from pathlib import Path
from typing import Any

import pytest

from agents.benchmarking.cells import Cell, CellResult, ResultsFolder
from agents.benchmarking.config import BenchmarkConfig
from agents.benchmarking.page import page
from agents.benchmarking.scores import COLUMNS, rows_of, success_by_path_length
from agents.learners.settings import ConfigError


@pytest.fixture
def config(tmp_path: Path) -> BenchmarkConfig:
    return BenchmarkConfig(
        name="x",
        folder=tmp_path,
        environments=("PCM/2RFR-Reach-v0",),
        tiers=("near", "anywhere"),
        references=("planner",),
        learners={"ppo": 100},
        seeds=(0, 1, 2, 3, 4),
        episodes=4,
    )


@pytest.fixture
def folder(config: BenchmarkConfig) -> ResultsFolder:
    folder = ResultsFolder(config.folder)
    folder.create()
    return folder


def result(cell: Cell, **changes: Any) -> CellResult:
    content: dict[str, Any] = {
        "id": cell.tier.id,
        "tier": cell.tier.name,
        "learner": cell.learner,
        "seed": cell.seed,
        "steps": cell.total_steps,
        "episodes": 4,
        "first_seed": 1_000_000,
        "success": 0.75,
        "safe_success": 0.5,
        "losses_per_1000_steps": 0.0,
        "final_error": 0.002,
        "smallest_margin": None,
        "seconds_per_decision": 1e-5,
        "steps_to_success": (10, 20, 30, None),
        "machine": "some processor",
        "versions": {"python": "3.11"},
    }
    return CellResult(**(content | changes))


def test_spl_is_what_its_definition_gives_by_hand() -> None:
    assert success_by_path_length((10, 40, None, 5), (10, 20, 30, None)) == pytest.approx((1.0 + 0.5 + 0.0) / 3.0)
    assert success_by_path_length((5,), (10,)) == 1.0  # nobody is better than the planner by this measure
    assert success_by_path_length((1, 2), (None, None)) is None
    assert success_by_path_length(None, (1,)) is None


def test_results_are_read_back_as_written_and_are_one_table(config: BenchmarkConfig, folder: ResultsFolder) -> None:
    planner, *_, learner = (cell for cell in config.cells() if cell.tier.name == "near")
    found = [result(planner), result(learner, steps_to_success=(20, 20, None, None))]
    for cell, own in zip((planner, learner), found, strict=True):
        folder.succeed(cell, own)
    assert folder.results() == found
    folder.write_table(COLUMNS, rows_of(folder.results()))
    with folder.table.open(newline="") as file:
        table = list(csv.DictReader(file))
    assert [(row["learner"], row["seed"]) for row in table] == [("planner", "0"), ("ppo", "4")]
    assert [float(row["spl"]) for row in table] == pytest.approx([1.0, (0.5 + 1.0 + 0.0) / 3.0])


def test_a_cell_is_done_again_for_more_steps_or_other_episodes(config: BenchmarkConfig, folder: ResultsFolder) -> None:
    cell = config.cells()[-1]
    assert not folder.is_done(cell, 4)
    folder.succeed(cell, result(cell))
    assert folder.is_done(cell, 4)
    assert not folder.is_done(cell, 5)
    assert not folder.is_done(Cell(cell.tier, cell.learner, cell.seed, 101), 4)


def test_the_page_says_what_is_there_what_is_missing_and_why(config: BenchmarkConfig, folder: ResultsFolder) -> None:
    near = [cell for cell in config.cells() if cell.tier.name == "near"]
    for cell, safe in zip(near[:4], (1.0, 0.1, 0.5, 0.6), strict=True):
        folder.succeed(cell, result(cell, safe_success=safe))
    folder.fail(near[4], "the cat sat\non the keyboard")
    text = page(config, Path("configs/x.yaml"), folder)
    assert "4 of\n12 cells are there" in text
    assert "| PCM/2RFR-Reach-v0 | near | 1/1 | 3/5 |" in text
    assert "| PCM/2RFR-Reach-v0 | anywhere | 0/1 | 0/5 |" in text
    assert f"- {near[4].name}: the cat sat on the keyboard" in text
    # of three values none is cut away at either end: their middle half is all of them
    assert re.search(r"\| ppo \| 1 \| 3 \| 40\.0 \[\d+\.\d, \d+\.\d\] \| 75\.0 \[75\.0, 75\.0\] \|", text)
    assert "| planner | 1 | 1 | 100.0 | 75.0 |" in text
    assert text.index("| planner | 1 | 1 |") < text.index("| ppo | 1 | 3 |")


def test_what_the_page_shows_as_a_result_to_hand_in_is_one(config: BenchmarkConfig, folder: ResultsFolder) -> None:
    text = page(config, Path("configs/x.yaml"), folder)
    example = re.search(r"```json\n(.*?)```", text, re.DOTALL)
    assert example is not None
    (config.folder / "cells" / "theirs.json").write_text(example.group(1))
    assert "| the name of yours | 1 | 1 |" in page(config, Path("configs/x.yaml"), folder)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"success": 1.5}, "success: .* less than or equal to 1"),
        ({"steps_to_success": [1]}, "the whole: steps_to_success must have one entry for each of 4 episodes"),
        ({"final_error": "near"}, "final_error: .* number"),
    ],
)
def test_a_file_that_is_no_result_is_refused_by_its_name(
    config: BenchmarkConfig, folder: ResultsFolder, change: dict[str, Any], words: str
) -> None:
    content = result(config.cells()[0]).model_dump(mode="json") | change
    (config.folder / "cells" / "theirs.json").write_text(json.dumps(content))
    with pytest.raises(ConfigError, match=rf"theirs\.json: {words}"):
        folder.results()
    (config.folder / "cells" / "theirs.json").write_text("{")
    with pytest.raises(ConfigError, match=r"theirs\.json: not valid JSON"):
        folder.results()
