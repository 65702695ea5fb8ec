"""Random paths of several steps from stable and unstable equilibria, and paths that are wrong on purpose."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from pcm_gym.arrays import Array
from pcm_gym.mechanism import Mechanism, get_mechanism
from pcm_gym.solving import BranchTracker, Equilibrium, Event, solve_forward
from pcm_gym.tasks import default_max_action

# Starts at the same inputs, and steps of a path.
_STARTS_AT_ONCE, STEPS = 4, 5
# Largest load of the equilibria that are looked for, by the number of legs.
_RHO_MAX = {2: 9.0, 3: 7.0}
# Equilibria nearer than this, relative to 1 + their size, are taken for one.
_SAME = 1e-6
MUTATIONS = ("start", "target", "turn", "swapped start", "swapped target", "hidden fold")


@dataclass(frozen=True)
class Walk:
    """A path of random steps, each as long as an agent's, and the event that ended it."""

    equilibria: list[Equilibrium]
    event: Event
    goal: Array  # the inputs to which the last step was to lead


def random_starts(mechanism: Mechanism, rng: np.random.Generator) -> Iterator[Equilibrium]:
    """Yield equilibria of any index at inputs within the limits and half a radian or length of the home."""
    home = np.zeros(mechanism.leg_count) if mechanism.home_inputs is None else np.array(mechanism.home_inputs)
    while True:
        inputs = np.clip(
            home + rng.uniform(-0.5, 0.5, mechanism.leg_count), mechanism.lower_limits, mechanism.upper_limits
        )
        found = list(solve_forward(mechanism, inputs, rho_max=_RHO_MAX[mechanism.leg_count]))
        for n in rng.permutation(len(found))[:_STARTS_AT_ONCE]:
            yield found[n]


def random_walk(start: Equilibrium, rng: np.random.Generator, steps: int = STEPS) -> Walk:
    """Return a walk of steps in random directions; the longest part of each is the default `max_action`."""
    tracker, equilibria = BranchTracker(start.mechanism, start), [start]
    for _ in range(steps):
        direction = rng.normal(size=start.mechanism.leg_count)
        goal = equilibria[-1].inputs + default_max_action(start.mechanism) * direction / np.abs(direction).max()
        step = tracker.step(goal)
        equilibria.append(step.equilibrium)
        if step.event != Event.NONE:
            return Walk(equilibria, step.event, goal)
    return Walk(equilibria, Event.NONE, goal)


def random_walks(name: str, count: int, rng: np.random.Generator) -> Iterator[Walk]:
    """Yield so many walks of a mechanism of the catalogue."""
    starts = random_starts(get_mechanism(f"{name}-paper"), rng)
    for _ in range(count):
        yield random_walk(next(starts), rng)


def perturbed(equilibrium: Equilibrium, rng: np.random.Generator) -> Equilibrium:
    """Return the equilibrium with one number of its state wrong by 1e-7 to 1e-1, relative to 1 + its size."""
    state = equilibrium.state.copy()
    k = rng.integers(len(state))
    state[k] += rng.choice([-1.0, 1.0]) * 10.0 ** rng.uniform(-7.0, -1.0) * (1.0 + abs(state[k]))
    return Equilibrium(equilibrium.mechanism, state, equilibrium.inputs, equilibrium.load)


def other_equilibrium(equilibrium: Equilibrium, rng: np.random.Generator) -> Equilibrium | None:
    """Return another equilibrium at the same inputs, preferably one near by; None if there is none."""
    mechanism = equilibrium.mechanism
    found = solve_forward(mechanism, equilibrium.inputs, equilibrium.load, _RHO_MAX[mechanism.leg_count])
    scale = 1.0 + np.abs(equilibrium.state)
    gaps = [(float(np.max(np.abs(e.state - equilibrium.state) / scale)), n) for n, e in enumerate(found)]
    others = [n for gap, n in sorted(gaps) if gap > _SAME]
    return found[others[int(rng.integers(min(3, len(others))))]] if others else None


def mutated(walk: Walk, kind: str, rng: np.random.Generator) -> list[Equilibrium] | None:
    """Return a path made wrong in this way; None where this walk cannot be.

    A hidden fold is a walk that ends at one, continued to where it was to lead, to any equilibrium there.
    """
    path = list(walk.equilibria)
    if kind == "hidden fold":
        if walk.event != Event.FOLD:
            return None
        mechanism = path[0].mechanism
        beyond = solve_forward(mechanism, walk.goal, path[0].load, _RHO_MAX[mechanism.leg_count])
        return [*path[:-1], beyond[int(rng.integers(len(beyond)))]] if len(beyond) else None
    if walk.event != Event.NONE:
        return None
    place = {"start": 0, "swapped start": 0, "turn": len(path) // 2}.get(kind, len(path) - 1)
    wrong = other_equilibrium(path[place], rng) if kind.startswith("swapped") else perturbed(path[place], rng)
    if wrong is None:
        return None
    path[place] = wrong
    return path
