"""Steps per second of the native batch, where the time of a step goes, and the memory that an environment takes."""

import time
import tracemalloc
import warnings
from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode

from benchmarks.timing import Measure
from pcm_gym.environments.batch import MechanismVectorEnv
from pcm_gym.kernels.lockstep.lanes import step_block
from pcm_gym.kernels.lockstep.layout import LANES, make_block
from pcm_gym.kernels.lockstep.rows import load_lane
from pcm_gym.kernels.lockstep.verdicts import judge_block
from pcm_gym.kernels.numerics.compilation import kernel
from pcm_gym.kernels.numerics.threads import default_thread_count
from pcm_gym.kernels.statics.states import States
from pcm_gym.kernels.stepping.report import Moves, empty_report
from pcm_gym.kernels.stepping.transition import step_alone, step_batch
from pcm_gym.tasks import observation_elements

BATCH_SIZES = (64, 1024)
PEER = "CartPole-v1 (EnvPool)"
_ROWS = 1024
# The two verdicts of a step are too short to be timed once.
_REPEATS = 20
# After so many steps the episodes of a batch no longer end all at once.
_STEPS_BEFORE = 400


def make_batches(environment_ids: Sequence[str], seconds: float) -> tuple[dict[str, Measure], dict[str, str]]:
    """Return measures of our batches, of several sizes and numbers of threads, and of a peer's; why one is absent."""
    thread_counts = sorted({1, default_thread_count()})
    measures, absent = {}, {}
    for threads in thread_counts:
        for name in environment_ids:
            for size in BATCH_SIZES if threads == 1 else BATCH_SIZES[-1:]:
                measures[f"{name} x {size}, threads: {threads}"] = batch_throughput(name, size, threads, seconds)
        try:
            name = f"{PEER} x {BATCH_SIZES[-1]}, threads: {threads}"
            measures[name] = peer_throughput(BATCH_SIZES[-1], threads, seconds)
        except ImportError as error:
            absent[PEER] = str(error)
    return measures, absent


def batch_throughput(environment_id: str, num_envs: int, threads: int, seconds: float) -> Measure:
    """Return a measure of steps per second of a native batch, resets where episodes end, and of the time of a reset."""
    env: Any = gymnasium.make_vec(
        environment_id, num_envs=num_envs, vectorization_mode="vector_entry_point", threads=threads
    )
    generator = np.random.default_rng(0)
    actions = [generator.uniform(-1.0, 1.0, env.action_space.shape).astype(np.float32) for _ in range(20)]
    return _vector_measure(env, actions, num_envs, seconds)


def peer_throughput(num_envs: int, threads: int, seconds: float) -> Measure:
    """Return the same measure of EnvPool's CartPole-v1; raise ImportError where EnvPool is not installed."""
    import envpool

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # about the bounds of its spaces
        env: Any = envpool.make("CartPole-v1", env_type="gymnasium", num_envs=num_envs, num_threads=threads)
    generator = np.random.default_rng(0)
    actions = [generator.integers(0, 2, num_envs).astype(np.int32) for _ in range(20)]
    return _vector_measure(env, actions, num_envs, seconds)


def _vector_measure(env: Any, actions: Sequence[Any], num_envs: int, seconds: float) -> Measure:
    clock = time.perf_counter
    env.reset()
    for n in range(_STEPS_BEFORE):
        env.step(actions[n % len(actions)])

    def measure() -> dict[str, float]:
        steps, start = 0, clock()
        now = start
        while now - start < seconds:
            for action in actions:
                env.step(action)
            steps += len(actions)
            now = clock()
        step_time = (now - start) / steps
        before = clock()
        env.reset()
        reset_time = clock() - before
        for n in range(_STEPS_BEFORE):
            env.step(actions[n % len(actions)])
        return {"steps_per_second": num_envs / step_time, "reset_in_steps": reset_time / step_time}

    return measure


