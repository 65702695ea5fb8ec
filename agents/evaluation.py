"""Evaluation with the exact solver in the loop, on goals that no training has seen."""

import csv
import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.markup import escape
from rich.progress import track
from rich.table import Table

from agents.config import ExperimentConfig
from agents.controllers import RandomController, ResolvedRateController, TrainedController
from agents.estimates import Interval, percentile_interval, wilson_interval
from agents.rollouts import Controller, EpisodeResult, SingleEnv, run_episodes

MM_PER_M = 1e3
SIDE_BY_SIDE = 100


@dataclass(frozen=True)
class PolicySummary:
    """What a policy's episodes came to, all together; rates and medians with 95 % intervals.

    Attributes
    ----------
    policy, episodes
        Who acted, and how often.
    success_rate, safe_success_rate, violation_rate, solver_failure_rate
        See the attributes of the same names of `EpisodeResult`. A failure of the solver is not a violation.
    median_final_error, high_final_error
        Median and 95th percentile.
    median_stability_margin, smallest_stability_margin
        Median and smallest of the episodes' smallest margins.
    smallest_singularity_margin
        Smallest of all.
    mean_cost, longest_cost_run, mean_reward, mean_length
        Per episode; the longest run of steps with a cost is that of all episodes.
    """

    policy: str
    episodes: int
    success_rate: Interval
    safe_success_rate: Interval
    violation_rate: Interval
    solver_failure_rate: Interval
    median_final_error: Interval
    high_final_error: Interval
    median_stability_margin: float
    smallest_stability_margin: float
    smallest_singularity_margin: float
    mean_cost: float
    longest_cost_run: int
    mean_reward: float
    mean_length: float


@dataclass(frozen=True)
class Evaluation:
    """All policies on the same episodes.

    Attributes
    ----------
    environment, seed
        Episode `i` was ``reset(seed=seed + i)`` of this environment.
    training_steps
        Steps the trained policy had learnt for.
    is_deterministic
        Whether it acted without exploring.
    summaries
        One per policy, the trained one first.
    results
        Every episode of every policy.
    """

    environment: str
    seed: int
    training_steps: int
    is_deterministic: bool
    summaries: tuple[PolicySummary, ...]
    results: tuple[EpisodeResult, ...]


def evaluate(
    config: ExperimentConfig, trained: TrainedController, envs: Sequence[SingleEnv], console: Console
) -> Evaluation:
    """Run the trained, the random and the resolved-rate policy on the experiment's held-out episodes.

    Parameters
    ----------
    config
        Says how many episodes there are, and from which seed on.
    trained
        The policy to judge.
    envs
        Environments to use; as many episodes run side by side.
    console
        Shows the progress.
    """
    seeds = [config.evaluation.seed + episode for episode in range(config.evaluation.episodes)]
    controllers: tuple[Controller, ...] = (trained, RandomController(), ResolvedRateController())
    results = {
        controller.name: tuple(
            track(run_episodes(envs, controller, seeds), controller.name, total=len(seeds), console=console)
        )
        for controller in controllers
    }
    return Evaluation(
        environment=config.environment.id,
        seed=config.evaluation.seed,
        training_steps=trained.training_steps,
        is_deterministic=trained.is_deterministic,
        summaries=tuple(summarise(episodes) for episodes in results.values()),
        results=tuple(episode for episodes in results.values() for episode in episodes),
    )


def summarise(results: Sequence[EpisodeResult]) -> PolicySummary:
    """Summary of the episodes, at least one, of one policy."""
    count = len(results)
    errors = [result.final_error for result in results]
    return PolicySummary(
        policy=results[0].policy,
        episodes=count,
        success_rate=wilson_interval(sum(result.is_success for result in results), count),
        safe_success_rate=wilson_interval(sum(result.is_safe_success for result in results), count),
        violation_rate=wilson_interval(sum(result.is_violation for result in results), count),
        solver_failure_rate=wilson_interval(sum(result.is_solver_failure for result in results), count),
        median_final_error=percentile_interval(errors, 50),
        high_final_error=percentile_interval(errors, 95),
        median_stability_margin=float(np.nanmedian([result.smallest_stability_margin for result in results])),
        smallest_stability_margin=float(np.fmin.reduce([result.smallest_stability_margin for result in results])),
        smallest_singularity_margin=float(np.fmin.reduce([result.smallest_singularity_margin for result in results])),
        mean_cost=float(np.mean([result.cost for result in results])),
        longest_cost_run=max(result.longest_cost_run for result in results),
        mean_reward=float(np.mean([result.total_reward for result in results])),
        mean_length=float(np.mean([result.length for result in results])),
    )


def write_evaluation(evaluation: Evaluation, folder: Path) -> None:
    """Write ``evaluation.json`` (the summaries) and ``episodes.csv`` (every episode) into the folder."""
    content = {entry.name: getattr(evaluation, entry.name) for entry in fields(evaluation) if entry.name != "results"}
    content["summaries"] = [asdict(summary) for summary in evaluation.summaries]
    (folder / "evaluation.json").write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
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
    """One sentence: the trained policy's safe success, and how far above the random policy's it is."""
    rate = {summary.policy: 100.0 * summary.safe_success_rate.estimate for summary in evaluation.summaries}
    trained, baseline = rate[TrainedController.name], rate[RandomController.name]
    return f"Safe success of the trained policy: {trained:.1f} %, {trained - baseline:.1f} points above random."


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
