"""The command that evaluates."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console

from agents.commands.errors import errors_in_words, warn_of_foreign
from agents.experiments.config import ExperimentConfig, load_config, parse_config
from agents.experiments.runs import TrainedFiles, find_trained

if TYPE_CHECKING:  # they load numba or torch, which --help does without
    from agents.evaluation.comparison import Evaluation
    from agents.learners.exported import ActingPolicy
    from pcm_gym.environments.batch import MechanismVectorEnv
    from pcm_gym.references import Controller

SIDE_BY_SIDE = 100
EXPORTED = ".npz"

console = Console()


def evaluate(
    trained: Annotated[
        Path,
        typer.Argument(
            metavar="RUN_OR_MODEL",
            help="Folder of a run or of a checkpoint, a model.zip, or an exported policy (.npz).",
        ),
    ],
    episodes: Annotated[int | None, typer.Option(help="Episodes in place of the configuration's.")] = None,
    seed: Annotated[int | None, typer.Option(help="Seed of the first episode in place of the configuration's.")] = None,
    deterministic: Annotated[bool, typer.Option(help="Take the policy's mean action, or sample one.")] = True,
    report: Annotated[bool, typer.Option(help="Write report.html as well.")] = True,
) -> None:
    """Judge a trained agent on held-out goals, beside the other controllers of its configuration.

    Writes evaluation.json, episodes.csv and report.html next to the model. Of an exported policy nothing is written: it
    is said whether it comes to what its card says.
    """
    with errors_in_words(console):
        if trained.suffix == EXPORTED:
            _judge_exported(trained, episodes=episodes, seed=seed)
            return
        files = find_trained(trained)
        warn_of_foreign(console, files.pickles)
        config = _overridden(load_config(files.config), episodes=episodes, seed=seed)
        _judge_trained(config, files, is_deterministic=deterministic, wants_report=report)


def _overridden(config: ExperimentConfig, **changes: int | None) -> ExperimentConfig:
    given = {entry: value for entry, value in changes.items() if value is not None}
    content = config.model_dump()
    return parse_config(content | {"evaluation": content["evaluation"] | given}, source="command line")


def _judge_trained(
    config: ExperimentConfig, files: TrainedFiles, *, is_deterministic: bool, wants_report: bool
) -> None:
    # Loaded here because they load torch, which --help does without.
    import torch

    from agents.evaluation import tables
    from agents.learners.policy import load_policy
    from agents.reports.report import write_report

    torch.set_num_threads(config.torch_threads)
    policy = load_policy(config.algorithm, files.model, files.normalisation, is_deterministic=is_deterministic)
    policy.seed(config.evaluation.seed)
    evaluation, controllers, env = _judged(config, policy)
    tables.write_evaluation(evaluation, files.folder)
    _print(evaluation)
    if wants_report:
        path = write_report(config, evaluation, controllers, env, files)
        console.print(f"Report: {path}", soft_wrap=True)


def _judge_exported(path: Path, **changes: int | None) -> None:
    from agents.evaluation.reproduction import reproduction
    from agents.learners.exported import ExportedPolicy

    policy = ExportedPolicy.load(path)
    config = _overridden(parse_config(policy.card.get("experiment"), source=f"{path}, card"), **changes)
    evaluation, _, _ = _judged(config, policy)
    _print(evaluation)
    is_reproduced, sentence = reproduction(evaluation, policy.card)
    console.print(sentence, style="green" if is_reproduced else "red", markup=False, soft_wrap=True)
    if not is_reproduced:
        raise typer.Exit(code=1)


def _judged(
    config: ExperimentConfig, policy: "ActingPolicy"
) -> tuple["Evaluation", dict[str, "Controller"], "MechanismVectorEnv"]:
    from agents.controllers.table import new_controller
    from agents.evaluation import comparison
    from agents.evaluation.rollouts import make_evaluation_batch

    controllers = {name: new_controller(name, policy) for name in config.evaluation.controllers}
    env = make_evaluation_batch(config.environment, min(config.evaluation.episodes, SIDE_BY_SIDE))
    return comparison.evaluate(config, policy, controllers, env, console), controllers, env


def _print(evaluation: "Evaluation") -> None:
    from agents.evaluation import tables

    console.print(tables.results_table(evaluation.summaries))
    console.print(tables.verdict(evaluation))
