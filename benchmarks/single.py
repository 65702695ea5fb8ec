"""Steps per second of one environment, ours and others'."""

import itertools
import time
from typing import Any

import gymnasium

import pcm_gym
from benchmarks.timing import Measure

PEERS = ("Reacher-v5", "Pendulum-v1")
# Actions are drawn beforehand: drawing one costs as much as a step, and is no part of it.
_ACTION_COUNT, _BLOCK = 4096, 256


def make_all() -> tuple[dict[str, gymnasium.Env[Any, Any]], dict[str, str]]:
    """Return the environments that can be made, ours first, and why the others cannot."""
    environments: dict[str, gymnasium.Env[Any, Any]] = {}
    absent: dict[str, str] = {}
    for environment_id in (*pcm_gym.environment_ids(), *PEERS):
        try:
            environments[environment_id] = gymnasium.make(environment_id)
        except (gymnasium.error.Error, ImportError) as error:
            absent[environment_id] = str(error).splitlines()[0]
    return environments, absent


def throughput(env: gymnasium.Env[Any, Any], seconds: float, block: int = _BLOCK) -> Measure:
    """Return a measure of steps per second with random actions and full info, and of the time of a reset.

    Episodes end as they do, and the resets that follow are timed apart. The clock is read after every `block` steps.
    """
    env.action_space.seed(0)
    actions = itertools.cycle([env.action_space.sample() for _ in range(_ACTION_COUNT)])
    clock = time.perf_counter
    env.reset(seed=0)
    for action in itertools.islice(actions, block):
        *_, terminated, truncated, _ = env.step(action)
        if terminated or truncated:
            env.reset()

    def measure() -> dict[str, float]:
        env.reset(seed=0)
        steps, resets, reset_time = 0, 0, 0.0
        start = now = clock()
        while now - start < seconds:
            for action in itertools.islice(actions, block):
                *_, terminated, truncated, _ = env.step(action)
                if terminated or truncated:
                    before = clock()
                    env.reset()
                    reset_time += clock() - before
                    resets += 1
            steps += block
            now = clock()
        total = now - start
        return {
            "steps_per_second": steps / total,
            "steps_per_second_without_resets": steps / (total - reset_time),
            "reset_microseconds": 1e6 * reset_time / max(resets, 1),
            "steps_per_episode": steps / max(resets, 1),
        }

    return measure
