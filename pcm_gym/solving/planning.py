"""Planning motions on stable equilibria."""

from collections.abc import Sequence
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import ArrayLike

from pcm_gym.arrays import Array
from pcm_gym.mechanism import Mechanism
from pcm_gym.mechanism.validation import finite_vector, instance_of, number_not_negative, sequence_of, shown
from pcm_gym.solving.equilibrium import Equilibrium
from pcm_gym.solving.motion import Motion, Obstacle, PlanningError
from pcm_gym.solving.motion_goals import Goal, Wanted, carried_over
from pcm_gym.solving.roadmap import Roadmap, build_roadmap, roadmap_raster
from pcm_gym.solving.roadmap_search import RoadmapSearch, Targets
from pcm_gym.solving.straight_ways import StraightWays, Way

# Part of the smallest step that is kept from folds by default.
_LEAST_MARGIN = 0.5
# Mechanisms, loads, steps and margins whose planners are kept for whoever asks again.
_KEPT = 16


def plan_motion(
    start: Equilibrium,
    goal: Goal,
    mechanism: Mechanism | None = None,
    step: ArrayLike | None = None,
    least_margin: float | None = None,
) -> Motion:
    """Return a short motion from a stable equilibrium to a goal that never loses stability.

    It is a shortest way on the roadmap, shortened off its raster: straight ways of the inputs take the place of its
    corners as far as they keep stability and margin, and the whole is divided anew into steps. No motion has more steps
    than the way on the roadmap, but it need not be the shortest of all. The tracker has followed each of its steps.

    Parameters
    ----------
    start : Equilibrium
        A stable one. Its load is that of the whole motion.
    goal : array_like (d,), mapping or Equilibrium
        A pose in m and rad, or ``{"pose": pose}``, in any working mode; ``{"inputs": inputs}``, rad or m, in any
        assembly mode; with both keys, of the equilibria at these inputs the one that is nearest to the pose; or one
        equilibrium.
    mechanism : Mechanism, optional
        Another mechanism to be moved, such as the true one where `start` is of a nominal one. Start and goal are
        carried over to it: they become its stable equilibria at the same inputs that are nearest in rod loads and pose.
    step : array_like (legs,), optional
        Longest step along each input, rad or m; a step may go that far along all of them at once. By default what
        environments have: 0.1 rad and 0.03 mean rod lengths.
    least_margin : float, optional
        Singularity margin of every equilibrium after the start, in rad and mean rod lengths. By default half of the
        smallest step, below which environments call a state nearly singular.

    Returns
    -------
    Motion

    Raises
    ------
    PlanningError
        If there is none; `obstacle` says why.
    TypeError, ValueError
        If an argument is of the wrong kind, shape or range, or of another mechanism.

    Notes
    -----
    The roadmap is grown once for a mechanism, load, step and margin, in 0.1 s for two legs and some seconds for three;
    it is kept, and then a motion takes some 10 ms. To plan many at once is cheaper still: see `MotionPlanner`.
    """
    start = instance_of("start", start, Equilibrium)
    if mechanism is not None and instance_of("mechanism", mechanism, Mechanism) != start.mechanism:
        start = carried_over(start, mechanism, "start")
    own = start.mechanism
    steps = _steps(own, step)
    smallest = float(own.units.kernel_from_inputs(steps).min())
    margin = _LEAST_MARGIN * smallest if least_margin is None else number_not_negative("least_margin", least_margin)
    if not start.is_stable:
        raise PlanningError(Obstacle.UNSTABLE_START, f"its index is {start.index}")
    planners = _planners(own, tuple(start.load.tolist()), tuple(steps.tolist()), margin)
    for planner in planners:
        if planner.covers(start):
            return planner.plan(start, goal)
    planner = MotionPlanner(_grown_from(start, steps, margin), steps, margin)
    if not planner.covers(start):
        raise PlanningError(Obstacle.START_MARGIN, f"{margin:.3g}; the start has {start.singularity_margin:.3g}")
    planners.append(planner)
    return planner.plan(start, goal)


