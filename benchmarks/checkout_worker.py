"""Times what one checkout does, by public names alone; run as a script with the checkout first in PYTHONPATH.

Reads the name of a measure from each line of its input and answers with its seconds, as JSON: those of the processor
where there is one thread. So that two checkouts do the same, everything is drawn from fixed seeds, and batches step for
a fixed number of steps.
"""

import json
import sys
import time
import warnings
from collections.abc import Callable
from functools import cache, partial
from typing import Any, NamedTuple

import gymnasium
import numpy as np

import pcm_gym

MECHANISMS = ("2RFR", "2PFR", "3PFR")
_ROWS, _BATCH_STEPS, _SINGLE_STEPS, _PROBLEMS = 1024, 40, 1500, 8
# After so many steps the episodes of a batch no longer end all at once.
_STEPS_BEFORE = 200


class _Run(NamedTuple):
    """What is timed, and what makes it the same each time."""

    run: Callable[[], None]
    prepare: Callable[[], None] = lambda: None
    clock: Callable[[], float] = time.process_time  # other work on the machine moves it less than the time of day


def measures() -> dict[str, Callable[[], _Run]]:
    """Return what can be measured: by name, what makes it ready."""
    found: dict[str, Callable[[], _Run]] = {}
    for name in MECHANISMS:
        for threads in (1, 2):
            found[f"{name}, batch of {_ROWS}, threads: {threads}"] = partial(_batch, name, threads)
        found[f"{name}, single"] = partial(_single, name)
        found[f"{name}, forward sets"] = partial(_sets, name, is_inverse=False)
        found[f"{name}, inverse sets"] = partial(_sets, name, is_inverse=True)
    return found


def _batch(name: str, threads: int) -> _Run:
    """Return a run of a batch, which begins anew each time: the same steps however often it is run."""
    env: Any = gymnasium.make_vec(
        f"PCM/{name}-Reach-v0", num_envs=_ROWS, vectorization_mode="vector_entry_point", threads=threads
    )
    generator = np.random.default_rng(0)
    actions = [generator.uniform(-1.0, 1.0, env.action_space.shape).astype(np.float32) for _ in range(20)]
    env.reset(seed=0)
    for n in range(_STEPS_BEFORE):
        env.step(actions[n % len(actions)])
    saved = env.unwrapped.save_state()

    def run() -> None:
        for n in range(_BATCH_STEPS):
            env.step(actions[n % len(actions)])

    clock = time.perf_counter if threads > 1 else time.process_time
    return _Run(run, partial(env.unwrapped.restore_state, saved), clock)


def _single(name: str) -> _Run:
    env = gymnasium.make(f"PCM/{name}-Reach-v0")
    env.action_space.seed(0)
    actions = [env.action_space.sample() for _ in range(_SINGLE_STEPS)]

    def run() -> None:
        env.reset(seed=0)
        for action in actions:
            *_, terminated, truncated, _ = env.step(action)
            if terminated or truncated:
                env.reset()

    return _Run(run)


def _sets(name: str, *, is_inverse: bool) -> _Run:
    """Return the solution of position problems near home, with a load on every other one."""
    mechanism, generator = pcm_gym.get_mechanism(name), np.random.default_rng(1)
    home = pcm_gym.home_equilibrium(mechanism)
    solve = pcm_gym.solve_inverse if is_inverse else pcm_gym.solve_forward
    centre = home.pose if is_inverse else home.inputs
    problems = []
    for n in range(_PROBLEMS):
        given = centre + generator.uniform(-0.1, 0.1, len(centre))
        load = generator.uniform(-0.5, 0.5, mechanism.dof) * (n % 2)
        problems.append((given, load * mechanism.units.load))

    def run() -> None:
        for given, load in problems:
            solve(mechanism, given, load, 6.5 if mechanism.dof == 3 else 9.0)

    return _Run(run)


@cache
def _ready(name: str) -> _Run:
    made = measures()[name]()
    made.run()  # once before any time is taken
    return made


def _timed(name: str) -> float:
    made = _ready(name)
    made.prepare()
    before = made.clock()
    made.run()
    return made.clock() - before


def main() -> None:
    """Answer line by line until the input ends."""
    warnings.simplefilter("ignore")
    print(json.dumps({"package": pcm_gym.__file__, "measures": list(measures())}), flush=True)
    for line in sys.stdin:
        print(json.dumps({"seconds": _timed(line.strip())}), flush=True)


if __name__ == "__main__":
    main()
