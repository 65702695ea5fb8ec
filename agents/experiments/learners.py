"""Experiments without a file of their own: an environment by its id, a learner by its name."""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from agents.experiments.config import ExperimentConfig, parse_config, read_yaml
from agents.learners.settings import ConfigError

# One file for each learner: an experiment's configuration without name and environment.
FOLDER = Path(__file__).parents[2] / "configs" / "learners"
ENDING = ".yaml"

_ID = re.compile(r"^([\w.]+:)?([\w-]+/)?[\w.-]+-v\d+$")


def is_environment_id(text: str) -> bool:
    """Whether it is written like an environment's id, as "PCM/2RFR-Reach-v0", and not like a file's name."""
    return _ID.match(text) is not None


def learner_names() -> list[str]:
    """Names of the learners there are."""
    return sorted(path.stem for path in FOLDER.glob(f"*{ENDING}"))


def experiment_of(environment_id: str, arguments: Mapping[str, Any], learner: str) -> ExperimentConfig:
    """Experiment in which a learner learns an environment; it is named after both.

    Raises
    ------
    ConfigError
        If there is no such learner, the message lists those there are, or its file is broken.
    """
    path = FOLDER / f"{learner}{ENDING}"
    if learner not in learner_names():
        raise ConfigError(f"learner {learner!r}: there is none of that name; there are {', '.join(learner_names())}")
    content = read_yaml(path)
    if not isinstance(content, dict):
        raise ConfigError(f"{path}: must have entries by name")
    parts = [environment_id.rpartition(":")[2].rpartition("/")[2], *map(str, arguments.values()), learner]
    own = {
        "name": re.sub(r"[^A-Za-z0-9._-]+", "_", "-".join(parts)),
        "environment": {"id": environment_id, "kwargs": dict(arguments)},
    }
    return parse_config({**content, **own}, source=str(path))
