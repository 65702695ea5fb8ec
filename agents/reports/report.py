"""The report of a run: one HTML file that needs nothing but a browser."""

from collections.abc import Mapping
from pathlib import Path

import yaml
from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from agents.controllers.table import remarks
from agents.evaluation.comparison import Evaluation
from agents.evaluation.tables import percent, table_rows, verdict
from agents.experiments.config import ExperimentConfig
from agents.experiments.runs import PROGRESS, TrainedFiles
from agents.learners.progress import read_progress
from agents.reports import charts
from agents.reports.recording import record
from pcm_gym.environments.batch import MechanismVectorEnv
from pcm_gym.references import Controller


def write_report(
    config: ExperimentConfig,
    evaluation: Evaluation,
    controllers: Mapping[str, Controller],
    env: MechanismVectorEnv,
    files: TrainedFiles,
) -> Path:
    """Write ``report.html`` next to the model and return its path.

    Learning curve, player of recorded episodes, results and configuration. The episodes shown are run once more, to
    record them.
    """
    path = files.folder / "report.html"
    success_distance = env.task.goals.success_distance
    content = {
        "config": config,
        "evaluation": evaluation,
        "judged": evaluation.summaries[0],
        "verdict": verdict(evaluation),
        "rows": table_rows(evaluation.summaries),
        "remarks": [remarks()[name] for name in controllers],
        "learning_curve": _learning_curve(files.config.parent / PROGRESS),
        "outcomes": Markup(charts.outcomes(evaluation.summaries, evaluation.results, success_distance)),
        "recording": record(evaluation, controllers, env),
        "configuration": yaml.safe_dump(config.model_dump(mode="json"), sort_keys=False),
    }
    path.write_text(_templates().get_template("report.html").render(content), encoding="utf-8")
    return path


def _templates() -> Environment:
    templates = Environment(
        loader=PackageLoader("agents.reports"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    templates.policies["json.dumps_kwargs"] = {"separators": (",", ":")}
    templates.filters["percent"] = percent
    return templates


def _learning_curve(path: Path) -> Markup | None:
    rows = read_progress(path) if path.exists() else []
    return Markup(charts.learning_curve(rows)) if rows else None