class MotionPlanner:
    """Plans motions on one roadmap.

    Parameters
    ----------
    roadmap : Roadmap
    step : array_like (legs,), optional
        Longest step along each input, rad or m; by default as for `plan_motion`.
    least_margin : float, optional
        Singularity margin that is kept after each step, in rad and mean rod lengths; the roadmap's by default.

    Notes
    -----
    With the first plan all steps between nodes are tried, and those along several axes at once added: some 10 ms for
    two legs, a second for three. Many motions together take about 2 ms each.
    """

    def __init__(self, roadmap: Roadmap, step: ArrayLike | None = None, least_margin: float | None = None) -> None:
        mechanism = instance_of("roadmap", roadmap, Roadmap).mechanism
        self.roadmap, self.step = roadmap, _steps(mechanism, step)
        margin = roadmap.least_margin if least_margin is None else least_margin
        self.least_margin = number_not_negative("least_margin", margin)
        self._mechanism, units = mechanism, mechanism.units
        stride, load = units.kernel_from_inputs(self.step), units.kernel_from_load(roadmap.load)
        self._ways = StraightWays(mechanism, load, stride, self.least_margin)

    @cached_property
    def _search(self) -> RoadmapSearch:
        return RoadmapSearch(self.roadmap, self._ways)

    def covers(self, equilibrium: Equilibrium) -> bool:
        """Return whether a straight way leads from an equilibrium to the roadmap."""
        self._check("equilibrium", equilibrium)
        return bool(len(self.roadmap)) and bool(self._search.nodes_beside(_way_of([equilibrium]))[0] >= 0)

    def plan(self, start: Equilibrium, goal: Goal) -> Motion:
        """Return a motion to a goal; see `plan_motion` for both, and for what is raised if there is none.

        What is not found beside the roadmap is searched for among all equilibria at the goal.
        """
        found = self.plan_many([start], [goal])[0]
        if found is not None:
            return found
        candidates = Wanted.of(goal, self._mechanism).equilibria(
            self._mechanism, self.roadmap.load, self.least_margin
        )
        motions = self.plan_many([start] * len(candidates), candidates)
        made = [motion for motion in motions if motion is not None]
        if not made:
            raise self._no_way(start, candidates)
        return min(made, key=lambda motion: motion.length)

    def plan_many(self, starts: Sequence[Equilibrium], goals: Sequence[Goal]) -> list[Motion | None]:
        """Return motions from starts to goals, one to one; None where none is found on the roadmap.

        Other than `plan` it does not ask why, and does not search where the roadmap has nothing near.
        """
        starts = sequence_of("starts", starts, Equilibrium)
        for start in starts:
            self._check("starts", start)
        wanted = [Wanted.of(goal, self._mechanism) for goal in goals]
        if len(wanted) != len(starts):
            raise ValueError(f"goals must be as many as the starts, {len(starts)}, got {len(wanted)}")
        if not (len(starts) and len(self.roadmap)):
            return [None] * len(starts)
        here = _way_of(starts)
        ways = self._search.joined(here, self._search.nodes_beside(here), self._targets(wanted))
        rows = [row for row, way in enumerate(ways) if way is not None]
        found: list[Motion | None] = [None] * len(starts)
        shortened = self._ways.shortened([way for way in ways if way is not None])
        for row, way in zip(rows, shortened, strict=True):
            found[row] = None if way is None else self._motion(starts[row], way)
        return found

    def _check(self, name: str, equilibrium: Equilibrium) -> None:
        own = instance_of(name, equilibrium, Equilibrium)
        if own.mechanism != self._mechanism:
            raise ValueError(f"{name} must be of {self._mechanism.name!r}, got {shown(equilibrium)}")
        if not np.array_equal(own.load, self.roadmap.load):
            raise ValueError(f"{name} must bear the load {self.roadmap.load.tolist()}, got {own.load.tolist()}")

    def _motion(self, start: Equilibrium, way: Way) -> Motion:
        inputs = self._mechanism.units.inputs_from_kernel(way.inputs)
        inputs[0] = start.inputs
        return Motion(self._mechanism, self.roadmap.load, inputs, way.x)

    def _targets(self, wanted: Sequence[Wanted]) -> Targets:
        """Return the equilibria that meet goals, as far as straight ways lead to them from nodes."""
        units, search, parts = self._mechanism.units, self._search, []
        equilibria = {row: own.equilibrium for row, own in enumerate(wanted) if own.equilibrium is not None}
        inputs = {row: units.kernel_from_inputs(own.inputs) for row, own in enumerate(wanted) if own.inputs is not None}
        poses = {row: units.kernel_from_pose(own.pose) for row, own in enumerate(wanted) if own.pose is not None}
        only_poses = {row: pose for row, pose in poses.items() if row not in inputs}
        if equilibria:
            parts.append((equilibria, search.at_equilibria(_way_of(list(equilibria.values())))))
        if inputs:
            nearest = [poses.get(row) for row in inputs]
            parts.append((inputs, search.at_inputs(np.array(list(inputs.values())), nearest)))
        if only_poses:
            parts.append((only_poses, search.at_poses(np.array(list(only_poses.values())))))
        return Targets(
            np.concatenate([np.array(list(rows))[found.goal] for rows, found in parts]),
            np.concatenate([found.node for _, found in parts]),
            Way(
                np.concatenate([found.way.x for _, found in parts]),
                np.concatenate([found.way.inputs for _, found in parts]),
            ),
        )

    def _no_way(self, start: Equilibrium, goals: Sequence[Equilibrium]) -> PlanningError:
        """Return what to raise where goals are sound but no way leads there from the start."""
        inputs = [np.round(goal.inputs, 6).tolist() for goal in goals]
        if not self.covers(start):
            details = f"{self.least_margin:.3g}; the start has {start.singularity_margin:.3g}"
            return PlanningError(Obstacle.START_MARGIN, details)
        if self.least_margin > 0.0:
            free = MotionPlanner(build_roadmap(self._mechanism, [start], self.step), self.step)
            if any(motion is not None for motion in free.plan_many([start] * len(goals), goals)):
                return PlanningError(Obstacle.MARGIN_ON_THE_WAY, f"{self.least_margin:.3g}; goals at inputs {inputs}")
        return PlanningError(Obstacle.OTHER_SHEET, f"goals at inputs {inputs}")


