"""The learning curve on disk: names of its columns, and how it is read."""

import csv
from pathlib import Path

from agents.learners.settings import ModelError

STEPS_COLUMN = "time/total_timesteps"
SUCCESS_COLUMN = "rollout/success_rate"
SAFE_SUCCESS_COLUMN = "rollout/safe_success_rate"
VIOLATION_COLUMN = "rollout/violation_rate"
EPISODE_COST_COLUMN = "rollout/cost_mean"
COST_COLUMN = "rollout/cumulative_cost"


def read_progress(path: Path) -> list[dict[str, float]]:
    """Rows of a learning curve: what was logged, by name; missing entries are left out.

    Raises
    ------
    ModelError
        If the file is no such table.
    """
    try:
        with path.open(newline="", encoding="utf-8") as file:
            return [{name: float(text) for name, text in row.items() if text} for row in csv.DictReader(file)]
    except (OSError, TypeError, ValueError, csv.Error) as error:
        raise ModelError(f"{path}: cannot be read as a learning curve: {error}") from error
