"""Switch: go from one stable equilibrium to another at the same inputs."""

from dataclasses import dataclass
from typing import ClassVar, Literal, NamedTuple

import numpy as np

from pcm_gym.arrays import Array, Integers
from pcm_gym.mechanism.validation import one_of
from pcm_gym.solving import Equilibrium, Roadmap, build_roadmap, find_falls, solve_forward
from pcm_gym.tasks.memory import remembered
from pcm_gym.tasks.scene import Scene
from pcm_gym.tasks.task import Episodes, Generators, OnInstability, Task, check_sampling, draw

# Equilibria from which the sheets are charted: up to this load, at so many inputs along each axis, for two and three
# legs.
_RHO_MAX = {2: 9.0, 3: 6.5}
_SEED_NODES = {2: 3, 3: 1}
# Starts that are tried, so many at a time, and the longest way to a goal, in steps of the agent.
_STARTS, _AT_ONCE, _LONGEST_WAY = 512, 32, 80
SwitchDifficulty = Literal["around", "fall"]


@dataclass(frozen=True)
class Switch(Task):
    """Change the assembly mode: reach another stable equilibrium at the inputs of the start.

    The goal tells the inputs too: the end-effector has to be there with the actuators where they were.

    Starts and goals
    ----------------
    A pair of start and goal, farther apart than `success_distance`, is drawn evenly from those of up to 512 starts. A
    way of up to 80 steps leads from one to the other, of the kind that `difficulty` says.

    Attributes
    ----------
    goals : Goals
        With inputs.
    difficulty : "around" or "fall"
        What leads to the goals. Around: the way never loses stability; it leads around a cusp of the singular set.
        Fall: there is no such way, the mechanism has to fall once or more, as few times as possible; only with
        `on_instability="snap"`.
    """

    with_inputs: ClassVar[bool] = True

    difficulty: SwitchDifficulty = "around"

    def __post_init__(self) -> None:
        super().__post_init__()
        one_of("difficulty", self.difficulty, ("around", "fall"))

    @property
    def behaviours(self) -> tuple[OnInstability, ...]:
        """Without falls that are followed nothing leads to the goals of "fall"."""
        return ("snap",) if self.difficulty == "fall" else super().behaviours

    def sample(self, scene: Scene, generators: Generators, threads: int = 1) -> Episodes:
        """Return episodes whose starts are any that have such a goal."""
        check_sampling(scene, generators, threads)
        ends = switches(scene, self.difficulty)
        here, there = (self.goals.of_states(x, ends.inputs) for x in (ends.start_x, ends.goal_x))
        apart = np.flatnonzero(~self.score(here, there)[1])
        if not len(apart):
            raise ValueError(f"success_distance must be less than {self.goals.success_distance}: all goals are reached")
        chosen = apart[(draw(generators, 1)[:, 0] * len(apart)).astype(np.int64)]
        start, goal = (scene.states(x[chosen], ends.inputs[chosen]) for x in (ends.start_x, ends.goal_x))
        return Episodes(start, there[chosen][:, None], goal)


class Switches(NamedTuple):
    """Pairs of states at the same inputs, dimensionless."""

    start_x: Array  # (n, size)
    goal_x: Array  # (n, size)
    inputs: Array  # (n, legs)


@remembered
def switches(scene: Scene, difficulty: SwitchDifficulty) -> Switches:
    """Return starts and goals for switching, from the origin of the scene or from anywhere.

    Raises
    ------
    ValueError
        If there are none.
    """
    found = (_from_anywhere if scene.origin is None else _from_origin)(scene, difficulty)
    if not len(found.goal_x):
        where = "at any inputs that were tried" if scene.origin is None else "at the inputs of the start"
        way = "a stable way" if difficulty == "around" else "falls, and no stable way,"
        raise ValueError(
            f"difficulty must not be {difficulty!r} for mechanism {scene.mechanism.name!r}: it has no two stable "
            f"equilibria {where} with {way} from one to the other in up to {_LONGEST_WAY} steps, each with a "
            f"singularity margin of at least {scene.reserve:.3g}"
        )
    return found


