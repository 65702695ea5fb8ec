"""The report of a run: one HTML file that needs nothing but a browser."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import yaml
from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from agents import charts
from agents.config import ExperimentConfig
from agents.controllers import TrainedController
from agents.evaluation import Evaluation, percent, table_rows, verdict
from agents.progress import read_progress
from agents.recording import record
from agents.rollouts import SingleEnv
from agents.runs import PROGRESS, TrainedFiles


def write_report(
    config: ExperimentConfig,
    evaluation: Evaluation,
    trained: TrainedController,
    envs: Sequence[SingleEnv],
    files: TrainedFiles,
) -> Path:
    """Write ``report.html`` next to the model and return its path.

    Learning curve, player of recorded episodes, results and configuration. The episodes shown are run once more, to
    record them.
    """
    path = files.folder / "report.html"
    content = {
        "config": config,
        "evaluation": evaluation,
        "trained": evaluation.summaries[0],
        "verdict": verdict(evaluation),
        "rows": table_rows(evaluation.summaries),
        "learning_curve": _learning_curve(files.config.parent / PROGRESS),
        "outcomes": _outcomes(evaluation, envs[0]),
        "recording": record(evaluation, trained, envs),
        "configuration": yaml.safe_dump(config.model_dump(mode="json"), sort_keys=False),
    }
    path.write_text(_templates().get_template("report.html").render(content), encoding="utf-8")
    return path


def _templates() -> Environment:
    templates = Environment(
        loader=PackageLoader("agents"), autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    templates.policies["json.dumps_kwargs"] = {"separators": (",", ":")}
    templates.filters["percent"] = percent
    return templates


def _learning_curve(path: Path) -> Markup | None:
    rows = read_progress(path) if path.exists() else []
    return Markup(charts.learning_curve(rows)) if rows else None


def _outcomes(evaluation: Evaluation, env: SingleEnv) -> Markup:
    inner: Any = env.unwrapped
    return Markup(charts.outcomes(evaluation.summaries, evaluation.results, inner.success_distance))
