"""Steps per second of a native batch alone, with a policy's inference, and with learning, beside another loop.

Both loops are PPO with equal networks and equal updates: the project's, and that of Stable-Baselines3 itself.
"""

import time
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import stable_baselines3
import torch
from rich.console import Console
from rich.table import Table
from stable_baselines3.common.base_class import BaseAlgorithm

from agents.experiments.config import parse_config
from agents.learners.fast_ppo import FastPPO
from agents.learners.learner import new_learner
from benchmarks.timing import Measure, Summary

LOOPS: dict[str, type[BaseAlgorithm]] = {"pcm_gym": FastPPO, "Stable-Baselines3": stable_baselines3.PPO}
COLUMNS = ("step", "with inference", "with learning")
# After so many steps the episodes of a batch no longer end all at once.
_STEPS_BEFORE = 128
HYPERPARAMETERS: dict[str, Any] = {
    "n_steps": 16,
    "n_epochs": 3,
    "learning_rate": 1.5e-3,
    "gamma": 0.95,
    "gae_lambda": 0.9,
}


def make_loops(environment_id: str, num_envs: int, activation: str, rollouts: int) -> dict[str, Measure]:
    """Return a measure of each loop: its three rates, by the clock and by the processor's seconds.

    Learning has begun before: episodes no longer end all at once.
    """
    policy = {"features_extractor_class": "goal_error", "net_arch": [64, 64], "activation_fn": activation}
    config = parse_config(
        {
            "name": "benchmark",
            "environment": {"id": environment_id},
            "num_envs": num_envs,
            "total_steps": 1,
            "hyperparameters": {**HYPERPARAMETERS, "batch_size": num_envs, "policy_kwargs": policy},
            "evaluation": {"seed": num_envs},
        }
    )
    torch.set_num_threads(1)
    return {name: _measure(new_learner(config, kind), rollouts) for name, kind in LOOPS.items()}


def print_training(console: Console, found: Mapping[str, Mapping[str, Summary]]) -> None:
    """Print the medians; the ratio is that of learning, by the processor, to the loop named last."""
    table = Table(title="PPO: steps per second by the clock, and per second of the processor", title_justify="left")
    table.add_column("", no_wrap=True)
    for heading in [*(name for column in COLUMNS for name in (column, "CPU")), "ratio"]:
        table.add_column(heading, justify="right", no_wrap=True)
    of_last = found[[*found][-1]][f"{COLUMNS[-1]}, CPU"].median
    for name, figures in found.items():
        cells = [f"{figures[own].median:,.0f}" for column in COLUMNS for own in (column, f"{column}, CPU")]
        table.add_row(name, *cells, f"{figures[f'{COLUMNS[-1]}, CPU'].median / of_last:.2f}")
    console.print(table)


def _measure(learner: Any, rollouts: int) -> Measure:
    count = HYPERPARAMETERS["n_steps"]
    steps = rollouts * count * learner.n_envs
    batch = learner.get_env().unwrapped.batch
    generator = np.random.default_rng(0)
    actions = generator.uniform(-1.0, 1.0, (count, *batch.action_space.shape)).astype(np.float32)
    callback = learner._init_callback(None)

    def step() -> None:
        for own in actions:
            batch.step(own)

    def collect() -> None:
        learner.collect_rollouts(learner.get_env(), callback, learner.rollout_buffer, count)

    def learn() -> None:
        collect()
        learner.train()

    def measure() -> dict[str, float]:
        found: dict[str, float] = {}
        for column, act in zip(COLUMNS, (step, collect, learn), strict=True):
            found[column], found[f"{column}, CPU"] = _rates(act, rollouts, steps)
        return found

    learner.learn(_STEPS_BEFORE * learner.n_envs, log_interval=None)
    return measure


def _rates(act: Callable[[], None], repeats: int, steps: int) -> tuple[float, float]:
    """Return steps per second, by the clock and by the processor."""
    clock, processor = time.perf_counter(), time.process_time()
    for _ in range(repeats):
        act()
    return steps / (time.perf_counter() - clock), steps / (time.process_time() - processor)
