"""One training run from its configuration to its model."""

import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import CallbackList
from stable_baselines3.common.logger import CSVOutputFormat, KVWriter, Logger, TensorBoardOutputFormat

from agents.experiments.config import ExperimentConfig, load_config, save_config
from agents.experiments.runs import RunError, RunFolder
from agents.learners.callbacks import EpisodeStatistics, ProgressDisplay, Snapshots
from agents.learners.learner import learning_callbacks, load_learner, new_learner, save_learner
from agents.learners.progress import COST_COLUMN, STEPS_COLUMN, read_progress

RESUMABLE_CHANGES = frozenset({"total_steps", "checkpoint_every", "torch_threads", "evaluation"})


def train(config: ExperimentConfig, run: RunFolder, *, resume: bool = False, replace: bool = False) -> int:
    """Train until the experiment's number of steps is reached; return the number of steps done.

    An interruption (`KeyboardInterrupt`) leaves a snapshot behind that `resume` continues from.

    Parameters
    ----------
    config
        The experiment.
    run
        Where everything is kept.
    resume
        Continue from the newest snapshot in the folder.
    replace
        Delete an earlier run in the folder.

    Raises
    ------
    RunError
        If the folder holds a run and neither flag is given, or there is nothing to resume, or the experiment is
        another than the one to resume.
    ConfigError
        If a hyperparameter is unknown to the algorithm.
    KeyboardInterrupt
        Passed on, after the snapshot.
    """
    torch.set_num_threads(config.torch_threads)
    learner = _resumed(config, run) if resume else _started(config, run, replace=replace)
    save_config(config, run.config)
    run.write_versions()
    if learner.num_timesteps < config.total_steps:
        _learn(learner, config, run)
    return learner.num_timesteps


def _started(config: ExperimentConfig, run: RunFolder, *, replace: bool) -> BaseAlgorithm:
    learner = new_learner(config)
    run.create(replace=replace)
    return learner


def _resumed(config: ExperimentConfig, run: RunFolder) -> BaseAlgorithm:
    snapshots = run.snapshots()
    if not snapshots:
        raise RunError(f"{run.path}: nothing to resume (no complete checkpoint): start it without --resume")
    _check_same_experiment(config, load_config(run.config), run)
    return load_learner(config, snapshots[-1])


def _check_same_experiment(config: ExperimentConfig, earlier: ExperimentConfig, run: RunFolder) -> None:
    ours, theirs = (value.model_dump(exclude=set(RESUMABLE_CHANGES)) for value in (config, earlier))
    changed = [name for name in ours if ours[name] != theirs[name]]
    if changed:
        raise RunError(f"{run.path} holds another experiment; it differs in: {', '.join(changed)}")


def _learn(learner: BaseAlgorithm, config: ExperimentConfig, run: RunFolder) -> None:
    def save() -> None:
        run.add_snapshot(learner.num_timesteps, lambda folder: save_learner(learner, folder))

    history = _history(run, learner.num_timesteps)
    learner.set_logger(_logger(run, history))
    display = ProgressDisplay()
    cost = max((row.get(COST_COLUMN, 0.0) for row in history), default=0.0)
    watching = [EpisodeStatistics(cost), Snapshots(config.checkpoint_every, save), display]
    callbacks = CallbackList([*learning_callbacks(config), *watching])
    remaining = config.total_steps - learner.num_timesteps
    try:
        learner.learn(remaining, callback=callbacks, reset_num_timesteps=learner.num_timesteps == 0)
    except KeyboardInterrupt:
        save()
        raise
    finally:
        display.stop()
        learner.logger.close()
    save()


def _history(run: RunFolder, steps: int) -> list[dict[str, float]]:
    """Rows of the learning curve up to that number of steps; none for a new run."""
    rows = read_progress(run.progress) if run.progress.exists() else []
    return [row for row in rows if row[STEPS_COLUMN] <= steps]


def _logger(run: RunFolder, history: list[dict[str, float]]) -> Logger:
    table = CSVOutputFormat(str(run.progress))
    for row in history:
        table.write(row, {})
    writers: list[KVWriter] = [table, TensorBoardOutputFormat(str(run.tensorboard))]
    return Logger(str(run.path), writers)
