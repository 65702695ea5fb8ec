"""Singular states of a mechanism as curves: folds in input space, and the boundaries of the workspace."""

import itertools
import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TypedDict, Unpack

import numpy as np
from numpy.typing import ArrayLike

from pcm_gym.arrays import Array
from pcm_gym.kernels.branches import curves as tracing
from pcm_gym.kernels.branches.problem import Problem, inputs_as_parameters
from pcm_gym.kernels.branches.singularity import FORWARD, INVERSE, fold_sides
from pcm_gym.mechanism import Mechanism
from pcm_gym.mechanism.validation import (
    finite_number,
    instance_of,
    limit_pair,
    mapping,
    positive_number,
    sequence_of,
    shown,
    truth_value,
    whole_number,
)
from pcm_gym.solving.enumeration import solve_forward, solve_inverse
from pcm_gym.solving.progress import progress_bars
from pcm_gym.solving.singular_curve import SingularCurve
from pcm_gym.solving.traced import Traced, trace

_TURN = 2.0 * math.pi
# Cells of the grid along each coordinate, of inputs and of poses.
_FORWARD_GRID, _INVERSE_GRID, _MOST_GRID = 8, 16, 1000
# Part of a cell by which a periodic grid is shifted, lest its nodes lie on the symmetries of symmetric mechanisms.
_GRID_SHIFT = 0.382
# On a line equilibria are followed up to this multiple of the largest load, beyond which they may turn and come back.
_LINE_REACH = 1.5
# The indices beside a fold are looked up at this distance from it, at so many places.
_SIDE_DISTANCE, _SIDE_SAMPLES = 1e-4, 15


class Window(TypedDict, total=False):
    """Where singular curves are searched for; `forward_singularities` tells the defaults."""

    bounds: Sequence[tuple[float, float]] | None
    held: Mapping[int, float] | None
    grid: int


def forward_singularities(
    mechanism: Mechanism,
    load: ArrayLike | None = None,
    rho_max: float = 9.0,
    *,
    index: int | None = None,
    progress: bool = True,
    **window: Unpack[Window],
) -> tuple[SingularCurve, ...]:
    """Return the curves of folds: where equilibria meet and vanish as the inputs change.

    Complete sets of equilibria at the nodes of a grid are followed along its lines through all their folds. Each fold
    met that is on no curve yet is the start of another one.

    Parameters
    ----------
    mechanism : Mechanism
    load : array_like (d,), optional
        Load on the end-effector, N and N m; none by default.
    rho_max : float
        Largest dimensionless load ``L sqrt(|f| / EI)`` of any rod, up to 30.
    index : int, optional
        Only folds between this Morse index and the next; 0 gives the limits of stability.
    progress : bool
        Whether to show a progress bar.
    bounds : sequence of (lower, upper), optional
        Range of each input, rad or m; the actuators' limits by default. An angle with a full turn has no bounds.
    held : mapping of int to float, optional
        Inputs that are held, by number: one of the three of a platform.
    grid : int
        Cells of the grid along each input; by default 8.

    Returns
    -------
    tuple of SingularCurve
        By indices, then by length. A curve that meets no line of the grid is not found, and neither is one whose
        equilibria are connected to none at a node; twice as fine a grid confirms the set.

    Raises
    ------
    ValueError
        If an argument has the wrong shape, is not finite or out of range.

    Notes
    -----
    A few seconds for two legs. A platform takes as long as `solve_forward` takes on each node.
    """
    search = _Search.checked(mechanism, load, rho_max, is_forward=True, **window)
    if index is not None:
        whole_number("index", index, least=0)
    return search.run(index, truth_value("progress", progress))


def inverse_singularities(
    mechanism: Mechanism,
    load: ArrayLike | None = None,
    rho_max: float = 9.0,
    *,
    progress: bool = True,
    **window: Unpack[Window],
) -> tuple[SingularCurve, ...]:
    """Return the curves of inverse singularities: where inputs for a pose meet and vanish as the pose changes.

    They bound the workspace and separate the working modes. Found as by `forward_singularities`, from lines in the
    space of poses.

    Parameters
    ----------
    mechanism, load, rho_max, progress, bounds
        As for `forward_singularities`.
    held : mapping of int to float, optional
        Coordinates of the pose that are held, by number: one of (x, y, phi) of a platform, say ``{2: 0.1}``.
    grid : int
        Cells of the grid along each coordinate of the pose; by default 16.

    Returns
    -------
    tuple of SingularCurve
        By length.

    Raises
    ------
    ValueError
        If an argument has the wrong shape, is not finite or out of range.
    """
    search = _Search.checked(mechanism, load, rho_max, is_forward=False, **window)
    return search.run(None, truth_value("progress", progress))


