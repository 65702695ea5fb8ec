"""How many random paths are proved, how long that takes, and whether a wrong path ever is."""

import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from pcm_gym import Event, certify_path, get_mechanism
from pcm_gym.arrays import Array
from tests.reference.paths import MUTATIONS, Walk, mutated, random_starts, random_walk


@dataclass
class Tally:
    """What became of the paths of one mechanism."""

    mechanism: str
    paths: int = 0  # without an event
    proved: int = 0
    with_event: int = 0
    reasons: Counter[str] = field(default_factory=Counter)  # of paths without an event that were not proved
    step_times: list[float] = field(default_factory=list)  # processor time of a proof of one step, ms
    path_times: list[float] = field(default_factory=list)
    largest_error: float = 0.0
    mutations: Counter[str] = field(default_factory=Counter)
    proved_mutations: Counter[str] = field(default_factory=Counter)

    def as_dict(self) -> dict[str, Any]:
        """Return the figures, times by their quantiles."""
        return {
            **vars(self),
            "step_times": quantiles(self.step_times).tolist(),
            "path_times": quantiles(self.path_times).tolist(),
        }


def quantiles(times: list[float]) -> Array:
    """Return median, 95 %, 99 % and the largest."""
    return np.quantile(times, [0.5, 0.95, 0.99, 1.0]) if times else np.full(4, np.nan)


def try_paths(name: str, paths: int, mutations: int, seed: int, advance: Callable[[], None]) -> Tally:
    """Prove random paths of a mechanism until so many have no event, and try as many wrong ones as asked for."""
    mechanism, rng, tally = get_mechanism(name), np.random.default_rng(seed), Tally(name)
    starts = random_starts(mechanism, rng)
    walk = random_walk(next(starts), rng)
    certify_path(mechanism, walk.equilibria[:2])  # compiled before anything is timed
    each = -(-mutations // len(MUTATIONS))
    while tally.paths < paths or any(tally.mutations[kind] < each for kind in MUTATIONS):
        walk = random_walk(next(starts), rng)
        if walk.event == Event.NONE and tally.paths < paths:
            began = time.process_time()
            proof = certify_path(mechanism, walk.equilibria)
            tally.path_times.append(1e3 * (time.process_time() - began))
            tally.paths += 1
            tally.proved += proof.is_proved
            if proof.is_proved:
                tally.largest_error = max(tally.largest_error, proof.error)
            else:
                tally.reasons[proof.reason] += 1
            began = time.process_time()
            certify_path(mechanism, walk.equilibria[:2])
            tally.step_times.append(1e3 * (time.process_time() - began))
            advance()
        elif walk.event != Event.NONE:
            tally.with_event += 1
        _try_mutations(tally, each, walk, rng, advance)
    return tally


def _try_mutations(tally: Tally, each: int, walk: Walk, rng: np.random.Generator, advance: Callable[[], None]) -> None:
    mechanism = get_mechanism(tally.mechanism)
    for kind in (kind for kind in MUTATIONS if tally.mutations[kind] < each):
        path = mutated(walk, kind, rng)
        if path is not None:
            tally.mutations[kind] += 1
            tally.proved_mutations[kind] += certify_path(mechanism, path).is_proved
            advance()


def print_tallies(console: Console, tallies: list[Tally]) -> None:
    """Print a table, one row per mechanism."""
    table = Table("Mechanism", "Paths", "Proved", "Else", "One step, ms: median, 95 %, 99 %, most", "Wrong ones proved")
    for tally in tallies:
        times = ", ".join(f"{value:.2g}" for value in quantiles(tally.step_times))
        share = f"{tally.proved} ({tally.proved / max(tally.paths, 1):.1%})"
        wrong = f"{sum(tally.proved_mutations.values())} of {sum(tally.mutations.values())}"
        table.add_row(tally.mechanism, str(tally.paths), share, str(dict(tally.reasons)), times, wrong)
    console.print(table)
