"""One cell: trained as any experiment, judged as any controller."""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from agents.benchmarking.cells import Cell, CellResult
from agents.controllers.table import TRAINED, new_controller
from agents.evaluation.episodes import EpisodeResult
from agents.evaluation.first_successes import FirstSuccesses
from agents.evaluation.rollouts import make_evaluation_batch, run_episodes
from agents.evaluation.summaries import summarise
from agents.experiments import training
from agents.experiments.config import EvaluationConfig, ExperimentConfig, parse_config
from agents.experiments.learners import experiment_of
from agents.experiments.machine import processor, versions
from agents.experiments.runs import RunFolder, find_trained
from agents.learners.files import REPLAY_BUFFER
from agents.learners.policy import LearntPolicy, load_policy
from agents.learners.settings import EnvironmentConfig
from pcm_gym.arrays import Array
from pcm_gym.environments.batch import MechanismVectorEnv
from pcm_gym.references import Controller, View, new_reference

SIDE_BY_SIDE = 250
FIRST_SEED = EvaluationConfig().seed


@dataclass(frozen=True)
class Asked:
    """What is asked for beside the cell.

    Attributes
    ----------
    runs : Path
        Folder of the training runs.
    episodes : int
        Of the evaluation.
    """

    runs: Path
    episodes: int


def result_of(cell: Cell, asked: Asked) -> CellResult:
    """Train what has to be trained, from its newest checkpoint on, and judge it on the test's episodes.

    Raises
    ------
    ConfigError, RunError, ModelError
        If that cannot be done.
    """
    if not cell.total_steps:
        return _judged(cell, new_reference(cell.learner), 0, asked.episodes)
    policy = _learnt(cell, asked)
    return _judged(cell, new_controller(TRAINED, policy), policy.training_steps, asked.episodes)


def _learnt(cell: Cell, asked: Asked) -> LearntPolicy:
    config, run = _experiment(cell, asked.episodes), RunFolder(asked.runs / cell.name)
    training.train(config, run, resume=bool(run.snapshots()))
    files = find_trained(run.snapshots()[-1])  # of the newest one it is certain that it is whole
    (files.folder / REPLAY_BUFFER).unlink(missing_ok=True)  # large, and nobody learns from it any more
    return load_policy(config.algorithm, files.model, files.normalisation)


def _experiment(cell: Cell, episodes: int) -> ExperimentConfig:
    config = experiment_of(cell.tier.id, cell.tier.arguments, cell.learner)
    own = {
        "name": cell.name,
        "seed": cell.seed,
        "total_steps": cell.total_steps,
        "evaluation": {"episodes": episodes, "controllers": [TRAINED]},
    }
    return parse_config(config.model_dump() | own, source=cell.name)


def _judged(cell: Cell, controller: Controller, steps: int, episodes: int) -> CellResult:
    torch.set_num_threads(1)
    environment = EnvironmentConfig(id=cell.tier.id, kwargs=dict(cell.tier.arguments))
    env = make_evaluation_batch(environment, min(episodes, SIDE_BY_SIDE))
    timed, first = _Timed(controller), FirstSuccesses()
    seeds = range(FIRST_SEED, FIRST_SEED + episodes)
    results = sorted(run_episodes(env, cell.learner, timed, seeds, first), key=lambda own: own.episode)
    summary = summarise(results)
    margin = summary.smallest_stability_margin
    return CellResult(
        id=cell.tier.id,
        tier=cell.tier.name,
        learner=cell.learner,
        seed=cell.seed,
        steps=steps,
        episodes=episodes,
        first_seed=FIRST_SEED,
        success=summary.success_rate.estimate,
        safe_success=summary.safe_success_rate.estimate,
        losses_per_1000_steps=1e3 * sum(own.is_violation for own in results) / sum(own.length for own in results),
        final_error=summary.median_final_error.estimate,
        smallest_margin=margin if np.isfinite(margin) else None,
        seconds_per_decision=timed.seconds / timed.decisions,
        steps_to_success=_steps_to_success(results, first, env),
        machine=processor(),
        versions=versions(),
    )


def _steps_to_success(
    results: Sequence[EpisodeResult], first: FirstSuccesses, env: MechanismVectorEnv
) -> tuple[int | None, ...] | None:
    if env.task.period > 1:
        return None
    return tuple(first.steps[own.seed] if own.is_success else None for own in results)


class _Timed:
    """A controller whose time is taken."""

    def __init__(self, controller: Controller) -> None:
        self._controller = controller
        self.seconds = 0.0
        self.decisions = 0

    def act(self, view: View) -> Array:
        """Actions (n, actuators) of the controller."""
        begin = time.perf_counter()
        actions = self._controller.act(view)
        self.seconds += time.perf_counter() - begin
        self.decisions += len(view.rows)
        return actions