def memory_per_environment(environment_id: str) -> Measure:
    """Return a measure of the bytes that Python and NumPy hold for each further environment of a batch."""

    def held(num_envs: int) -> int:
        tracemalloc.start()
        env = gymnasium.make_vec(environment_id, num_envs=num_envs, vectorization_mode="vector_entry_point")
        env.reset(seed=0)
        size = tracemalloc.get_traced_memory()[0]
        tracemalloc.stop()
        return size

    return lambda: {"bytes": (held(2 * _ROWS) - held(_ROWS)) / _ROWS}


@kernel
def _in_blocks(legs: Any, states: Any, targets: Any, refused: Any, verdicts: int) -> None:
    """Take every row to its target in lock-step without keeping it, or only judge it again `verdicts` times."""
    block, dof = make_block(legs.shape[0]), states.load.shape[1]
    for first in range(0, states.x.shape[0], LANES):
        count = min(LANES, states.x.shape[0] - first)
        for lane in range(count):
            load_lane(states, first + lane, targets[first + lane], block, lane)
        if verdicts == 0 or first == 0:
            step_block(legs, block, count, dof)
        for _ in range(verdicts):
            judge_block(block, count, dof)
        for lane in range(count):
            refused[first + lane] = block.common[0].is_sound[lane] == 0.0


def step_parts(environment_id: str) -> Measure:
    """Return a measure of the microseconds that the parts of one row's step take, on 1024 rows and one thread.

    `solve`: rods and Newton's method, in lock-step; `stability`: index and margins, before and after the step;
    `alone`: the rows that a step over the whole way refuses; `observation`: limits, costs and what is observed;
    `python`: rewards, infos and checks; `all_alone`: what the kernel would take with every row tracked one by one.
    """
    mechanism = gymnasium.spec(environment_id).kwargs["mechanism"]
    env: Any = MechanismVectorEnv(_ROWS, mechanism=mechanism, threads=1, autoreset_mode=AutoresetMode.DISABLED)
    env.reset(seed=0)
    simulation, model = env._simulation, env._simulation.settings.mechanism
    start = States(*(array.copy() for array in simulation.rows.states))
    legs, stride, rules = model.leg_table, simulation.settings.stride, simulation.settings.rules
    lower, upper = model.kernel_limits
    actions = np.random.default_rng(0).uniform(-1.0, 1.0, (_ROWS, model.leg_count))
    targets = np.clip(start.inputs + actions * stride, lower, upper)
    moves = Moves(actions, stride)
    report = empty_report(_ROWS, len(observation_elements(model)))
    refused, every_row = np.zeros(_ROWS, np.bool_), np.arange(_ROWS)
    _in_blocks(legs, simulation.rows.states, targets, refused, 0)
    refused_rows, refused_share = np.flatnonzero(refused), float(refused.mean())
    states = simulation.rows.states
    parts = {
        "blocks": lambda: _in_blocks(legs, states, targets, refused, 0),
        "verdicts": lambda: _in_blocks(legs, states, targets, refused, 2 * _REPEATS),
        "loading": lambda: _in_blocks(legs, states, targets, refused, -1),
        "refused": lambda: step_batch(legs, states, refused_rows, moves, rules, report),
        "kernel": lambda: step_batch(legs, states, every_row, moves, rules, report),
        "all_alone": lambda: step_alone(legs, states, every_row, moves, rules, report),
        "total": lambda: env.step(actions),
    }

    def measure() -> dict[str, float]:
        found = {name: 1e6 * timed(part) / _ROWS for name, part in parts.items()}
        stability = (found["verdicts"] - found["loading"]) / _REPEATS
        return {
            "solve": found["blocks"] - stability,
            "stability": stability,
            "alone": found["refused"],
            "observation": found["kernel"] - found["blocks"] - found["refused"],
            "python": found["total"] - found["kernel"],
            "total": found["total"],
            "all_alone": found["all_alone"],
            "refused": refused_share,
        }

    def timed(part: Any) -> float:
        """Return the least of some times, each from the same states."""
        least = np.inf
        for _ in range(5):
            for array, saved in zip(simulation.rows.states, start, strict=True):
                array[:] = saved
            env._ended[:] = False
            before = time.perf_counter()
            part()
            least = min(least, time.perf_counter() - before)
        return float(least)

    measure()
    return measure
