"""Charts of the report, as SVG to stand inside an HTML page."""

import io
from collections.abc import Sequence
from itertools import cycle
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from agents.evaluation.episodes import EpisodeResult
from agents.evaluation.estimates import Interval
from agents.evaluation.summaries import PolicySummary
from agents.evaluation.tables import MM_PER_M
from agents.learners import progress

COLOURS = ("#1d4ed8", "#6b7280", "#b45309", "#7c3aed")
RED = "#dc2626"
LEAST_ERROR_MM = 1e-3
STYLE: Any = {
    "svg.fonttype": "none",
    "svg.hashsalt": "agents",
    "font.size": 9.5,
    "font.family": "sans-serif",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": "#9ca3af",
    "axes.labelcolor": "#374151",
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#e5e7eb",
    "xtick.color": "#4b5563",
    "ytick.color": "#4b5563",
    "legend.frameon": False,
}
RATES = (
    (progress.SAFE_SUCCESS_COLUMN, "safe success", COLOURS[0], "-"),
    (progress.SUCCESS_COLUMN, "success", COLOURS[0], ":"),
    (progress.VIOLATION_COLUMN, "stability lost", RED, "-"),
)


def learning_curve(rows: Sequence[dict[str, float]]) -> str:
    """SVG of the rates of success and violation, and of the cost of an episode, over the steps of the training."""
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(8.4, 3.0), layout="constrained")
        rates, cost = figure.subplots(1, 2, width_ratios=(1.6, 1.0))
        for column, label, colour, line in RATES:
            _plot_column(rates, rows, column, 100.0, label=label, color=colour, linestyle=line)
        rates.set(xlabel="steps (millions)", ylabel="episodes (%)", ylim=(-2, 102))
        rates.legend(loc="center right")
        _plot_column(cost, rows, progress.EPISODE_COST_COLUMN, 1.0, color=RED)
        cost.set(xlabel="steps (millions)", ylabel="cost per episode")
        cost.set_ylim(bottom=0.0)
        return _svg(figure)


def outcomes(summaries: Sequence[PolicySummary], results: Sequence[EpisodeResult], success_distance: float) -> str:
    """SVG of each policy's safe success with its interval, and of the distribution of its final errors."""
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(8.4, 2.8), layout="constrained")
        rates, errors = figure.subplots(1, 2, width_ratios=(1.0, 1.4))
        _draw_rates(rates, summaries)
        for summary, colour in zip(summaries, cycle(COLOURS), strict=False):
            own = [result.final_error for result in results if result.policy == summary.policy]
            shown = np.maximum(MM_PER_M * np.array(own), LEAST_ERROR_MM)
            errors.ecdf(shown, label=summary.policy, color=colour, linewidth=1.6)
        errors.axvline(MM_PER_M * success_distance, color="#111827", linestyle="--", linewidth=1.0)
        errors.set(xscale="log", xlabel="final error (mm); dashed: within it a goal counts as reached")
        errors.set_ylabel("share of episodes")
        errors.legend(loc="center left", bbox_to_anchor=(0.05, 0.5))
        return _svg(figure)


def _draw_rates(axes: Axes, summaries: Sequence[PolicySummary]) -> None:
    for place, (summary, colour) in enumerate(zip(summaries, cycle(COLOURS), strict=False)):
        rate = summary.safe_success_rate
        axes.barh(place, 100.0 * rate.estimate, height=0.55, color=colour, alpha=0.85)
        axes.errorbar(100.0 * rate.estimate, place, xerr=_arms(rate), color="#111827", capsize=4, linewidth=1.2)
    axes.set_yticks(range(len(summaries)), [summary.policy for summary in summaries])
    axes.set(xlim=(0, 102), xlabel="safe success (%), 95 % interval")
    axes.invert_yaxis()
    axes.grid(visible=False, axis="y")


def _arms(rate: Interval) -> list[list[float]]:
    return [[max(0.0, 100.0 * (rate.estimate - rate.low))], [max(0.0, 100.0 * (rate.high - rate.estimate))]]


def _plot_column(axes: Axes, rows: Sequence[dict[str, float]], column: str, scale: float, **style: Any) -> None:
    known = [row for row in rows if column in row and progress.STEPS_COLUMN in row]
    steps = np.array([row[progress.STEPS_COLUMN] for row in known]) / 1e6
    axes.plot(steps, scale * np.array([row[column] for row in known]), linewidth=1.6, **style)


def _svg(figure: Figure) -> str:
    text = io.StringIO()
    figure.savefig(text, format="svg", transparent=True, metadata=dict.fromkeys(("Date", "Creator", "Format", "Type")))
    svg = text.getvalue()
    return svg[svg.index("<svg") :]
