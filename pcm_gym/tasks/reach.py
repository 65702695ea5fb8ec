"""Reach: bring the end-effector to a goal pose and keep it there, on stable equilibria only."""

from dataclasses import dataclass
from typing import ClassVar, Literal, get_args

import numpy as np

from pcm_gym.arrays import Mask
from pcm_gym.kernels.statics.states import States
from pcm_gym.mechanism.validation import one_of
from pcm_gym.tasks.distances import distances
from pcm_gym.tasks.memory import remembered
from pcm_gym.tasks.scene import Scene
from pcm_gym.tasks.task import Episodes, Generators, Task, check_sampling, draw, draw_until, starts_of

ReachDifficulty = Literal["near", "anywhere", "detour", "rig"]

# Steps of the walk from start to a near goal.
_WALK_STEPS = (5, 15)
# The most steps that a planner needs to a goal, and to one on a rig, whose actuators take some more.
_LONGEST, _LONGEST_ON_RIG = 80.0, 60.0
# Pairs that are looked at for detours, and the least share of them without which there is no such task.
_TRIED, _LEAST_SHARE = 512, 0.02


@dataclass(frozen=True)
class Reach(Task):
    """Bring the end-effector to a goal pose and keep it there.

    Starts and goals
    ----------------
    Starts are spread evenly over the poses that stable paths from home reach. Goals are where `difficulty` says, and
    not met at the start; a way without any cost leads to them, of at most 80 steps of a planner, on a rig 60.

    Attributes
    ----------
    goals : Goals
    difficulty : "anywhere", "near", "detour" or "rig"
        Where the goals are. Anywhere: evenly over the poses that stable paths reach. Near, the easy tier: 5 to 15
        straight steps from the start, fewer where more would lose stability. Detour: where the straight way of the
        inputs does not lead, but another way does; refused for mechanisms with hardly any such goals. Rig: such goals
        too, or any where there are none, with what a real rig adds, see `pcm_gym.environments.rig`.
    """

    has_split: ClassVar[bool] = True

    difficulty: ReachDifficulty = "anywhere"

    def __post_init__(self) -> None:
        super().__post_init__()
        one_of("difficulty", self.difficulty, get_args(ReachDifficulty))

    def sample(self, scene: Scene, generators: Generators, threads: int = 1) -> Episodes:
        """Return episodes whose starts are spread evenly, and whose goals can be reached without any cost."""
        check_sampling(scene, generators, threads)
        if self.difficulty == "detour" and detour_share(scene) < _LEAST_SHARE:
            raise ValueError(
                f"difficulty must not be 'detour' for mechanism {scene.mechanism.name!r}: straight ways within the "
                f"limits lead to {100.0 * (1.0 - detour_share(scene)):.1f} % of {_TRIED} goals"
            )

        def drawn(chosen: Generators) -> tuple[Episodes, Mask]:
            start, ends, is_fit = self._pairs(scene, chosen, threads)
            here, there = (self.goals.of_states(states.x, states.inputs) for states in (start, ends))
            return Episodes(start, there[:, None], ends), is_fit & ~self._scored(here, there)[1]

        what = f"difficulty {self.difficulty!r} and success_distance {self.goals.success_distance} must leave goals"
        return draw_until(drawn, generators, f"{what} that are not met at the start")

    def _wants_detours(self, scene: Scene) -> bool:
        return self.difficulty == "detour" or (self.difficulty == "rig" and detour_share(scene) >= _LEAST_SHARE)

    def _pairs(self, scene: Scene, generators: Generators, threads: int) -> tuple[States, States, Mask]:
        """Return starts, ends, and which of them are of the kind wanted."""
        if self.difficulty == "near":
            start = starts_of(scene, generators, threads)
            ends = States(*(array.copy() for array in start))
            scene.walk(ends, draw(generators, 1 + scene.mechanism.leg_count), _WALK_STEPS, threads)
            return start, ends, np.ones(len(generators), dtype=np.bool_)
        longest = _LONGEST_ON_RIG if self.difficulty == "rig" else _LONGEST
        start, ends, is_fit = anywhere(scene, generators, threads, longest)
        if self._wants_detours(scene):
            rows = np.flatnonzero(is_fit)
            here, there = (States(*(array[rows] for array in states)) for states in (start, ends))
            is_fit[rows] = ~scene.leads_straight(here, there, threads)
        return start, ends, is_fit


def anywhere(
    scene: Scene, generators: Generators, threads: int, longest: float = _LONGEST
) -> tuple[States, States, Mask]:
    """Return starts and ends spread evenly over what stable ways reach, and which are up to so many steps apart."""
    count, legs, roadmap = len(generators), scene.mechanism.leg_count, scene.roadmap
    numbers = draw(generators, 2 + 2 * legs)
    goals = scene.nodes(numbers[:, 0])
    ends = scene.beside(goals, numbers[:, 1 : 1 + legs], threads)
    if scene.origin is not None:
        starts, start = np.full(count, roadmap.seeds[0]), scene.at_equilibrium(scene.origin, count)
    else:
        starts = scene.nodes(numbers[:, 1 + legs])
        start = scene.beside(starts, numbers[:, 2 + legs :], threads)
    # each is up to half a way off its node
    own = distances(scene)
    return start, ends, own.most(starts, goals) + own.steps_per_way <= longest


@remembered
def detour_share(scene: Scene) -> float:
    """Return the share of the goals anywhere to which no straight way leads, of some that are tried."""
    generators = [np.random.default_rng([0, n]) for n in range(_TRIED)]
    start, ends, is_fit = anywhere(scene, generators, 1)
    return float(np.mean(is_fit & ~scene.leads_straight(start, ends)))
