"""The learning curve on disk: names of its columns, and how it is read."""

import csv
from pathlib import Path

STEPS_COLUMN = "time/total_timesteps"
SUCCESS_COLUMN = "rollout/success_rate"
SAFE_SUCCESS_COLUMN = "rollout/safe_success_rate"
VIOLATION_COLUMN = "rollout/violation_rate"
EPISODE_COST_COLUMN = "rollout/cost_mean"
COST_COLUMN = "rollout/cumulative_cost"


def read_progress(path: Path) -> list[dict[str, float]]:
    """Rows of a learning curve: what was logged, by name; missing entries are left out."""
    with path.open(newline="", encoding="utf-8") as file:
        return [{name: float(text) for name, text in row.items() if text} for row in csv.DictReader(file)]
