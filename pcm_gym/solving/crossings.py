"""Where singular curves cross in the plane of inputs, or of poses, in which they are drawn."""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pcm_gym.arrays import Array, Integers
from pcm_gym.kernels.branches.curves import point_beside
from pcm_gym.kernels.branches.polygons import crossing_segments
from pcm_gym.kernels.branches.problem import Problem, inputs_as_parameters
from pcm_gym.kernels.branches.singularity import FORWARD, INVERSE
from pcm_gym.mechanism.validation import check_kinds, sequence_of
from pcm_gym.solving.equilibrium import Equilibrium
from pcm_gym.solving.singular_curve import SingularCurve

_FIRST_CAPACITY = 1 << 10
_NEWTON_STEPS = 12
_TOLERANCE = 1e-10
# A crossing may lie this part of a segment beyond its end; those nearer to each other than the distance are one.
_OVERHANG, _SAME_CROSSING, _SAME_STATE = 0.5, 1e-7, 1e-4


@dataclass(frozen=True, eq=False)
class Crossing:
    """A point at which two singular curves, or two parts of one, have the same inputs (or pose) in different states.

    Attributes
    ----------
    curves : (int, int)
        Numbers of the two curves.
    equilibria : (Equilibrium, Equilibrium)
        The singular equilibria on them.
    point : array (2,)
        Where they cross, in the curves' plane; that of the first curve, from which angles may differ by full turns.
    """

    curves: tuple[int, int]
    equilibria: tuple[Equilibrium, Equilibrium]
    point: Array

    def __post_init__(self) -> None:
        check_kinds(self, curves=tuple, equilibria=tuple, point=np.ndarray)


def find_crossings(curves: Sequence[SingularCurve]) -> tuple[Crossing, ...]:
    """Return all crossings of these curves with each other and with themselves.

    Found on the polygons through their vertices, then computed on the curves by Newton's method, to 1e-10. Two that are
    nearer together than the vertices' spacing may be missed, and curves that lie upon one another have none.

    Parameters
    ----------
    curves : sequence of SingularCurve
        All of one mechanism, load and kind.

    Raises
    ------
    ValueError
        If the curves do not belong together.
    """
    curves = sequence_of("curves", curves, SingularCurve)
    if not curves:
        return ()
    first = curves[0]
    for curve in curves:
        if curve.mechanism != first.mechanism or (curve.is_forward, curve.plane) != (first.is_forward, first.plane):
            raise ValueError(f"curves must be of one mechanism and kind, got {first!r} and {curve!r}")
    plane = _Plane(first)
    found: list[Crossing] = []
    for i, j in itertools.combinations_with_replacement(range(len(curves)), 2):
        of_pair: list[Crossing] = []
        for k, n in plane.segments(curves[i], curves[j], is_same=i == j):
            crossing = plane.refine(curves[i], curves[j], k, n)
            if crossing is not None:
                _keep(of_pair, Crossing((i, j), *crossing), plane)
        found += of_pair
    return tuple(found)


