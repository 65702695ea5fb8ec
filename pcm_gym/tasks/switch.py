"""Switch: go from one stable equilibrium to another at the same inputs."""

from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pcm_gym.kernels.transition import States
from pcm_gym.solving import Equilibrium, Roadmap, build_roadmap, solve_forward
from pcm_gym.tasks.scene import Scene
from pcm_gym.tasks.task import Episodes, Generators, Task, draw

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

# Equilibria from which the sheets are charted: up to this load, at so many inputs along each axis, for two and three
# legs.
_RHO_MAX = {2: 9.0, 3: 6.5}
_SEED_NODES = {2: 3, 3: 1}
# Starts that are tried, and the longest way to a goal, in steps of the agent.
_STARTS, _LONGEST_WAY = 128, 80


@dataclass(frozen=True)
class Switch(Task):
    """Change the assembly mode: reach another stable equilibrium at the inputs of the start.

    The goal tells the inputs too: the end-effector has to be there with the actuators where they were.

    Starts and goals
    ----------------
    A pair of start and goal is drawn evenly from those of up to 128 starts. A way of up to 80 steps joins them that
    never loses stability: it leads around a cusp of the singular set.

    Attributes
    ----------
    goals : Goals
        With inputs.
    """

    time_limit: ClassVar[int] = 150

    def sample(self, scene: Scene, generators: Generators, threads: int = 1) -> Episodes:
        """Return episodes whose starts are any that have such a goal."""
        ends = switches(scene)
        chosen = (draw(generators, 1)[:, 0] * len(ends.goal_x)).astype(np.int64)
        load = np.tile(np.array(scene.load) / scene.mechanism.units.load, (len(chosen), 1))
        start = States(ends.start_x[chosen], ends.inputs[chosen], load)
        goals = self.goals.of_states(ends.goal_x[chosen], start.inputs)
        return Episodes(start, goals[:, None], States(ends.goal_x[chosen], start.inputs, load))


class Switches(NamedTuple):
    """Pairs of states at the same inputs, dimensionless, joined by a stable path."""

    start_x: Array  # (n, size)
    goal_x: Array  # (n, size)
    inputs: Array  # (n, legs)


@lru_cache(maxsize=64)
def switches(scene: Scene) -> Switches:
    """Return starts and goals for switching, from the origin of the scene or from anywhere.

    Raises
    ------
    ValueError
        If there are none.
    """
    found = _from_anywhere(scene) if scene.origin is None else _from_origin(scene, scene.origin)
    if not len(found.goal_x):
        where = "at any inputs that were tried" if scene.origin is None else "at the inputs of the start"
        raise ValueError(
            f"mechanism {scene.mechanism.name!r} has no two stable equilibria {where} with a stable path between "
            f"them of up to {_LONGEST_WAY} steps, each with a singularity margin of {scene.reserve:.3g} or more"
        )
    return found


def _from_anywhere(scene: Scene) -> Switches:
    mechanism, numbers = scene.mechanism, np.random.default_rng(0)
    count = _SEED_NODES[mechanism.leg_count]
    places = (np.arange(count) + 0.5) / count
    axes = [
        low + places * (high - low) for low, high in zip(mechanism.lower_limits, mechanism.upper_limits, strict=True)
    ]
    nodes = [scene.home.inputs, *np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, mechanism.leg_count)]
    seeds = [found for inputs in nodes for found in _stable_at(scene, inputs)]
    roadmap = _chart(scene, seeds)
    partners = _partners(roadmap)
    starts = np.unique(partners[:, 0])
    starts = numbers.permutation(starts)[:_STARTS]
    if not len(starts):
        return _switches(roadmap, np.empty((0, 2), dtype=np.int64))
    steps, row_of = roadmap.step_counts(starts), np.full(len(roadmap), -1)
    row_of[starts] = np.arange(len(starts))
    partners = partners[row_of[partners[:, 0]] >= 0]
    is_near = steps[row_of[partners[:, 0]], partners[:, 1]] <= _LONGEST_WAY / scene.steps_per_way
    return _switches(roadmap, partners[is_near])


def _from_origin(scene: Scene, origin: Equilibrium) -> Switches:
    others = [found for found in _stable_at(scene, origin.inputs) if not np.allclose(found.state, origin.state)]
    roadmap = _chart(scene, [origin, *others])
    is_near = np.zeros(len(others), dtype=np.bool_)
    if roadmap.seeds[0] >= 0:
        steps = roadmap.step_counts([roadmap.seeds[0]])[0]
        is_near = np.array(
            [node >= 0 and steps[node] <= _LONGEST_WAY / scene.steps_per_way for node in roadmap.seeds[1:]],
            dtype=np.bool_,
        )
    goal_x = np.array([found.state for found in others]).reshape(-1, scene.mechanism.state_size)[is_near]
    inputs = origin.inputs / scene.mechanism.units.inputs
    return Switches(np.tile(origin.state, (len(goal_x), 1)), goal_x, np.tile(inputs, (len(goal_x), 1)))


def _switches(roadmap: Roadmap, pairs: Integers) -> Switches:
    inputs = roadmap.inputs[pairs[:, 0]] / roadmap.mechanism.units.inputs
    return Switches(roadmap.states[pairs[:, 0]], roadmap.states[pairs[:, 1]], inputs)


def _stable_at(scene: Scene, inputs: Array) -> list[Equilibrium]:
    rho_max = _RHO_MAX[scene.mechanism.leg_count]
    return list(solve_forward(scene.mechanism, inputs, scene.load, rho_max).stable)


def _chart(scene: Scene, seeds: list[Equilibrium]) -> Roadmap:
    step = np.array(scene.stride) * scene.mechanism.units.inputs
    return build_roadmap(scene.mechanism, seeds, step=step, least_margin=scene.reserve)


def _partners(roadmap: Roadmap) -> Integers:
    """Return all ordered pairs (n, 2) of nodes in the same cell and component."""
    order = np.lexsort((roadmap.cells, roadmap.components))
    keys = np.stack([roadmap.components[order], roadmap.cells[order]], axis=1)
    pairs, apart = [], 1
    while True:
        rows = (
            np.flatnonzero((keys[apart:] == keys[:-apart]).all(axis=1)) if apart < len(keys) else np.empty(0, np.int64)
        )
        if not len(rows):
            break
        first, second = order[rows], order[rows + apart]
        pairs += [np.column_stack([first, second]), np.column_stack([second, first])]
        apart += 1
    return np.concatenate(pairs) if pairs else np.empty((0, 2), dtype=np.int64)
