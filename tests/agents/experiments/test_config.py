"""A configuration is read as written, or refused with an error that names the entry."""

from pathlib import Path
from typing import Any

import pytest

from agents.experiments.config import EvaluationConfig, load_config, parse_config, save_config
from agents.learners.settings import ConfigError

_FILES = sorted((Path(__file__).parents[3] / "configs").glob("*.yaml"))
CONFIGS = [path for path in _FILES if not path.stem.startswith("benchmark")]  # those are no experiments
SMALLEST: dict[str, Any] = {"name": "x", "environment": {"id": "PCM/2RFR-Reach-v0"}, "total_steps": 10}


@pytest.mark.parametrize("path", CONFIGS, ids=lambda path: path.stem)
def test_every_configuration_of_the_project_is_valid_and_named_after_its_file(path: Path) -> None:
    assert load_config(path).name == path.stem


def test_saved_configuration_reads_back_equal(tmp_path: Path) -> None:
    config = parse_config(SMALLEST | {"hyperparameters": {"learning_rate": {"start": 1e-3, "end": 1e-5}}})
    save_config(config, tmp_path / "config.yaml")
    assert load_config(tmp_path / "config.yaml") == config


def test_usual_controllers_are_in_the_table() -> None:
    usual = EvaluationConfig().controllers
    assert parse_config(SMALLEST | {"evaluation": {"controllers": list(usual)}}).evaluation.controllers == usual


@pytest.mark.parametrize(("text", "value"), [("3e-4", 3e-4), ("1E5", 1e5), ("-2.5e+3", -2.5e3), ("0.5", 0.5)])
def test_numbers_in_scientific_notation_are_numbers(tmp_path: Path, text: str, value: float) -> None:
    path = tmp_path / "x.yaml"
    path.write_text(f"name: x\nenvironment: {{id: E}}\ntotal_steps: 1\nhyperparameters: {{gamma: {text}}}\n")
    assert load_config(path).hyperparameters == {"gamma": value}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"totl_steps": 3}, "totl_steps: Extra inputs are not permitted"),
        ({"algorithm": "PPP"}, "configuration: algorithm: Input should be 'PPO', 'A2C', 'SAC', 'TD3', 'DDPG' or 'TQC'"),
        ({"total_steps": 0}, "total_steps: .* greater than or equal to 1"),
        ({"name": "../x"}, "name: .* match pattern"),
        ({"environment": {"id": "E", "kwarg": {}}}, r"environment\.kwarg: Extra inputs"),
        ({"hindsight": {}}, "hindsight needs a replay buffer, which PPO does not have"),
        ({"algorithm": "SAC", "hindsight": {}, "cost_weight": 1.0}, "cost_weight must be 0"),
        (
            {"evaluation": {"controllers": ["trained", "chance"]}},
            r"evaluation\.controllers\.1: Input should be 'trained', 'standing still', .* or 'planner'",
        ),
        ({"evaluation": {"controllers": ["random", "random"]}}, "controllers: named more than once: random"),
        ({"evaluation": {"controllers": []}}, "controllers: Tuple should have at least 1 item"),
        ({"algorithm": "SAC", "lagrangian": {}}, "lagrangian: rewards in the replay buffer of SAC keep"),
        ({"lagrangian": {}, "cost_weight": 1.0}, "lagrangian chooses the weight of the cost"),
        ({"hyperparameters": {"device": "cpu", "env": 1}}, "set elsewhere in the configuration: device, env"),
        ({"evaluation": {"seed": 10}}, "seeds of the evaluation .* include seeds of the training"),
    ],
)
def test_error_names_the_entry(change: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        parse_config(SMALLEST | change)


def test_every_error_is_listed() -> None:
    with pytest.raises(ConfigError, match=r"2 problems(.|\n)*name(.|\n)*num_envs"):
        parse_config(SMALLEST | {"name": "", "num_envs": -1})


@pytest.mark.parametrize(("content", "message"), [(None, "cannot be read"), ("a: [", "not valid YAML"), ("3", "whole")])
def test_unusable_file_is_an_error_that_names_it(tmp_path: Path, content: str | None, message: str) -> None:
    path = tmp_path / "x.yaml"
    if content is not None:
        path.write_text(content)
    with pytest.raises(ConfigError, match=rf"x\.yaml(.|\n)*{message}"):
        load_config(path)
