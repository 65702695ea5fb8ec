"""Evaluations as files, as a table and in a sentence."""

import csv
import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, fields
from pathlib import Path

from rich.markup import escape
from rich.table import Table

from agents.evaluation.comparison import Evaluation
from agents.evaluation.episodes import EpisodeResult
from agents.evaluation.estimates import Interval
from agents.evaluation.summaries import PolicySummary
from agents.experiments.runs import EVALUATION

MM_PER_M = 1e3


def write_evaluation(evaluation: Evaluation, folder: Path) -> None:
    """Write ``evaluation.json`` (the summaries) and ``episodes.csv`` (every episode) into the folder."""
    content = {entry.name: getattr(evaluation, entry.name) for entry in fields(evaluation) if entry.name != "results"}
    content["summaries"] = [asdict(summary) for summary in evaluation.summaries]
    (folder / EVALUATION).write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
    _write_table(evaluation.results, folder / "episodes.csv")


def results_table(summaries: Sequence[PolicySummary]) -> Table:
    """Table of the summaries for the terminal: a row per measure, a column per policy."""
    table = Table(title="Held-out episodes, 95 % intervals in brackets", title_justify="left")
    table.add_column("")
    for summary in summaries:
        table.add_column(summary.policy, justify="right")
    for row in table_rows(summaries):
        table.add_row(*(escape(cell.replace(" [", "\n[")) for cell in row))
    return table


def table_rows(summaries: Sequence[PolicySummary]) -> list[list[str]]:
    """Rows of the results: the name of the measure, then its value for each policy."""
    return [[name, *(write(summary) for summary in summaries)] for name, write in MEASURES.items()]


def verdict(evaluation: Evaluation) -> str:
    """One sentence: safe success of the judged controller, and how far above that of the second it is."""
    (judged, rate), *others = (
        (summary.policy, 100.0 * summary.safe_success_rate.estimate) for summary in evaluation.summaries
    )
    sentence = f"Safe success of the {judged} policy: {rate:.1f} %"
    if others:
        second, reference = others[0]
        sentence += f", {rate - reference:.1f} points above {second}"
    return sentence + "."


def percent(interval: Interval) -> str:
    """Write a rate with its interval: ``97.2 % [95.3, 98.3]``."""
    low, high = 100.0 * interval.low, 100.0 * interval.high
    return f"{100.0 * interval.estimate:.1f} % [{low:.1f}, {high:.1f}]"


def millimetres(interval: Interval) -> str:
    """Write a length given in metres in millimetres, with its interval."""
    return f"{MM_PER_M * interval.estimate:.1f} [{MM_PER_M * interval.low:.1f}, {MM_PER_M * interval.high:.1f}]"


MEASURES: dict[str, Callable[[PolicySummary], str]] = {
    "safe success": lambda summary: percent(summary.safe_success_rate),
    "success": lambda summary: percent(summary.success_rate),
    "stability lost": lambda summary: percent(summary.violation_rate),
    "solver failed": lambda summary: percent(summary.solver_failure_rate),
    "final error, median (mm)": lambda summary: millimetres(summary.median_final_error),
    "final error, 95th percentile (mm)": lambda summary: millimetres(summary.high_final_error),
    "stability margin, median of least": lambda summary: f"{summary.median_stability_margin:.3g}",
    "stability margin, least of all": lambda summary: f"{summary.smallest_stability_margin:.3g}",
    "cost per episode": lambda summary: f"{summary.mean_cost:.3g}",
    "steps per episode": lambda summary: f"{summary.mean_length:.1f}",
}


def _write_table(results: Sequence[EpisodeResult], path: Path) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, fieldnames=[entry.name for entry in fields(EpisodeResult)], lineterminator="\n")
        writer.writeheader()
        writer.writerows(asdict(result) for result in results)
