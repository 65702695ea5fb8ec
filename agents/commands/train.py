"""The command that trains."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console

from agents.commands.errors import errors_from, errors_in_words, warn_of_foreign
from agents.commands.signals import INTERRUPTED, termination_as_interruption
from agents.experiments.config import ExperimentConfig, load_config, parse_config, parse_yaml
from agents.experiments.learners import experiment_of, is_environment_id
from agents.experiments.runs import RunFolder
from agents.learners.files import PICKLES
from agents.learners.settings import ConfigError

DEFAULT_LEARNER = "ppo"

console = Console()


def train(
    experiment: Annotated[
        str,
        typer.Argument(metavar="CONFIG_OR_ID", help="YAML file that describes the experiment, or an environment's id."),
    ],
    learner: Annotated[
        str | None, typer.Option(help=f"For an id: one of configs/learners, {DEFAULT_LEARNER} by default.")
    ] = None,
    arguments: Annotated[
        list[str] | None,
        typer.Option("--with", metavar="NAME=VALUE", help="For an id: an argument that the environment is made with."),
    ] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Continue the run from its newest checkpoint.")] = False,
    force: Annotated[bool, typer.Option("--force", help="Delete an earlier run of the same name.")] = False,
    runs_dir: Annotated[Path, typer.Option(help="Folder that holds the runs.")] = Path("runs"),
    name: Annotated[str | None, typer.Option(help="Name of the run, in place of the configuration's.")] = None,
    total_steps: Annotated[int | None, typer.Option(help="Steps in place of the configuration's.")] = None,
    seed: Annotated[int | None, typer.Option(help="Seed in place of the configuration's.")] = None,
) -> None:
    """Train an agent and keep everything about it in RUNS_DIR/NAME."""
    if resume and force:
        raise typer.BadParameter("--resume and --force exclude each other")
    with errors_in_words(console):
        config = _overridden(
            _described(experiment, learner, arguments or []), name=name, total_steps=total_steps, seed=seed
        )
        with errors_from(experiment):
            _run(config, RunFolder(runs_dir / config.name), resume=resume, force=force)


def _described(experiment: str, learner: str | None, arguments: Sequence[str]) -> ExperimentConfig:
    if is_environment_id(experiment) and not Path(experiment).exists():
        return experiment_of(experiment, dict(map(_argument, arguments)), learner or DEFAULT_LEARNER)
    if learner is not None or arguments:
        raise ConfigError(f"{experiment}: --learner and --with belong to an environment's id; a file says them itself")
    return load_config(Path(experiment))


def _argument(text: str) -> tuple[str, Any]:
    name, sign, value = text.partition("=")
    if not (name and sign):
        raise ConfigError(f"--with {text}: an argument of the environment is written NAME=VALUE")
    return name, parse_yaml(value, source=f"--with {text}")


def _overridden(config: ExperimentConfig, **changes: str | int | None) -> ExperimentConfig:
    given = {entry: value for entry, value in changes.items() if value is not None}
    return parse_config(config.model_dump() | given, source="command line")


def _run(config: ExperimentConfig, run: RunFolder, *, resume: bool, force: bool) -> None:
    from agents.experiments import training  # loaded here because it loads torch, which --help does without

    console.print(
        f"[bold]{config.name}[/bold]: {config.algorithm} on {config.environment.id}, "
        f"{config.num_envs} environments, {config.total_steps:,} steps, seed {config.seed}"
    )
    if resume:
        warn_of_foreign(console, (snapshot / name for snapshot in run.snapshots()[-1:] for name in PICKLES))
    try:
        with termination_as_interruption():
            steps = training.train(config, run, resume=resume, replace=force)
    except KeyboardInterrupt as error:
        console.print(f"Interrupted; {run.path} can be continued with --resume.", style="yellow", soft_wrap=True)
        raise typer.Exit(code=INTERRUPTED) from error
    console.print(f"Trained for {steps:,} steps. Evaluate with: python -m agents.evaluate {run.path}", soft_wrap=True)
