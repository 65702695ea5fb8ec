"""The search for every branch of equilibria along a straight line in inputs and load."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import brentq

from pcm_gym.arrays import Array, Integers
from pcm_gym.kernels.branches.curves import is_on_path, point_beside, polish
from pcm_gym.kernels.branches.problem import Problem
from pcm_gym.kernels.branches.ways import (
    ENERGY,
    FACT_COLUMNS,
    LARGEST_RHO,
    MORSE_INDEX,
    SINGULARITY_MARGIN,
    STABILITY_MARGIN,
    describe_way,
)
from pcm_gym.kernels.numerics.slices import slices as parts
from pcm_gym.mechanism import Mechanism
from pcm_gym.mechanism.validation import (
    finite_array,
    instance_of,
    mapping,
    one_of,
    positive_number,
    shape_of,
    shown,
    truth_value,
    whole_number,
)
from pcm_gym.solving.branch_points import Crossing, crossing_at, points_beside
from pcm_gym.solving.diagram import BifurcationDiagram, DiagramBranch, Slice, SpecialKind, SpecialPoint, Way
from pcm_gym.solving.enumeration import solve_forward
from pcm_gym.solving.progress import progress_bars
from pcm_gym.solving.singular_curve import CurveEnd
from pcm_gym.solving.traced import Traced, trace

_SLICES, _MOST_SLICES = 24, 10_000
# Part of the distance of slices by which they are shifted, lest they lie on the symmetries of symmetric mechanisms.
_SHIFT = 0.382
# Branches are followed up to this multiple of the largest load, beyond which they may turn and come back.
_REACH = 1.5
# Points that are described in one call of compiled code.
_POINTS_AT_ONCE = 1 << 9
# Special points of two branches that are nearer, in fraction and state, are one.
_SAME_FRACTION, _SAME_STATE = 1e-6, 1e-3
# Vertices whose parameters differ by less are at one end of the way.
_SAME_PLACE = 1e-8


def bifurcation_diagram(
    mechanism: Mechanism,
    along: Mapping[str, ArrayLike],
    rho_max: float = 9.0,
    *,
    slices: int = _SLICES,
    certify: bool = False,
    progress: bool = False,
) -> BifurcationDiagram:
    """Return every equilibrium along a straight line in inputs and load: branches, folds and where branches cross.

    Complete sets of equilibria are found at slices of the line, the two ends among them. Each equilibrium that is on no
    branch yet is followed to both sides, through all folds, until its branch leaves the line or closes; where another
    branch crosses, that is followed as well.

    Parameters
    ----------
    mechanism : Mechanism
    along : mapping of "inputs" and "load" to array_like
        From where to where: ``{"inputs": (first, last)}``, ``{"load": (first, last)}`` or both. What is given by one
        vector, ``{"inputs": inputs, "load": (first, last)}``, is held there; what is not named is held at home, or no
        load. Inputs in rad or m, load in N and N m. Limits are not checked.
    rho_max : float
        Largest dimensionless load ``L sqrt(|f| / EI)`` of any rod, up to 30.
    slices : int
        Complete sets to be found, besides those at the ends; by default 24.
    certify : bool
        Whether to prove that these sets are complete (two legs only); `Slice.is_proved` tells of which that is known.
    progress : bool
        Whether to show a progress bar.

    Returns
    -------
    BifurcationDiagram

    Raises
    ------
    TypeError, ValueError
        If an argument has the wrong kind or shape, is not finite or out of range, or nothing changes along the line.
    SearchBudgetError
        If the search at a slice meets its budget; see `search_budget`.

    Notes
    -----
    What is missed is a branch that meets no slice within `rho_max`: a loop between two of them that crosses no other
    branch. More slices confirm that there is none. Families of equilibria that are not isolated are left out. Special
    points are exact to about 1e-10 of the way. About a second for two legs; a platform takes as long as
    `solve_forward` takes on each slice.
    """
    way = _checked_way(instance_of("mechanism", mechanism, Mechanism), along)
    search = _Search(way, positive_number("rho_max", rho_max))
    count = whole_number("slices", slices, least=1, most=_MOST_SLICES)
    truth_value("certify", certify)
    places = [0.0, *((np.arange(count) + _SHIFT) / count).tolist(), 1.0]
    with progress_bars("bifurcation diagram", truth_value("progress", progress)) as bars:
        found = [search.examine(place, certify=certify) for place in bars.track(places, description="slices")]
    return search.diagram(tuple(found))


def _checked_way(mechanism: Mechanism, along: Mapping[str, ArrayLike]) -> Way:
    given = {one_of("along key", key, ("inputs", "load")): value for key, value in mapping("along", along).items()}
    home = mechanism.home_inputs
    inputs = _ends("along['inputs']", given.get("inputs", home), mechanism.leg_count)
    load = given.get("load", np.zeros(mechanism.dof))
    way = Way(mechanism, inputs, _ends("along['load']", load, mechanism.dof))
    if not 0.0 < way.length < np.inf:
        raise ValueError(f"along must lead from one place to another, got {shown(along)}")
    return way


def _ends(name: str, value: Any, size: int) -> Array:
    """Return first and last vector, (2, size)."""
    if len(shape_of(value)) == 1:
        return np.tile(finite_array(name, value, (size,)), (2, 1))
    return finite_array(name, value, (2, size))


@dataclass
class _Search:
    """The branches found so far."""

    way: Way
    rho_max: float
    branches: list[DiagramBranch] = field(default_factory=list)
    crossings: list[dict[int, Crossing]] = field(default_factory=list)  # of each branch, by vertex

    @cached_property
    def problem(self) -> Problem:
        """The curves that are followed."""
        return self.way.problem(_REACH * self.rho_max)

    def examine(self, fraction: float, *, certify: bool) -> Slice:
        """Find all equilibria at a fraction of the way, and follow those that are on no branch yet."""
        way = self.way
        inputs, load = way.inputs_at(fraction), way.load_at(fraction)
        found = solve_forward(way.mechanism, inputs, load, self.rho_max, certify=certify)
        known = [own for branch in self.branches for own in branch.at(fraction)]
        unfollowed = []
        for equilibrium in found:
            y = np.append(equilibrium.state, fraction * way.length)
            if self.way.is_among(equilibrium.state, known) or self._is_on_any(y):
                continue
            known += [own for branch in self._follow(y) for own in branch.at(fraction)]
            if not (self.way.is_among(equilibrium.state, known) or self._is_on_any(y)):
                unfollowed.append(equilibrium)
        is_proved = found.certificate is not None and found.certificate.is_proved
        return Slice(fraction, len(found), is_proved, tuple(unfollowed))

    def diagram(self, found: tuple[Slice, ...]) -> BifurcationDiagram:
        """Return what was found, without what is beyond the largest load."""
        branches: list[DiagramBranch] = []
        crossings: list[dict[int, Crossing]] = []
        for branch, crossed in zip(self.branches, self.crossings, strict=True):
            for within, vertices in self._within(branch):
                branches.append(within)
                crossings.append({vertices.index(k): own for k, own in crossed.items() if k in vertices})
        order = sorted(range(len(branches)), key=lambda n: _first_energy(branches[n]))
        ordered = tuple(branches[n] for n in order)
        points = _special_points(ordered, [crossings[n] for n in order])
        return BifurcationDiagram(self.way, self.rho_max, ordered, points, found)

    def _follow(self, y: Array) -> list[DiagramBranch]:
        """Follow the branch through a point, and those that cross it, and return them."""
        legs, added, starts = self.way.mechanism.leg_table, [], [y]
        while starts:
            start = starts.pop()
            if self._is_on_any(start):
                continue
            traced = trace(legs, self.problem, start)
            if len(traced.path) < 2:
                continue
            branch = self._branch(self._with_exact_ends(traced))
            crossed = {k: self._crossing(branch, k) for k in branch.special if _fold_indices(branch, k) is None}
            self.branches.append(branch)
            self.crossings.append(crossed)
            added.append(branch)
            for k, crossing in crossed.items():
                beside = points_beside(legs, branch.path[k], crossing, self.problem)
                starts += [own for own in beside if 0.0 <= own[-1] <= self.way.length]
        return added

    def _is_on_any(self, y: Array) -> bool:
        """Return whether a point is on a branch that was followed already."""
        legs, problem = self.way.mechanism.leg_table, self.problem
        return any(is_on_path(legs, y, problem, own.path, own.tangents) for own in self.branches)

    def _crossing(self, branch: DiagramBranch, k: int) -> Crossing:
        along = branch.path[min(k + 1, len(branch) - 1)] - branch.path[max(k - 1, 0)]
        return crossing_at(self.way.mechanism.leg_table, branch.path[k], along, self.problem)

    def _with_exact_ends(self, traced: Traced) -> Traced:
        """Return a curve whose vertices at the ends of the way are there exactly, and once."""
        path, kept = traced.path.copy(), np.ones(len(traced.path), dtype=np.bool_)
        upright = np.zeros(path.shape[1])
        upright[-1] = 1.0
        for end, inner, met in ((0, 1, traced.ends[0]), (-1, -2, traced.ends[1])):
            if met is not CurveEnd.BOUNDS:
                continue
            path[end, -1] = 0.0 if path[end, -1] < 0.5 * self.way.length else self.way.length
            polish(self.way.mechanism.leg_table, path[end], upright, self.problem)
            if len(path) > 2 and abs(path[inner, -1] - path[end, -1]) < _SAME_PLACE:
                kept[inner] = False
        return Traced(path[kept], traced.tangents[kept], traced.marks[kept], traced.ends)

    def _branch(self, traced: Traced) -> DiagramBranch:
        way, path = self.way, traced.path
        facts = np.empty((len(path), FACT_COLUMNS))
        for first, last in parts(len(path), _POINTS_AT_ONCE):
            describe_way(way.mechanism.leg_table, path[first:last], self.problem, facts[first:last])
        indices = facts[:, MORSE_INDEX].astype(np.int64)
        for k in np.flatnonzero(traced.marks).tolist():  # where rounding decides
            indices[k] = indices[max(k - 1, 0)]
        marks = traced.marks.copy()
        marks[1:] |= (np.diff(indices) != 0) & ~marks[:-1]  # where what changed the index could not be met
        special = tuple(np.flatnonzero(marks).tolist())
        return DiagramBranch(
            way,
            path[:, :-1].copy(),
            path[:, -1] / way.length,
            traced.tangents,
            facts[:, ENERGY] * way.mechanism.units.energy,
            indices,
            facts[:, STABILITY_MARGIN],
            facts[:, SINGULARITY_MARGIN],
            facts[:, LARGEST_RHO],
            special,
            traced.ends,
        )

    def _within(self, branch: DiagramBranch) -> Iterator[tuple[DiagramBranch, list[int]]]:
        """Yield the parts of a branch within the largest load, with the numbers that their vertices had, -1: none."""
        is_within = branch.largest_rhos <= self.rho_max
        if is_within.all():
            yield branch, list(range(len(branch)))
            return
        order: Integers = np.arange(len(branch), dtype=np.int64)
        if branch.ends[1] is CurveEnd.CLOSED:  # begins anew outside
            outside = int(np.argmin(is_within))
            order = np.append(np.roll(order[:-1], -outside), outside)
        within = np.flatnonzero(is_within[order])
        for run in np.split(within, np.flatnonzero(np.diff(within) > 1) + 1):
            if len(run):
                yield self._cut(branch, order, int(run[0]), int(run[-1]))

    def _cut(self, branch: DiagramBranch, order: Integers, first: int, last: int) -> tuple[DiagramBranch, list[int]]:
        """Return the vertices from `first` to `last` in an order, with the points at the largest load beyond them."""
        vertices = order[first : last + 1].tolist()
        path = [branch.path[k] for k in vertices]
        tangents = [branch.tangents[k] for k in vertices]
        ends = [branch.ends[0], branch.ends[1]]
        for side, inner, outer in ((0, first, first - 1), (-1, last, last + 1)):
            if not 0 <= outer < len(order):
                continue
            beyond = self._at_largest_load(branch, int(order[inner]), outer > inner)
            ends[side] = CurveEnd.LARGEST_LOAD
            if beyond is not None:
                place = 0 if side == 0 else len(path)
                path.insert(place, beyond[0])
                tangents.insert(place, beyond[1])
                vertices.insert(place, -1)
        marks = np.isin(vertices, branch.special)
        return self._branch(Traced(np.array(path), np.array(tangents), marks, (ends[0], ends[1]))), vertices

    def _at_largest_load(self, branch: DiagramBranch, inner: int, is_ahead: bool) -> tuple[Array, Array] | None:
        """Return point and tangent where the branch reaches the largest load next to a vertex; None if not found."""
        y, tangent = branch.path[inner], branch.tangents[inner].copy()
        beside, there = np.empty_like(y), np.empty_like(y)
        legs, sign = self.way.mechanism.leg_table, 1.0 if is_ahead else -1.0

        def excess(arc: float) -> float:
            if not point_beside(legs, y, tangent, sign * arc, self.problem, beside, there):
                return np.nan
            return float(np.sqrt(np.hypot(*beside[: 2 * len(legs)].reshape(-1, 2).T).max())) - self.rho_max

        arc = 1e-3
        while excess(arc) < 0.0 and arc < 1.0:
            arc *= 2.0
        if not (excess(arc) >= 0.0 > excess(0.0)):
            return None
        excess(float(brentq(excess, 0.0, arc, xtol=1e-12)))
        return beside, there


def _fold_indices(branch: DiagramBranch, k: int) -> tuple[int, int] | None:
    """Return the indices before and after a vertex if it is a fold: the way turns round and the index changes by 1."""
    before, after = max(k - 1, 0), min(k + 1, len(branch) - 1)
    is_turn = (branch.fractions[k] - branch.fractions[before]) * (branch.fractions[after] - branch.fractions[k]) < 0.0
    indices = int(branch.indices[before]), int(branch.indices[after])
    return indices if is_turn and abs(indices[1] - indices[0]) == 1 else None


def _first_energy(branch: DiagramBranch) -> tuple[bool, float]:
    stable = np.flatnonzero(branch.is_stable)
    return (False, float(branch.energies[stable[0]])) if len(stable) else (True, float(branch.energies[0]))


def _special_points(
    branches: tuple[DiagramBranch, ...], crossings: list[dict[int, Crossing]]
) -> tuple[SpecialPoint, ...]:
    """Return the special points, those of several branches once."""
    points: list[SpecialPoint] = []
    for number, (branch, crossed) in enumerate(zip(branches, crossings, strict=True)):
        for k in branch.special:
            own = crossed.get(k)
            before, after = max(k - 1, 0), min(k + 1, len(branch) - 1)
            point = SpecialPoint(
                SpecialKind.FOLD if own is None else own.kind,
                float(branch.fractions[k]),
                branch.equilibrium(k),
                ((number, k),),
                (int(branch.indices[before]), int(branch.indices[after])),
            )
            place = next((n for n, other in enumerate(points) if _is_one_point(point, other)), None)
            if own is None or place is None:
                points.append(point)
            else:
                points[place] = _united(points[place], point)
    return tuple(sorted(points, key=lambda point: point.fraction))


def _united(first: SpecialPoint, second: SpecialPoint) -> SpecialPoint:
    """Return one point for two; the first of its branches is one whose index changes there."""
    if first.indices[0] == first.indices[1]:
        first, second = second, first
    kind = second.kind if first.kind is SpecialKind.BRANCH_POINT else first.kind
    return replace(first, kind=kind, branches=(*first.branches, *second.branches))


def _is_one_point(first: SpecialPoint, second: SpecialPoint) -> bool:
    if SpecialKind.FOLD in (first.kind, second.kind) or abs(first.fraction - second.fraction) > _SAME_FRACTION:
        return False
    state, other = first.equilibrium.state, second.equilibrium.state
    return bool(np.abs(state - other).max() < _SAME_STATE * (1.0 + np.abs(state).max()))
