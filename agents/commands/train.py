"""The command that trains."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from agents.commands.errors import errors_in_words
from agents.experiments.config import ExperimentConfig, load_config, parse_config
from agents.experiments.runs import RunFolder

INTERRUPTED = 130

console = Console()


def train(
    config: Annotated[Path, typer.Argument(help="YAML file that describes the experiment.")],
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
        experiment = _overridden(load_config(config), name=name, total_steps=total_steps, seed=seed)
        _run(experiment, RunFolder(runs_dir / experiment.name), resume=resume, force=force)


def _overridden(config: ExperimentConfig, **changes: str | int | None) -> ExperimentConfig:
    given = {entry: value for entry, value in changes.items() if value is not None}
    return parse_config(config.model_dump() | given, source="command line")


def _run(config: ExperimentConfig, run: RunFolder, *, resume: bool, force: bool) -> None:
    from agents.experiments import training  # loaded here because it loads torch, which --help does without

    console.print(
        f"[bold]{config.name}[/bold]: {config.algorithm} on {config.environment.id}, "
        f"{config.num_envs} environments, {config.total_steps:,} steps, seed {config.seed}"
    )
    try:
        with _termination_as_interruption():
            steps = training.train(config, run, resume=resume, replace=force)
    except KeyboardInterrupt as error:
        console.print(f"Interrupted; {run.path} can be continued with --resume.", style="yellow", soft_wrap=True)
        raise typer.Exit(code=INTERRUPTED) from error
    console.print(f"Trained for {steps:,} steps. Evaluate with: python -m agents.evaluate {run.path}", soft_wrap=True)


@contextmanager
def _termination_as_interruption() -> Iterator[None]:
    """Let a request to terminate end the training as one from the keyboard does: with a snapshot."""
    earlier = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, earlier)
