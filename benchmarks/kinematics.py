"""How long every solution of the position problem takes, beside searches from random starts for the same set.

All run in one thread, and the processor's time is measured: other work on the machine counts little.
"""

import itertools
import statistics
import time
from dataclasses import replace

import numpy as np

from benchmarks.multistart import METHODS, Equations, Method, search
from benchmarks.problems import Problem
from benchmarks.timing import Measure
from pcm_gym.solving import EquilibriumSet

# A search is also asked what it misses when it has had this many times our time.
LONG = 100.0
_SOLVES = 3


def solve_and_search(problem: Problem, seconds: float) -> Measure:
    """Return a measure of the seconds of our solver and, in its multiples, of each search for the same set.

    A search ends when it has met the whole set, which it cannot know itself, or after `seconds`; each measurement has
    fresh starts.
    """
    streams = np.random.SeedSequence(0)
    equations = Equations(problem)

    def measure() -> dict[str, float]:
        times = []
        for _ in range(_SOLVES):
            before = time.process_time()
            found = problem.solve()
            times.append(time.process_time() - before)
        ours = statistics.median(times)
        figures = {"solutions": float(len(found)), "seconds": ours}
        for (name, method), seed in zip(METHODS.items(), streams.spawn(len(METHODS)), strict=True):
            compared = _compare(equations, method, np.random.default_rng(seed), found, ours, seconds)
            figures |= {f"{name}: {key}": value for key, value in compared.items()}
        return figures

    return measure


def _compare(
    equations: Equations, method: Method, rng: np.random.Generator, found: EquilibriumSet, ours: float, seconds: float
) -> dict[str, float]:
    """Return when a search met the whole set and what it had missed before; its time alone counts, not ours here."""
    wanted = np.array([equations.state_of(equilibrium) for equilibrium in found])
    met_at = np.full(len(wanted), np.inf)
    elapsed, others = 0.0, 0
    searching = search(equations, method, rng)
    while elapsed < seconds and np.isinf(met_at).any():
        before = time.process_time()
        states = next(searching)
        elapsed += time.process_time() - before
        same = equations.are_same(states, wanted)
        met_at[same.any(axis=0)] = np.minimum(met_at[same.any(axis=0)], elapsed)
        others += int((~same.any(axis=1)).sum())
    is_complete = bool(np.isfinite(met_at).all())
    return {
        "is_complete": float(is_complete),
        "times_ours": (met_at.max() if is_complete else elapsed) / ours,
        "missed_in_our_time": float((met_at > ours).sum()),
        "missed_in_long_time": float((met_at > LONG * ours).sum()),
        "not_in_our_set": float(others),
    }


def table_cost(problem: Problem) -> Measure:
    """Return a measure of the seconds of the rod's table, made once for each `rho_max`: a first solve less a second."""
    # Each time a range that was not asked for before, the same to many digits.
    new = (replace(problem, rho_max=problem.rho_max * (1.0 + 1e-12 * n)) for n in itertools.count(1))

    def measure() -> dict[str, float]:
        fresh, times = next(new), []
        for _ in range(2):
            before = time.process_time()
            fresh.solve()
            times.append(time.process_time() - before)
        return {"table_seconds": times[0] - times[1]}

    return measure
