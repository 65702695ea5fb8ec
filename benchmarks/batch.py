"""Steps per second of the native batch, and where the time of a step goes."""

import time
from typing import Any

import gymnasium
import numba
import numpy as np

from benchmarks.timing import Measure
from pcm_gym.environments.simulation import Settings, Simulation
from pcm_gym.kernels.closure import make_workspace
from pcm_gym.kernels.continuation import NONE, make_line, track
from pcm_gym.kernels.transition import COST_COLUMNS, VERDICT_COLUMNS, States, step_batch

BATCH_SIZES = (64, 1024)
_ROWS, _STEPS = 256, 20


def batch_throughput(environment_id: str, num_envs: int, seconds: float) -> Measure:
    """Return a measure of steps per second of a native batch, resets where episodes end, and of the time of a reset."""
    env = gymnasium.make_vec(environment_id, num_envs=num_envs, vectorization_mode="vector_entry_point")
    generator = np.random.default_rng(0)
    actions = [generator.uniform(-1.0, 1.0, env.action_space.shape).astype(np.float32) for _ in range(20)]
    clock = time.perf_counter
    env.reset(seed=0)
    env.step(actions[0])

    def measure() -> dict[str, float]:
        before = clock()
        env.reset(seed=0)
        steps, start = 0, clock()
        now = start
        while now - start < seconds:
            for action in actions:
                env.step(action)
            steps += len(actions)
            now = clock()
        step_time = (now - start) / steps
        return {
            "steps_per_second": num_envs / step_time,
            "reset_in_steps": (start - before) / step_time,
        }

    return measure


@numba.njit(error_model="numpy")  # type: ignore[untyped-decorator]
def _track_all(legs: Any, states: Any, targets: Any) -> int:
    """Track every row (n) to its targets (steps, n, legs); a row whose way ends waits there. Return the steps made."""
    made, load_count = 0, states.load.shape[1]
    line, work = make_line(legs.shape[0], states.x.shape[1]), make_workspace(legs.shape[0], states.x.shape[1])
    load = np.zeros(load_count)
    for row in range(states.x.shape[0]):
        for step in range(targets.shape[0]):
            tracked = track(
                legs, states.x[row], states.inputs[row], states.load[row], targets[step, row], load, False, line, work
            )
            made += 1
            if tracked.event != NONE:
                break
    return made


def step_parts(environment_id: str) -> Measure:
    """Return a measure of the microseconds that the parts of one row's step take, each with what is below it.

    `tracking`: the branch followed to the next inputs, its stability included; `kernel`: also limits, verdicts, costs
    and observation; `simulation`: also reward and success; all on 256 rows, unthreaded.
    """
    settings = Settings.from_arguments(
        gymnasium.spec(environment_id).kwargs["mechanism"], "dense", "terminate", None, None, 0.02, 1.0
    )
    simulation = Simulation(settings, _ROWS)
    for row in range(_ROWS):
        simulation.reset_row(row, np.random.default_rng(row), None)
    start = States(*(array.copy() for array in simulation.states))
    mechanism = settings.mechanism
    legs, stride = mechanism.leg_table, settings.max_action / mechanism.units.inputs
    actions = np.random.default_rng(0).uniform(-1.0, 1.0, (_STEPS, _ROWS, mechanism.leg_count))
    lower, upper = mechanism.lower_limits / mechanism.units.inputs, mechanism.upper_limits / mechanism.units.inputs
    targets = np.clip(start.inputs + np.cumsum(actions * stride, axis=0), lower, upper)
    observation = simulation.observe().observation["observation"]
    verdicts, costs = np.empty((_ROWS, VERDICT_COLUMNS)), np.empty((_ROWS, COST_COLUMNS))
    features = np.empty_like(observation)

    def put_back() -> None:
        for array, saved in zip(simulation.states, start, strict=True):
            array[:] = saved

    def tracking() -> int:
        made: int = _track_all(legs, simulation.states, targets)
        return made

    def kernel() -> int:
        for action in actions:
            step_batch(legs, simulation.states, action, stride, 1.0, verdicts, costs, features)
        return _STEPS * _ROWS

    def whole() -> int:
        for action in actions:
            simulation.step(action)
        return _STEPS * _ROWS

    parts = {"tracking": tracking, "kernel": kernel, "simulation": whole}

    def measure() -> dict[str, float]:
        times = {}
        for name, part in parts.items():
            put_back()
            before = time.perf_counter()
            made = part()
            times[f"{name}_microseconds"] = 1e6 * (time.perf_counter() - before) / made
        return times

    measure()
    return measure
