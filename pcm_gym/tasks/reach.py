"""Reach: bring the end-effector to a goal pose and keep it there, on stable equilibria only."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from pcm_gym.arrays import Integers, Mask
from pcm_gym.kernels.charts.roadmap import move_rows
from pcm_gym.kernels.snaps.instability import TERMINATE
from pcm_gym.kernels.statics.states import States
from pcm_gym.mechanism.validation import one_of
from pcm_gym.tasks.memory import remembered
from pcm_gym.tasks.scene import Scene, nodes_by_sums
from pcm_gym.tasks.task import Episodes, Generators, Task, check_sampling, draw, starts_of

ReachDifficulty = Literal["near", "anywhere", "detour"]

# Steps of the walk from start to a near goal.
_WALK_STEPS = (5, 15)
# Goals at which the start is already are drawn again so many times; after some of them together with the start, from
# which there may be nowhere to walk to.
_ATTEMPTS, _ATTEMPTS_AT_START = 16, 4
# Starts from which detours are sought, goals tried from each, and the most steps of a detour.
_DETOUR_STARTS, _DETOUR_GOALS, _LONGEST_DETOUR = 48, 96, 80


@dataclass(frozen=True)
class Reach(Task):
    """Bring the end-effector to a goal pose and keep it there.

    Starts and goals
    ----------------
    Starts are spread evenly over the poses that stable paths from home reach. Goals are where `difficulty` says, and
    not met at the start; a way without any cost leads to them.

    Attributes
    ----------
    goals : Goals
    difficulty : "near", "anywhere" or "detour"
        Where the goals are. Near: 5 to 15 straight steps from the start, fewer where more would lose stability.
        Anywhere: evenly over the poses that stable paths reach. Detour: where the straight way of the inputs loses
        stability, but another way, of up to 80 steps, does not; refused for mechanisms without such goals.
    """

    difficulty: ReachDifficulty = "near"

    def __post_init__(self) -> None:
        super().__post_init__()
        one_of("difficulty", self.difficulty, ("near", "anywhere", "detour"))

    def sample(self, scene: Scene, generators: Generators, threads: int = 1) -> Episodes:
        """Return episodes whose starts are spread evenly, and whose goals can be reached without any cost."""
        check_sampling(scene, generators, threads)
        if self.difficulty == "detour":
            return self._detours(scene, generators)
        start = starts_of(scene, generators, threads)
        ends = States(*(array.copy() for array in start))
        rows = np.arange(len(generators))
        for attempt in range(_ATTEMPTS):
            chosen = [generators[row] for row in rows.tolist()]
            if attempt >= _ATTEMPTS_AT_START:
                _put(starts_of(scene, chosen, threads), start, rows)
            found = self._ends(scene, States(*(array[rows] for array in start)), chosen, threads)
            _put(found, ends, rows)
            rows = rows[self._at_goal(start, ends, rows)]
            if not len(rows):
                break
        return Episodes(start, self.goals.of_states(ends.x, ends.inputs)[:, None], ends)

    def _ends(self, scene: Scene, start: States, generators: Generators, threads: int) -> States:
        """Return the states at which goals are met, drawn for these starts; `start` may be changed."""
        numbers = draw(generators, 1 + scene.mechanism.leg_count)
        if self.difficulty == "anywhere":
            return scene.starts(numbers, threads)
        scene.walk(start, numbers, _WALK_STEPS, threads)
        return start

    def _at_goal(self, start: States, ends: States, rows: Integers) -> Mask:
        """Return in which of some rows the start is at the goal already."""
        here, there = (self.goals.of_states(states.x[rows], states.inputs[rows]) for states in (start, ends))
        return self.score(here, there)[1]

    def _detours(self, scene: Scene, generators: Generators) -> Episodes:
        pairs = detours(scene)
        chosen = pairs[(draw(generators, 1)[:, 0] * len(pairs)).astype(np.int64)]
        start = scene.at_nodes(chosen[:, 0])
        if scene.origin is not None:
            start = scene.at_equilibrium(scene.origin, len(generators))
        ends = scene.at_nodes(chosen[:, 1])
        return Episodes(start, self.goals.of_states(ends.x, ends.inputs)[:, None], ends)


def _put(found: States, states: States, rows: Integers) -> None:
    for array, values in zip(states, found, strict=True):
        array[rows] = values


@remembered
def detours(scene: Scene) -> Integers:
    """Return pairs (n, 2) of nodes of the roadmap between which a detour is needed, and exists.

    Raises
    ------
    ValueError
        If none is found.
    """
    roadmap, numbers = scene.roadmap, np.random.default_rng(0)
    densities = roadmap.pose_densities
    starts = np.array(roadmap.seeds)
    if scene.origin is None:
        starts = nodes_by_sums(roadmap.pose_density_sums, numbers.random(_DETOUR_STARTS))
    count = _DETOUR_STARTS * _DETOUR_GOALS // len(starts)
    steps, _ = roadmap.step_counts(starts, most=_LONGEST_DETOUR / scene.steps_per_way)
    goals = np.stack([nodes_by_sums(np.cumsum(densities * np.isfinite(row)), numbers.random(count)) for row in steps])
    pairs = np.column_stack([np.repeat(starts, count), goals.ravel()])
    moved, targets = scene.at_nodes(pairs[:, 0]), scene.at_nodes(pairs[:, 1]).inputs
    has_arrived, was_lost = move_rows(scene.mechanism.leg_table, moved, targets, TERMINATE)
    found = pairs[was_lost | ~has_arrived]
    if not len(found):
        raise ValueError(
            f"difficulty must not be 'detour' for mechanism {scene.mechanism.name!r}: "
            "every straight way within the limits that was tried keeps stability"
        )
    return found