@dataclass(frozen=True)
class _Search:
    """The search for all singular curves in a plane of inputs or of poses."""

    mechanism: Mechanism
    load: Array
    rho_max: float
    is_forward: bool
    input_box: Array  # (legs, 3): dimensionless bounds and period
    window: Array  # (legs, 3): those of the inputs, or of the poses within reach, of which the grid is made
    held: dict[int, float]  # inputs or coordinates of the pose, dimensionless
    plane: tuple[int, int]
    axes: tuple[Array, Array]  # grid values of the two free coordinates, dimensionless

    @classmethod
    def checked(
        cls,
        mechanism: Mechanism,
        load: ArrayLike | None,
        rho_max: float,
        is_forward: bool,
        bounds: Sequence[tuple[float, float]] | None = None,
        held: Mapping[int, float] | None = None,
        grid: int | None = None,
    ) -> "_Search":
        instance_of("mechanism", mechanism, Mechanism)
        if grid is None:
            grid = _FORWARD_GRID if is_forward else _INVERSE_GRID
        units = mechanism.units
        scales = units.inputs if is_forward else units.pose
        values = {
            k: finite_number(f"held[{k}]", value) / scales[k]
            for k, value in mapping("held", held).items()
            if not isinstance(k, bool) and k in range(mechanism.leg_count)
        }
        plane = tuple(k for k in range(mechanism.leg_count) if k not in values)
        if len(plane) != 2 or len(values) != len(held or {}):
            raise ValueError(
                f"held must leave two of {mechanism.leg_count} free, by numbers below {mechanism.leg_count}, got "
                f"{shown(held)}"
            )
        grid = whole_number("grid", grid, least=1, most=_MOST_GRID)
        box = _input_box(mechanism, bounds)
        window = box if is_forward else _pose_window(mechanism, box)
        return cls(
            mechanism,
            mechanism.check_load(load),
            positive_number("rho_max", rho_max),
            is_forward,
            box,
            window,
            values,
            (plane[0], plane[1]),
            (_grid_values(window[plane[0]], grid), _grid_values(window[plane[1]], grid)),
        )

    def run(self, index: int | None, progress: bool) -> tuple[SingularCurve, ...]:
        """Return all curves; of folds, where `index` is given, only those between it and the next."""
        counts = [len(axis) for axis in self.axes]
        found: list[Traced] = []
        nodes: dict[tuple[int, int], list[Array]] = {}
        lines = [(across, n) for across in range(2) for n in range(counts[across])]
        with progress_bars("singularities", progress) as bars:
            for node in bars.track(list(itertools.product(range(counts[0]), range(counts[1]))), description="nodes"):
                nodes[node] = self._equilibria(node, index)
            for across, n in bars.track(lines, description="lines"):
                starts = [y for node, states in nodes.items() if node[across] == n for y in states]
                self._search_line(self.plane[across], starts, index, found)
        curves = sorted(map(self._curve, found), key=lambda curve: (curve.indices or (0, 0), -curve.arc_length[-1]))
        return tuple(curves)

    def _equilibria(self, node: tuple[int, int], index: int | None) -> list[Array]:
        """Return the unknowns of every equilibrium at a node, or of those whose folds are asked for."""
        values = np.zeros(self.mechanism.leg_count)
        for k, value in self.held.items():
            values[k] = value
        for k, axis, n in zip(self.plane, self.axes, node, strict=True):
            values[k] = axis[n]
        units = self.mechanism.units
        if self.is_forward:
            equilibria = solve_forward(self.mechanism, units.inputs_from_kernel(values), self.load, self.rho_max)
        else:
            equilibria = solve_inverse(self.mechanism, units.pose_from_kernel(values), self.load, self.rho_max)
        return [
            np.concatenate(found.kernel_values()[:2])
            for found in equilibria
            if index is None or found.index in (index, index + 1)
        ]

    def _search_line(self, fixed: int, starts: list[Array], index: int | None, found: list[Traced]) -> None:
        """Follow the equilibria on a line through their folds; add the curves through these to those found."""
        line, singular = self._problem(fixed), self._problem()
        legs = self.mechanism.leg_table
        while starts:
            branch = trace(legs, line, starts.pop())
            starts[:] = [y for y in starts if not tracing.is_on_path(legs, y, line, branch.path, branch.tangents)]
            for seed in branch.path[branch.marks]:
                if self._is_wanted(seed, index) and not any(
                    tracing.is_on_path(legs, seed, singular, curve.path, curve.tangents) for curve in found
                ):
                    found.append(trace(legs, singular, seed))

    def _is_wanted(self, seed: Array, index: int | None) -> bool:
        inputs = seed[self.mechanism.state_size :]
        loads = np.hypot(*seed[: 2 * self.mechanism.leg_count].reshape(-1, 2).T)
        if (
            np.any(inputs < self.input_box[:, 0])
            or np.any(inputs > self.input_box[:, 1])
            or loads.max() > self.rho_max**2
        ):
            return False
        return index is None or fold_sides(self.mechanism.leg_table, seed, _SIDE_DISTANCE) == (index, index + 1)

    def _problem(self, fixed: int | None = None) -> Problem:
        """Return the problem of the singular curves, or that of the equilibria with one free coordinate fixed.

        The inputs of an inverse problem may leave their range on a line, and come back.
        """
        mechanism, is_line = self.mechanism, fixed is not None
        size, pose = mechanism.state_size, 2 * mechanism.leg_count
        first = size if self.is_forward else pose
        box = np.tile([-math.inf, math.inf, 0.0], (size + mechanism.leg_count, 1))
        box[pose:, 2] = np.append(_TURN * (np.arange(mechanism.dof) == 2), self.input_box[:, 2])
        if self.is_forward or not is_line:
            box[size:, :2] = self.input_box[:, :2]
        if not self.is_forward and is_line:
            box[pose:size, :2] = self.window[:, :2]
        kept = [first + k for k in (*self.held, *([fixed] if fixed is not None else []))]
        box[kept, :2] = -math.inf, math.inf
        return Problem(
            parameters=inputs_as_parameters(mechanism.units.kernel_from_load(self.load)),
            conditions=np.eye(size + mechanism.leg_count)[kept],
            box=box,
            rho_max=self.rho_max * (_LINE_REACH if is_line else 1.0),
            kind=FORWARD if self.is_forward else INVERSE,
            is_singular=not is_line,
        )

    def _curve(self, traced: Traced) -> SingularCurve:
        size, units = self.mechanism.state_size, self.mechanism.units
        return SingularCurve(
            self.mechanism,
            self.load,
            self.is_forward,
            traced.path[:, :size].copy(),
            units.inputs_from_kernel(traced.path[:, size:]),
            traced.tangents,
            self.plane,
            tuple(map(int, np.flatnonzero(traced.marks))),
            traced.ends,
            self._indices(traced) if self.is_forward else None,
        )

    def _indices(self, traced: Traced) -> tuple[int, int]:
        """Return the indices on the two sides of a fold: constant along the curve, but doubtful near its cusps."""
        places = np.linspace(0, len(traced.path) - 1, _SIDE_SAMPLES).astype(int)
        sides = Counter(fold_sides(self.mechanism.leg_table, traced.path[k], _SIDE_DISTANCE) for k in places)
        return max(sides, key=lambda pair: (pair[1] == pair[0] + 1, sides[pair]))


