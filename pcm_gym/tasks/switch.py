"""Switch: go from one stable equilibrium to another at the same inputs."""

import math
from dataclasses import dataclass
from typing import Any, ClassVar, Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray

from pcm_gym.arrays import Array, Integers, Mask
from pcm_gym.kernels.charts.distances import FAR, all_neighbours
from pcm_gym.mechanism.validation import one_of
from pcm_gym.solving import Equilibrium, Roadmap, build_roadmap, find_falls
from pcm_gym.tasks.distances import steps_per_way, ways_from
from pcm_gym.tasks.memory import remembered
from pcm_gym.tasks.scene import Scene
from pcm_gym.tasks.task import Episodes, Generators, OnInstability, Progress, Task, check_sampling, draw, draw_until

# Equilibria from which the sheets are charted: up to this load, at so many inputs along each axis, for two and three
# legs.
_RHO_MAX = {2: 9.0, 3: 6.5}
_SEED_NODES = {2: 3, 3: 1}
# Nodes from which ways are sought, without falls and with them, and these so many at a time.
_STARTS, _FALLING_STARTS, _AT_ONCE = 1024, 512, 32
# The most steps that a planner needs to a goal, and the most and the least to those that are near and far.
_LONGEST, _NEAR, _FAR = 120.0, 30.0, 60.0
SwitchDifficulty = Literal["around", "near", "far", "fall", "rig"]


@dataclass(frozen=True)
class Switch(Task):
    """Change the assembly mode: reach another stable equilibrium at the inputs of the start.

    The goal tells the inputs too: the end-effector has to be there with the actuators where they were.

    Starts and goals
    ----------------
    Start and goal are farther apart than `success_distance`. The inputs are anywhere in a cell of the roadmap, drawn
    evenly from those over which there is such a pair; a way of up to 120 steps of a planner leads from one to the
    other, of the kind that `difficulty` says.

    Attributes
    ----------
    goals : Goals
        With inputs.
    difficulty : "around", "near", "far", "fall" or "rig"
        What leads to the goals. Around: the way never loses stability; it leads around a cusp of the singular set.
        Near and far: of these, up to 30 steps, just around the cusp, and more than 60. Fall: there is no such way, the
        mechanism has to fall once or more; only with `on_instability="snap"`, and the infos tell `fewest_falls`. Rig:
        around, with what a real rig adds, see `pcm_gym.environments.rig`.
    """

    with_inputs: ClassVar[bool] = True
    has_split: ClassVar[bool] = True

    difficulty: SwitchDifficulty = "around"

    def __post_init__(self) -> None:
        super().__post_init__()
        one_of("difficulty", self.difficulty, get_args(SwitchDifficulty))

    @property
    def behaviours(self) -> tuple[OnInstability, ...]:
        """Without falls that are followed nothing leads to the goals of "fall"."""
        return ("snap",) if self.difficulty == "fall" else super().behaviours

    def sample(self, scene: Scene, generators: Generators, threads: int = 1) -> Episodes:
        """Return episodes whose starts are any that have such a goal."""
        check_sampling(scene, generators, threads)
        ends = switches(scene, self.difficulty == "fall")
        here, there = (self.goals.of_states(x, ends.inputs) for x in (ends.start_x, ends.goal_x))
        chosen = np.flatnonzero(self._is_of_tier(ends.steps) & ~self._scored(here, there)[1])
        if not len(chosen):
            raise ValueError(self._refusal(scene))

        def drawn(own: Generators) -> tuple[Episodes, Mask]:
            numbers = draw(own, 1 + scene.mechanism.leg_count)
            pairs = chosen[(numbers[:, 0] * len(chosen)).astype(np.int64)]
            start, goal = (scene.states(x[pairs], ends.inputs[pairs]) for x in (ends.start_x, ends.goal_x))
            is_fit = np.ones(len(pairs), dtype=np.bool_)
            if scene.origin is None:  # start and goal move within their cell alike
                for states in (start, goal):
                    is_fit &= scene.move_within_cells(states, numbers[:, 1:], threads)
            here, there = (self.goals.of_states(states.x, states.inputs) for states in (start, goal))
            return Episodes(start, there[:, None], goal, ends.falls[pairs]), is_fit & ~self._scored(here, there)[1]

        return draw_until(drawn, generators, "success_distance must leave goals that are not met at the start")

    def roadmap(self, scene: Scene) -> Roadmap:
        """Return the roadmap of all sheets that are known, not only of those that home leads to."""
        return _all_sheets(scene)

    def progress_metrics(self, progress: Progress) -> dict[str, NDArray[Any]]:
        """Return how few falls lead to the goals of "fall", to compare with the `losses` of an episode."""
        return {"fewest_falls": progress.fewest_falls} if self.difficulty == "fall" else {}

    def _is_of_tier(self, steps: Array) -> Mask:
        least, most = {"near": (0.0, _NEAR), "far": (_FAR, _LONGEST)}.get(self.difficulty, (0.0, _LONGEST))
        is_of_tier: Mask = (steps >= least) & (steps <= most)
        return is_of_tier

    def _refusal(self, scene: Scene) -> str:
        where = "at any inputs that were tried" if scene.origin is None else "at the inputs of the start"
        ways = {"fall": "falls, and no stable way,", "near": f"a stable way of up to {_NEAR:g} steps"}
        ways["far"] = f"a stable way of at least {_FAR:g} steps"
        return (
            f"difficulty must not be {self.difficulty!r} for mechanism {scene.mechanism.name!r}: it has no two stable "
            f"equilibria {where}, farther apart than {self.goals.success_distance} m, with "
            f"{ways.get(self.difficulty, 'a stable way')} from one to the other in up to {_LONGEST:g} steps, each with "
            f"a singularity margin of at least {scene.reserve:.3g}"
        )