def _from_anywhere(scene: Scene, difficulty: SwitchDifficulty) -> Switches:
    mechanism, numbers = scene.mechanism, np.random.default_rng(0)
    count = _SEED_NODES[mechanism.leg_count]
    spans = zip(mechanism.lower_limits, mechanism.upper_limits, strict=True)
    axes = [low + (np.arange(count) + 0.5) / count * (high - low) for low, high in spans]
    nodes = [scene.home.inputs, *np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, mechanism.leg_count)]
    chart = _Chart(scene, difficulty, [found for inputs in nodes for found in _stable_at(scene, inputs)])
    partners = _partners(chart.roadmap)
    joined = chart.roadmap.components[partners]
    partners = partners[(joined[:, 0] == joined[:, 1]) == (difficulty == "around")]
    starts = numbers.permutation(np.unique(partners[:, 0]))[:_STARTS]
    pairs = [chart.led_to(part, partners) for part in np.array_split(starts, -(-len(starts) // _AT_ONCE) or 1)]
    found, states = np.concatenate(pairs), chart.roadmap.states
    inputs = mechanism.units.kernel_from_inputs(chart.roadmap.inputs[found[:, 0]])
    return Switches(states[found[:, 0]], states[found[:, 1]], inputs)


def _from_origin(scene: Scene, difficulty: SwitchDifficulty) -> Switches:
    origin = scene.origin
    assert origin is not None
    others = [found for found in _stable_at(scene, origin.inputs) if not np.allclose(found.state, origin.state)]
    chart = _Chart(scene, difficulty, [origin, *others])
    start, *ends = chart.roadmap.seeds
    partners = np.array([(start, end) for end in ends if end >= 0], dtype=np.int64).reshape(-1, 2)
    found = chart.led_to(np.array([start]), partners)[:, 1] if start >= 0 else partners[:0, 1]
    goal_x = np.array([other.state for other, end in zip(others, ends, strict=True) if end in found])
    goal_x = goal_x.reshape(-1, scene.mechanism.state_size)
    _, inputs, _ = origin.kernel_values()
    return Switches(np.tile(origin.state, (len(goal_x), 1)), goal_x, np.tile(inputs, (len(goal_x), 1)))


def _stable_at(scene: Scene, inputs: Array) -> list[Equilibrium]:
    rho_max = _RHO_MAX[scene.mechanism.leg_count]
    return list(solve_forward(scene.mechanism, inputs, scene.load, rho_max).stable)


class _Chart:
    """The sheets that stable equilibria lie on, and the falls from one to another."""

    def __init__(self, scene: Scene, difficulty: SwitchDifficulty, seeds: list[Equilibrium]) -> None:
        step = scene.mechanism.units.inputs_from_kernel(np.array(scene.stride))
        self.roadmap = build_roadmap(scene.mechanism, seeds, step=step, least_margin=scene.reserve)
        self._may_fall = difficulty == "fall"
        self._falls = find_falls(self.roadmap) if self._may_fall and len(self.roadmap) else None
        self._most = _LONGEST_WAY / scene.steps_per_way

    def led_to(self, starts: Integers, partners: Integers) -> Integers:
        """Return those of the `partners`, pairs (n, 2) of nodes, to which a way of the kind wanted leads."""
        steps, falls = self.roadmap.step_counts(starts, self._falls, self._most)
        row_of = np.full(len(self.roadmap), -1)
        row_of[starts] = np.arange(len(starts))
        mine = partners[row_of[partners[:, 0]] >= 0]
        rows = row_of[mine[:, 0]]
        is_of_kind = (falls[rows, mine[:, 1]] > 0.0) == self._may_fall
        led_to: Integers = mine[np.isfinite(steps[rows, mine[:, 1]]) & is_of_kind]
        return led_to


def _partners(roadmap: Roadmap) -> Integers:
    """Return all ordered pairs (n, 2) of nodes in the same cell."""
    order = np.argsort(roadmap.cells, kind="stable")
    cells, pairs = roadmap.cells[order], [np.empty((0, 2), dtype=np.int64)]
    for apart in range(1, int(np.bincount(cells).max(initial=1))):
        rows = np.flatnonzero(cells[apart:] == cells[:-apart])
        first, second = order[rows], order[rows + apart]
        pairs += [np.column_stack([first, second]), np.column_stack([second, first])]
    return np.concatenate(pairs)
