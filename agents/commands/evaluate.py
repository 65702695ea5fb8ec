"""The command that evaluates."""

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from agents.commands.errors import errors_in_words
from agents.experiments.config import ExperimentConfig, load_config, parse_config
from agents.experiments.runs import TrainedFiles, find_trained

SIDE_BY_SIDE = 100

console = Console()


def evaluate(
    trained: Annotated[
        Path, typer.Argument(metavar="RUN_OR_MODEL", help="Folder of a run or of a checkpoint, or a model.zip.")
    ],
    episodes: Annotated[int | None, typer.Option(help="Episodes in place of the configuration's.")] = None,
    seed: Annotated[int | None, typer.Option(help="Seed of the first episode in place of the configuration's.")] = None,
    deterministic: Annotated[bool, typer.Option(help="Take the policy's mean action, or sample one.")] = True,
    report: Annotated[bool, typer.Option(help="Write report.html as well.")] = True,
) -> None:
    """Judge a trained agent on held-out goals, beside the other controllers of its configuration.

    Writes evaluation.json, episodes.csv and report.html next to the model.
    """
    with errors_in_words(console):
        files = find_trained(trained)
        config = _overridden(load_config(files.config), episodes=episodes, seed=seed)
        _run(config, files, is_deterministic=deterministic, wants_report=report)


def _overridden(config: ExperimentConfig, **changes: int | None) -> ExperimentConfig:
    given = {entry: value for entry, value in changes.items() if value is not None}
    content = config.model_dump()
    return parse_config(content | {"evaluation": content["evaluation"] | given}, source="command line")


def _run(config: ExperimentConfig, files: TrainedFiles, *, is_deterministic: bool, wants_report: bool) -> None:
    # Loaded here because they load torch, which --help does without.
    import torch

    from agents.controllers.table import new_controller
    from agents.evaluation import comparison, tables
    from agents.evaluation.rollouts import make_evaluation_batch
    from agents.learners.policy import load_policy
    from agents.reports.report import write_report

    torch.set_num_threads(config.torch_threads)
    policy = load_policy(config.algorithm, files.model, files.normalisation, is_deterministic=is_deterministic)
    policy.seed(config.evaluation.seed)
    controllers = {name: new_controller(name, policy) for name in config.evaluation.controllers}
    env = make_evaluation_batch(config.environment, min(config.evaluation.episodes, SIDE_BY_SIDE))
    evaluation = comparison.evaluate(config, policy, controllers, env, console)
    tables.write_evaluation(evaluation, files.folder)
    console.print(tables.results_table(evaluation.summaries))
    console.print(tables.verdict(evaluation))
    if wants_report:
        path = write_report(config, evaluation, controllers, env, files)
        console.print(f"Report: {path}", soft_wrap=True)