def _way_of(equilibria: Sequence[Equilibrium]) -> Way:
    values = [own.kernel_values() for own in equilibria]
    return Way(np.array([x for x, _, _ in values]), np.array([inputs for _, inputs, _ in values]))


def _steps(mechanism: Mechanism, step: ArrayLike | None) -> Array:
    if step is None:
        return mechanism.units.inputs_from_kernel(np.array([leg.actuator.default_step for leg in mechanism.legs]))
    steps = finite_vector("step", step, mechanism.leg_count)
    if not (steps > 0.0).all():
        raise ValueError(f"step must be greater than 0, got {steps.tolist()}")
    return steps


def _grown_from(start: Equilibrium, step: Array, least_margin: float) -> Roadmap:
    """Return the roadmap around a start: grown from it, or from the middle of a cell beside it."""
    mechanism = start.mechanism
    roadmap = build_roadmap(mechanism, [start], step, least_margin)
    if len(roadmap):
        return roadmap
    units, raster = mechanism.units, roadmap_raster(mechanism, step)
    ways = StraightWays(
        mechanism, units.kernel_from_load(start.load), units.kernel_from_inputs(step), least_margin
    )
    x, inputs, _ = start.kernel_values()
    nodes = raster.nodes(raster.cells_around(start.inputs))
    targets = units.kernel_from_inputs(nodes)
    reached, arrives = ways.walked(np.tile(x, (len(nodes), 1)), np.tile(inputs, (len(nodes), 1)), targets)
    seeds = [
        Equilibrium.unchecked(mechanism, reached[n], nodes[n], start.load) for n in np.flatnonzero(arrives).tolist()
    ]
    return build_roadmap(mechanism, seeds, step, least_margin) if seeds else roadmap


@lru_cache(maxsize=_KEPT)
def _planners(
    mechanism: Mechanism, load: tuple[float, ...], step: tuple[float, ...], least_margin: float
) -> list[MotionPlanner]:
    """Return the planners made so far for these, a new list for new ones."""
    return []
