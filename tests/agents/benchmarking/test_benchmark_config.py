"""A benchmark's file is read as written, or refused in words that say what is allowed."""

from pathlib import Path
from typing import Any

import pytest
import yaml

import pcm_gym
from agents.benchmarking.config import load_benchmark
from agents.learners.settings import ConfigError

CONFIGS = Path(__file__).parents[3] / "configs"
SMALLEST: dict[str, Any] = {"name": "x", "folder": "results", "seeds": [0], "learners": {"ppo": 10}}


def write(folder: Path, **changes: Any) -> Path:
    path = folder / "x.yaml"
    path.write_text(yaml.safe_dump(SMALLEST | changes))
    return path


def test_the_benchmark_of_the_project_has_every_id_tier_controller_and_seed_once() -> None:
    config = load_benchmark(CONFIGS / "benchmark.yaml")
    cells = config.cells()
    tiers = {(cell.tier.id, cell.tier.name) for cell in cells}
    assert {name for name, _ in tiers} == set(pcm_gym.environment_ids())
    assert len(config.seeds) >= 5
    assert len(cells) == len(tiers) * (len(config.references) + len(config.learners) * len(config.seeds))
    assert len({cell.name for cell in cells}) == len(cells)


def test_the_small_benchmark_is_one_tier_with_two_seeds() -> None:
    cells = load_benchmark(CONFIGS / "benchmark_small.yaml").cells()
    assert [(cell.learner, cell.seed) for cell in cells] == [("planner", 0), ("ppo", 0), ("ppo", 10_000)]
    assert all(cell.tier.arguments["split"] == "train" for cell in cells)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"environments": ["PCM/4RFR-Reach-v0"]}, ("environments", "'PCM/2RFR-Reach-v0'")),
        ({"tiers": ["hard"]}, ("tiers", "'near'", "'rig'")),
        ({"references": ["oracle"]}, ("references", "'planner'")),
        ({"learners": {"dqn": 10}}, ("learners.dqn", "'ppo'", "'sac_her'")),
        ({"learners": {"ppo": 0}}, ("learners.ppo", "greater than or equal to 1")),
        ({"environments": ["PCM/2RFR-Track-v0"], "tiers": ["detour"]}, ("none of the environments", "detour")),
        ({"learners": {}, "references": []}, ("nobody is left to act",)),
        ({"seeds": [1, 1]}, ("seeds: something is named more than once",)),
        ({"seeds": []}, ("seeds", "at least 1 item")),
        ({"episods": 3}, ("episods: Extra inputs are not permitted",)),
    ],
)
def test_what_cannot_be_run_is_refused_in_words(
    tmp_path: Path, changes: dict[str, Any], words: tuple[str, ...]
) -> None:
    with pytest.raises(ConfigError) as refused:
        load_benchmark(write(tmp_path, **changes))
    for word in ("x.yaml", *words):
        assert word in str(refused.value)
