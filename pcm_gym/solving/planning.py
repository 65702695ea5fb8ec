"""Planning motions on stable equilibria."""

from collections.abc import Iterable, Iterator, Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from pcm_gym.arrays import Array, Integers
from pcm_gym.mechanism import Mechanism
from pcm_gym.mechanism.validation import finite_vector, instance_of, number_not_negative, sequence_of
from pcm_gym.solving.equilibrium import Equilibrium
from pcm_gym.solving.limits import LimitName, limits_of
from pcm_gym.solving.motion import Motion, Obstacle, PlanningError
from pcm_gym.solving.motion_goals import Goal, Wanted, carried_over, wanted_of
from pcm_gym.solving.roadmap import Roadmap, build_roadmap, roadmap_raster
from pcm_gym.solving.roadmap_search import RoadmapSearch, Targets
from pcm_gym.solving.straight_ways import StraightWays, Way

# Part of the smallest step that is kept from folds by default.
_LEAST_MARGIN = 0.5
# Mechanisms, loads, steps, margins and limits whose planners are kept for whoever asks again.
_KEPT = 16
# No state has a larger margin.
_LARGEST_MARGIN = 10.0
# Most steps from one limit of an input to the other.
_MOST_STEPS = 10_000


def plan_motion(
    start: Equilibrium,
    goal: Goal,
    mechanism: Mechanism | None = None,
    step: ArrayLike | None = None,
    least_margin: float | None = None,
    limits: Sequence[LimitName] = (),
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
    limits : sequence of "stress", "torque" or "contact"
        Limits of the structure that every equilibrium after the start keeps, see `StructuralLimits`.

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
    margin = _margin(own.units.kernel_from_inputs(steps), least_margin)
    names = limits_of(own, limits).names
    return _planner(own, tuple(start.load.tolist()), tuple(steps.tolist()), margin, names).plan(start, goal)


class MotionPlanner:
    """Plans motions of a mechanism under a load. See `plan_motion`.

    Parameters
    ----------
    mechanism : Mechanism
    load : array_like (d,), optional
        Load on the end-effector, N and N m; none by default.
    step, least_margin, limits
        As for `plan_motion`.
    roadmaps : sequence of Roadmap
        Roadmaps of the mechanism under the load, if there are some; where a start is on none of them, one is grown
        from it.

    Notes
    -----
    When a roadmap is first used all of its steps are tried, and those along several axes at once added: some 10 ms for
    two legs, a second for three. Then many motions together take about 10 ms each.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        load: ArrayLike | None = None,
        step: ArrayLike | None = None,
        least_margin: float | None = None,
        roadmaps: Sequence[Roadmap] = (),
        limits: Sequence[LimitName] = (),
    ) -> None:
        self._mechanism, units = instance_of("mechanism", mechanism, Mechanism), mechanism.units
        self._load, self._step = mechanism.check_load(load), _steps(mechanism, step)
        stride = units.kernel_from_inputs(self._step)
        margin = _margin(stride, least_margin)
        structure = limits_of(mechanism, limits)
        self._ways = StraightWays(mechanism, units.kernel_from_load(self._load), stride, margin, structure)
        self._searches: list[RoadmapSearch] = []
        for roadmap in sequence_of("roadmaps", roadmaps, Roadmap):
            if roadmap.mechanism != mechanism or not np.array_equal(roadmap.load, self._load):
                raise ValueError(f"roadmaps must be of {mechanism.name!r} under the load {self._load.tolist()}")
            self._add(roadmap)

    def plan(self, start: Equilibrium, goal: Goal) -> Motion:
        """Return a motion to a goal; see `plan_motion` for both, and for what is raised if there is none.

        What is not found beside the roadmap is searched for among all equilibria at the goal.
        """
        wanted = Wanted.of(goal, self._mechanism)
        found = None if wanted.is_exact else self.plan_many([start], [goal])[0]
        if found is not None:
            return found
        if not start.is_stable:
            raise PlanningError(Obstacle.UNSTABLE_START, f"its index is {start.index}")
        margin = self._ways.least_margin
        candidates = wanted.equilibria(self._ways.structure, self._load, margin)
        motions = self.plan_many([start] * len(candidates), candidates)
        made = [motion for motion in motions if motion is not None]
        if not made:
            raise self._no_way(start, candidates)
        return min(made, key=lambda motion: motion.length)

    def plan_many(self, starts: Sequence[Equilibrium], goals: Sequence[Goal]) -> list[Motion | None]:
        """Return motions from starts to goals, one to one; None where none is found on the roadmap.

        Other than `plan` it does not ask why, and does not search where the roadmap has nothing near: of the equilibria
        at given inputs only those that are reached compete for being the nearest to a pose.
        """
        starts = sequence_of("starts", starts, Equilibrium)
        wanted = wanted_of(goals, len(starts), self._mechanism)
        found: list[Motion | None] = [None] * len(starts)
        for search, rows, nodes in self._beside(starts):
            here = _way_of([starts[row] for row in rows])
            ways = search.joined(here, nodes, self._targets(search, [wanted[row] for row in rows]))
            led = [(row, way) for row, way in zip(rows, ways, strict=True) if way is not None]
            shortened = self._ways.shortened([way for _, way in led])
            for (row, _), own in zip(led, shortened, strict=True):
                found[row] = None if own is None else self._motion(starts[row], own)
        return found

    def _add(self, roadmap: Roadmap | None) -> None:
        if roadmap is not None and len(roadmap):
            self._searches.append(RoadmapSearch(roadmap, self._ways))

    def _beside(self, starts: Sequence[Equilibrium]) -> Iterator[tuple[RoadmapSearch, list[int], Integers]]:
        """Return searches, for each the starts that are on its roadmap and the nodes beside them."""
        for start in starts:
            if start.mechanism != self._mechanism or not np.array_equal(start.load, self._load):
                raise ValueError(f"starts must be of {self._mechanism.name!r} under the planner's load, got {start!r}")
        left, turn = [row for row, start in enumerate(starts) if start.index == 0], 0
        while left:
            if turn == len(self._searches):
                self._add(_grown_from(starts[left[0]], self._step, self._ways))
            if turn == len(self._searches):  # nothing keeps the margin there
                left = left[1:]
                continue
            search = self._searches[turn]
            nodes = search.nodes_beside(_way_of([starts[row] for row in left]))
            on_it = np.flatnonzero(nodes >= 0)
            if len(on_it):
                yield search, [left[place] for place in on_it.tolist()], nodes[on_it]
            left, turn = [row for row, node in zip(left, nodes.tolist(), strict=True) if node < 0], turn + 1

    def _motion(self, start: Equilibrium, way: Way) -> Motion:
        inputs = self._mechanism.units.inputs_from_kernel(way.inputs)
        inputs[0] = start.inputs
        return Motion(self._mechanism, self._load, inputs, way.x)

    def _targets(self, search: RoadmapSearch, wanted: Sequence[Wanted]) -> Targets:
        """Return the equilibria that meet goals, as far as straight ways lead to them from nodes."""
        units = self._mechanism.units
        parts: list[tuple[Iterable[int], Targets]] = []
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
        inputs, margin = [np.round(goal.inputs, 6).tolist() for goal in goals], self._ways.least_margin
        if not any(True for _ in self._beside([start])):
            details = f"least_margin {margin:.3g}; the start has {start.singularity_margin:.3g}"
            return PlanningError(Obstacle.START_MARGIN, details)
        names = self._ways.structure.names
        if names and self._leads(margin, (), start, goals):
            return PlanningError(Obstacle.STRUCTURE_ON_THE_WAY, f"limits {names}; goals at inputs {inputs}")
        if margin > 0.0 and self._leads(0.0, names, start, goals):
            return PlanningError(Obstacle.MARGIN_ON_THE_WAY, f"least_margin {margin:.3g}; goals at inputs {inputs}")
        return PlanningError(Obstacle.OTHER_SHEET, f"goals at inputs {inputs}")

    def _leads(
        self, margin: float, limits: Sequence[LimitName], start: Equilibrium, goals: Sequence[Equilibrium]
    ) -> bool:
        """Return whether a way would lead to one of the goals with another margin or other limits."""
        free = MotionPlanner(self._mechanism, self._load, self._step, margin, limits=limits)
        return any(motion is not None for motion in free.plan_many([start] * len(goals), goals))


def _way_of(equilibria: Sequence[Equilibrium]) -> Way:
    values = [own.kernel_values() for own in equilibria]
    return Way(np.array([x for x, _, _ in values]), np.array([inputs for _, inputs, _ in values]))


def _steps(mechanism: Mechanism, step: ArrayLike | None) -> Array:
    if step is None:
        return mechanism.units.inputs_from_kernel(np.array([leg.actuator.default_step for leg in mechanism.legs]))
    steps = finite_vector("step", step, mechanism.leg_count)
    if not (steps > 0.0).all():
        raise ValueError(f"step must be greater than 0, got {steps.tolist()}")
    counts = (mechanism.upper_limits - mechanism.lower_limits) / steps
    if not counts.max() <= _MOST_STEPS:
        raise ValueError(f"step must be at least 1/{_MOST_STEPS} of the range of each input, got {steps.tolist()}")
    return steps


def _margin(stride: Array, least_margin: float | None) -> float:
    if least_margin is None:
        return _LEAST_MARGIN * float(stride.min())
    margin = number_not_negative("least_margin", least_margin)
    if margin > _LARGEST_MARGIN:
        raise ValueError(f"least_margin must be at most {_LARGEST_MARGIN:g}, the largest there is, got {least_margin}")
    return margin


def _grown_from(start: Equilibrium, step: Array, ways: StraightWays) -> Roadmap | None:
    """Return the roadmap around a start, from the middles of cells beside it; None where no way leads to one."""
    mechanism, (x, inputs, _) = start.mechanism, start.kernel_values()
    raster = roadmap_raster(mechanism, step)
    nodes = raster.nodes(raster.cells_around(start.inputs))
    count = (len(nodes), 1)
    reached, arrives = ways.walked(np.tile(x, count), np.tile(inputs, count), mechanism.units.kernel_from_inputs(nodes))
    seeds = [
        Equilibrium.unchecked(mechanism, reached[n], nodes[n], start.load) for n in np.flatnonzero(arrives).tolist()
    ]
    if not seeds:
        return None
    return build_roadmap(mechanism, seeds, step=step, least_margin=ways.least_margin, limits=ways.structure.names)


@lru_cache(maxsize=_KEPT)
def _planner(
    mechanism: Mechanism,
    load: tuple[float, ...],
    step: tuple[float, ...],
    least_margin: float,
    limits: tuple[LimitName, ...],
) -> MotionPlanner:
    """Return the planner of a mechanism, always the same one for the same arguments."""
    return MotionPlanner(mechanism, load, step, least_margin, limits=limits)
