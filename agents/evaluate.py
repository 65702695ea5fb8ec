"""Command line of the evaluation: ``python -m agents.evaluate RUN_OR_MODEL``."""

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from agents.config import ConfigError, ExperimentConfig, load_config, parse_config
from agents.runs import RunError, TrainedFiles, find_trained

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
    """Judge a trained agent on held-out goals, beside a random policy and a resolved-rate controller.

    Writes evaluation.json, episodes.csv and report.html next to the model.
    """
    try:
        files = find_trained(trained)
        config = _overridden(load_config(files.config), episodes=episodes, seed=seed)
    except (ConfigError, RunError) as error:
        console.print(str(error), style="red", markup=False, soft_wrap=True)
        raise typer.Exit(code=1) from error
    _run(config, files, is_deterministic=deterministic, wants_report=report)


def _overridden(config: ExperimentConfig, **changes: int | None) -> ExperimentConfig:
    given = {entry: value for entry, value in changes.items() if value is not None}
    content = config.model_dump()
    return parse_config(content | {"evaluation": content["evaluation"] | given}, source="command line")


def _run(config: ExperimentConfig, files: TrainedFiles, *, is_deterministic: bool, wants_report: bool) -> None:
    # Loaded here because they load torch, which --help does without.
    import torch

    from agents import evaluation
    from agents.controllers import load_trained
    from agents.report import write_report
    from agents.rollouts import make_envs

    torch.set_num_threads(config.torch_threads)
    controller = load_trained(files, config, is_deterministic=is_deterministic)
    envs = make_envs(config.environment, min(config.evaluation.episodes, evaluation.SIDE_BY_SIDE))
    outcome = evaluation.evaluate(config, controller, envs, console)
    evaluation.write_evaluation(outcome, files.folder)
    console.print(evaluation.results_table(outcome.summaries))
    console.print(evaluation.verdict(outcome))
    if wants_report:
        path = write_report(config, outcome, controller, envs, files)
        console.print(f"Report: {path}", soft_wrap=True)


if __name__ == "__main__":
    typer.run(evaluate)
