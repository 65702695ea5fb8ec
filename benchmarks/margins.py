"""The singularity margin against the exact distance: which states near folds does it call safe, which others not?

A state is within a threshold if `nearest_fold` finds a fold nearer than that, and is called safe if its margin is not
below it. Half of the states are anywhere, the others are beside folds: a ray of inputs is tracked to its first fold and
gone back a part of the way.
"""

import itertools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np
from numpy.random import Generator

import pcm_gym
from pcm_gym.arrays import Array, Mask
from pcm_gym.solving import BranchTracker, Equilibrium, Event, nearest_fold, solve_forward

# Distances at which thresholds are looked at beside the environments' own, in rad and mean rod lengths.
THRESHOLDS = (0.005, 0.01, 0.02, 0.05, 0.1, 0.2)
# Farther than this no fold is looked for.
REACH = 0.4
# Lengths of rays, and how far they are gone back: from the least to the most, evenly by their logarithms.
_LONGEST_RAY, _LEAST_BACK, _MOST_BACK = 1.5, 3e-4, 0.3
# Walks of a platform, whose sets are not enumerated here: rows, and steps between two states that are taken.
_ROWS, _STEPS_BETWEEN, _STEPS_BEFORE, _TURNS = 64, 12, 60, 0.08


@dataclass(frozen=True)
class Calls:
    """What the margin says at one threshold."""

    threshold: float
    within: int  # states that have a fold nearer than the threshold
    missed: int  # of them, those called safe
    outside: int
    false_alarms: int  # of those outside, those not called safe

    @property
    def missed_part(self) -> float:
        return self.missed / max(self.within, 1)

    @property
    def false_part(self) -> float:
        return self.false_alarms / max(self.outside, 1)

    @property
    def false_part_of_alarms(self) -> float:
        return self.false_alarms / max(self.within - self.missed + self.false_alarms, 1)


@dataclass(frozen=True)
class Judged:
    """States of a mechanism with margin and distance."""

    name: str
    threshold: float  # of the environments
    margins: Array
    distances: Array  # infinite where there is no fold within reach

    @property
    def thresholds(self) -> list[float]:
        """Where margins are looked at."""
        return sorted({self.threshold, *THRESHOLDS})

    def calls(self, threshold: float) -> Calls:
        within, is_safe = self.distances < threshold, self.margins >= threshold
        return Calls(
            threshold,
            int(np.count_nonzero(within)),
            int(np.count_nonzero(within & is_safe)),
            int(np.count_nonzero(~within)),
            int(np.count_nonzero(~within & ~is_safe)),
        )

    def ratios(self, least: float = 0.0) -> Array:
        """Return quantiles of margin over distance, for 1, 50 and 99 of a hundred states with a fold within reach."""
        known = np.isfinite(self.distances) & (self.distances >= least)
        if not known.any():
            return np.full(3, math.nan)
        found: Array = np.quantile(self.margins[known] / self.distances[known], (0.01, 0.5, 0.99))
        return found


def judge_margins(name: str, count: int, seed: int, advance: Callable[[], object] = lambda: None) -> Judged:
    """Return `count` stable states of a catalogued mechanism within its limits, judged; tell of each."""
    generator = np.random.default_rng(seed)
    anywhere = list(itertools.islice(states_anywhere(name, generator), (count + 1) // 2))
    states = anywhere + list(itertools.islice(states_beside_folds(anywhere, generator), count // 2))
    margins, distances = np.empty(len(states)), np.empty(len(states))
    for n, state in enumerate(states):
        fold = nearest_fold(state, REACH)
        margins[n], distances[n] = state.singularity_margin, math.inf if fold is None else fold.distance
        advance()
    with gymnasium.make(f"PCM/{name}-Reach-v0") as env:
        threshold: float = env.get_wrapper_attr("singular_margin")
    return Judged(name, threshold, margins, distances)


def states_anywhere(name: str, generator: Generator) -> Iterator[Equilibrium]:
    """Yield stable states: of two legs all that there are at random inputs, of a platform those that walks come to."""
    mechanism = pcm_gym.get_mechanism(name)
    if mechanism.dof == 3:
        yield from _on_walks(name, generator)
        return
    while True:
        yield from solve_forward(mechanism, generator.uniform(mechanism.lower_limits, mechanism.upper_limits)).stable


def _on_walks(name: str, generator: Generator) -> Iterator[Equilibrium]:
    """Yield states on random walks that go on where they fall to."""
    env: Any = gymnasium.make_vec(
        f"PCM/{name}-Reach-v0", num_envs=_ROWS, vectorization_mode="vector_entry_point", on_instability="snap"
    )
    env.reset(seed=int(generator.integers(2**31)))
    mechanism, rows = pcm_gym.get_mechanism(name), env.unwrapped._simulation.rows
    load = np.zeros(mechanism.dof)
    actions = np.zeros(env.action_space.shape, np.float32)
    for step in itertools.count():
        turning: Mask = (generator.random(_ROWS) < _TURNS) | (step == 0)
        actions[turning] = generator.uniform(-1.0, 1.0, (np.count_nonzero(turning), actions.shape[1]))
        env.step(actions)
        if step < _STEPS_BEFORE or step % _STEPS_BETWEEN:
            continue
        for row in range(_ROWS):
            inputs = mechanism.units.inputs_from_kernel(rows.states.inputs[row])
            state = Equilibrium(mechanism, rows.states.x[row], inputs, load)
            if state.is_stable:
                yield state


def states_beside_folds(states: list[Equilibrium], generator: Generator) -> Iterator[Equilibrium]:
    """Yield states some way before folds, on rays from random ones of these."""
    while True:
        start = states[generator.integers(len(states))]
        direction = generator.normal(size=len(start.inputs))
        ray = _LONGEST_RAY * start.mechanism.units.inputs * direction / np.linalg.norm(direction)
        step = BranchTracker(start.mechanism, start).step(start.inputs + ray)
        back = math.exp(generator.uniform(math.log(_LEAST_BACK), math.log(_MOST_BACK))) / _LONGEST_RAY
        if step.event in (Event.FOLD, Event.INDEX_CHANGE) and step.fraction > back:
            beside = BranchTracker(start.mechanism, start).step(start.inputs + (step.fraction - back) * ray)
            if beside.event is Event.NONE:
                yield beside.equilibrium