def _input_box(mechanism: Mechanism, bounds: Sequence[tuple[float, float]] | None) -> Array:
    """Return dimensionless lower and upper bound and period of each input; a full turn has a period and no bounds."""
    limits = (
        [leg.actuator.limits for leg in mechanism.legs] if bounds is None else sequence_of("bounds", bounds, object)
    )
    if len(limits) != mechanism.leg_count:
        raise ValueError(f"bounds must have one (lower, upper) per input, {mechanism.leg_count}, got {shown(bounds)}")
    box = np.zeros((mechanism.leg_count, 3))
    for row, leg, limit, unit in zip(box, mechanism.legs, limits, mechanism.units.inputs, strict=True):
        (lower, upper), period = limit_pair("bounds", limit), leg.actuator.period
        is_turn = leg.actuator.is_angle and upper - lower >= period * (1.0 - 1e-12)
        row[:] = (-math.inf, math.inf, period) if is_turn else (lower / unit, upper / unit, 0.0)
    return box


def _pose_window(mechanism: Mechanism, box: Array) -> Array:
    """Return dimensionless bounds, and periods, of the poses that every leg may reach."""
    units = mechanism.units
    window = np.tile([-math.inf, math.inf, 0.0], (mechanism.dof, 1))
    for leg, (lower, upper, period) in zip(mechanism.legs, box, strict=True):
        ends = [
            leg.actuator.clamp_point(float(end) * units.length) for end in ((0.0, 0.0) if period else (lower, upper))
        ]
        arm = np.full(2, math.hypot(*leg.attachment))
        reach = leg.rod.length + arm
        window[:2, 0] = np.maximum(window[:2, 0], (np.min(ends, axis=0) - reach) / units.length)
        window[:2, 1] = np.minimum(window[:2, 1], (np.max(ends, axis=0) + reach) / units.length)
    if mechanism.dof == 3:
        window[2] = -math.inf, math.inf, _TURN
    return window


def _grid_values(bounds: Array, grid: int) -> Array:
    lower, upper, period = bounds
    if period > 0.0:
        shifted: Array = period * ((np.arange(grid) + _GRID_SHIFT) / grid - 0.5)
        return shifted
    return np.linspace(lower, upper, grid + 1)