class _Plane:
    """The plane in which curves are drawn, in dimensionless numbers."""

    def __init__(self, curve: SingularCurve) -> None:
        mechanism, size = curve.mechanism, curve.mechanism.state_size
        self._mechanism, self._load, self._is_forward = mechanism, curve.load, curve.is_forward
        first = size if curve.is_forward else 2 * mechanism.leg_count
        self._columns = [first + k for k in curve.plane]
        self.units = curve.plane_units
        periods = [leg.actuator.period for leg in mechanism.legs] if curve.is_forward else [0.0, 0.0, 2.0 * math.pi]
        self.periods = np.array([periods[k] for k in curve.plane])
        held = [first + k for k in range(mechanism.leg_count) if k not in curve.plane]
        box = np.tile([-math.inf, math.inf, 0.0], (size + mechanism.leg_count, 1))
        conditions = np.eye(size + mechanism.leg_count)[held]
        kind = FORWARD if curve.is_forward else INVERSE
        load = mechanism.units.kernel_from_load(curve.load)
        self._problem = Problem(inputs_as_parameters(load), conditions, box, math.inf, kind, True)

    def wrapped(self, gap: Array) -> Array:
        """Return a difference of two points without the full turns in it."""
        turns = np.where(self.periods > 0.0, np.round(gap / np.where(self.periods > 0.0, self.periods, 1.0)), 0.0)
        wrapped: Array = gap - turns * self.periods
        return wrapped

    def segments(self, first: SingularCurve, second: SingularCurve, *, is_same: bool) -> Integers:
        """Return the pairs of segments, by their first vertices, that cross on the polygons, (m, 2)."""
        points, found = (first.points / self.units, second.points / self.units), [np.empty((0, 2), dtype=np.int64)]
        start, capacity = 0, _FIRST_CAPACITY
        while start < len(first.points) - 1:
            pairs = np.empty((capacity, 2), dtype=np.int64)
            count, end = crossing_segments(*points, self.periods, is_same, start, pairs)
            if count <= capacity:
                found.append(pairs[:count])
                start = end
            capacity = max(capacity, count)
        return np.concatenate(found)

    def refine(
        self, first: SingularCurve, second: SingularCurve, k: int, n: int
    ) -> tuple[tuple[Equilibrium, Equilibrium], Array] | None:
        """Return the equilibria where two segments' curves cross, and the point; None if they do not."""
        starts = first.unknowns[k], second.unknowns[n]
        tangents = first.tangents[k], second.tangents[n]
        ends, size = [starts[0].copy(), starts[1].copy()], self._mechanism.state_size
        slopes, arcs = [tangents[0].copy(), tangents[1].copy()], np.zeros(2)
        for _ in range(_NEWTON_STEPS):
            gap = self.wrapped((ends[1] - ends[0])[self._columns])
            if np.abs(gap).max() < _TOLERANCE:
                break
            matrix = np.column_stack([slopes[0][self._columns], -slopes[1][self._columns]])
            if abs(np.linalg.det(matrix)) < 1e-14:
                return None
            arcs += np.linalg.solve(matrix, gap)
            for side in range(2):
                if not point_beside(
                    self._mechanism.leg_table,
                    starts[side],
                    tangents[side],
                    arcs[side],
                    self._problem,
                    ends[side],
                    slopes[side],
                ):
                    return None
        else:
            return None
        is_one_state = np.abs(ends[1][:size] - ends[0][:size]).max() < _SAME_STATE
        if is_one_state or not (_is_within(first, k, ends[0]) and _is_within(second, n, ends[1])):
            return None
        inputs = [self._mechanism.units.inputs_from_kernel(end[size:]) for end in ends]
        equilibria = tuple(
            Equilibrium.unchecked(self._mechanism, end[:size], own, self._load)
            for end, own in zip(ends, inputs, strict=True)
        )
        return (equilibria[0], equilibria[1]), ends[0][self._columns] * self.units


def _is_within(curve: SingularCurve, k: int, point: Array) -> bool:
    """Return whether a point of the curve lies on the segment from vertex `k`, or not far beyond its ends."""
    start, way = curve.unknowns[k], curve.unknowns[k + 1] - curve.unknowns[k]
    part = float((point - start) @ way) / float(way @ way)
    return -_OVERHANG < part < 1.0 + _OVERHANG


def _keep(found: list[Crossing], new: Crossing, plane: _Plane) -> None:
    """Add a crossing to those found, unless it is there already."""
    for old in found:
        gap = plane.wrapped((old.point - new.point) / plane.units)
        loads = [abs(a.state - b.state).max() for a, b in zip(old.equilibria, new.equilibria, strict=True)]
        if np.abs(gap).max() < _SAME_CROSSING and max(loads) < _SAME_STATE:
            return
    found.append(new)