class Switches(NamedTuple):
    """Pairs of states at the same inputs, dimensionless."""

    start_x: Array  # (n, size)
    goal_x: Array  # (n, size)
    inputs: Array  # (n, legs)
    steps: Array  # (n,): of a planner from one to the other
    falls: Integers  # (n,): as few as possible


@remembered
def switches(scene: Scene, may_fall: bool) -> Switches:
    """Return starts and goals for switching, from the origin of the scene or from anywhere; there may be none."""
    return (_from_anywhere if scene.origin is None else _from_origin)(scene, may_fall)


@remembered
def _all_sheets(scene: Scene) -> Roadmap:
    """Return the roadmap grown from all stable equilibria at home and at inputs spread over the limits."""
    mechanism = scene.mechanism
    count = _SEED_NODES[mechanism.leg_count]
    spans = zip(mechanism.lower_limits, mechanism.upper_limits, strict=True)
    axes = [low + (np.arange(count) + 0.5) / count * (high - low) for low, high in spans]
    nodes = [scene.home.inputs, *np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, mechanism.leg_count)]
    return _roadmap_from(scene, [found for inputs in nodes for found in _stable_at(scene, inputs)])


def _from_anywhere(scene: Scene, may_fall: bool) -> Switches:
    mechanism, numbers = scene.mechanism, np.random.default_rng(0)
    chart = _Chart(scene, may_fall, _all_sheets(scene))
    partners = _partners(chart.roadmap)
    joined = chart.roadmap.components[partners]
    partners = partners[(joined[:, 0] == joined[:, 1]) != may_fall]
    starts = numbers.permutation(np.unique(partners[:, 0]))[: _FALLING_STARTS if may_fall else _STARTS]
    pairs, steps, falls = chart.led_to(starts, partners)
    states = chart.roadmap.states
    inputs = mechanism.units.kernel_from_inputs(chart.roadmap.inputs[pairs[:, 0]])
    return Switches(states[pairs[:, 0]], states[pairs[:, 1]], inputs, steps, falls)


def _from_origin(scene: Scene, may_fall: bool) -> Switches:
    origin = scene.origin
    assert origin is not None
    others = [found for found in _stable_at(scene, origin.inputs) if not np.allclose(found.state, origin.state)]
    chart = _Chart(scene, may_fall, _roadmap_from(scene, [origin, *others]))
    start, *ends = chart.roadmap.seeds
    partners = np.array([(start, end) for end in ends if start >= 0 and end >= 0], dtype=np.int64).reshape(-1, 2)
    pairs, steps, falls = chart.led_to(partners[:1, 0], partners)
    goals = [others[ends.index(end)].state for end in pairs[:, 1].tolist()]
    goal_x = np.array(goals).reshape(-1, scene.mechanism.state_size)
    _, inputs, _ = origin.kernel_values()
    shape = (len(goal_x), 1)
    return Switches(np.tile(origin.state, shape), goal_x, np.tile(inputs, shape), steps, falls)


def _stable_at(scene: Scene, inputs: Array) -> list[Equilibrium]:
    from pcm_gym.solving import solve_forward  # a search that other tasks never make

    rho_max = _RHO_MAX[scene.mechanism.leg_count]
    return list(solve_forward(scene.mechanism, inputs, scene.load, rho_max).stable)


def _roadmap_from(scene: Scene, seeds: list[Equilibrium]) -> Roadmap:
    return build_roadmap(scene.mechanism, seeds, step=scene.step, least_margin=scene.reserve, limits=scene.limits)


class _Chart:
    """The sheets that stable equilibria lie on, and the falls from one to another."""

    def __init__(self, scene: Scene, may_fall: bool, roadmap: Roadmap) -> None:
        self.roadmap = roadmap
        self._falls = find_falls(self.roadmap) if may_fall and len(self.roadmap) else None
        self._steps_per_way = steps_per_way(scene)

    def led_to(self, starts: Integers, partners: Integers) -> tuple[Integers, Array, Integers]:
        """Return those of the `partners`, pairs (n, 2), that a way of the kind wanted joins; its steps and falls."""
        order = np.argsort(partners[:, 0], kind="stable")
        partners = partners[order]
        firsts, lasts = (np.searchsorted(partners[:, 0], starts, side=side) for side in ("left", "right"))
        mine = [partners[first:last] for first, last in zip(firsts, lasts, strict=True)]
        found = self._around(starts, mine) if self._falls is None else self._falling(starts, mine)
        pairs = np.concatenate([partners[:0], *mine])
        steps, falls = (np.concatenate([np.empty(0), *own]) for own in found)
        is_led = np.isfinite(steps)
        return pairs[is_led], steps[is_led], falls[is_led].astype(np.int64)

    def _around(self, starts: Integers, mine: list[Integers]) -> tuple[list[Array], list[Array]]:
        neighbours, steps = all_neighbours(self.roadmap.ways), []
        for start, pairs in zip(starts.tolist(), mine, strict=True):
            ways = ways_from(neighbours, start)[pairs[:, 1]]
            steps.append(np.where(ways == FAR, math.inf, self._steps_per_way * ways))
        return steps, [np.zeros(len(pairs)) for pairs in mine]

    def _falling(self, starts: Integers, mine: list[Integers]) -> tuple[list[Array], list[Array]]:
        steps, falls = [], []
        for first in range(0, len(starts), _AT_ONCE):
            counts = self.roadmap.step_counts(starts[first : first + _AT_ONCE], self._falls)
            for row, pairs in enumerate(mine[first : first + _AT_ONCE]):
                ways, fallen = (own[row, pairs[:, 1]] for own in counts)
                steps.append(np.where(fallen > 0.0, self._steps_per_way * ways, math.inf))
                falls.append(fallen)
        return steps, falls


def _partners(roadmap: Roadmap) -> Integers:
    """Return all ordered pairs (n, 2) of nodes in the same cell."""
    order = np.argsort(roadmap.cells, kind="stable")
    cells, pairs = roadmap.cells[order], [np.empty((0, 2), dtype=np.int64)]
    for apart in range(1, int(np.bincount(cells).max(initial=1))):
        rows = np.flatnonzero(cells[apart:] == cells[:-apart])
        first, second = order[rows], order[rows + apart]
        pairs += [np.column_stack([first, second]), np.column_stack([second, first])]
    return np.concatenate(pairs)
