"""Bifurcation diagrams: every equilibrium along a straight line in inputs and load, as curves with their folds."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pcm_gym.arrays import Array, Mask
from pcm_gym.kernels.branches.curves import polish
from pcm_gym.kernels.branches.problem import Parameters, Problem
from pcm_gym.kernels.branches.singularity import FORWARD
from pcm_gym.kernels.statics.states import are_same
from pcm_gym.mechanism import Mechanism
from pcm_gym.mechanism.validation import check_kinds, finite_number
from pcm_gym.solving.equilibrium import Equilibrium
from pcm_gym.solving.singular_curve import CurveEnd

# A load of this size, in EI / L^2, counts as much along a way as an input of 1.
_LOAD_UNIT = 10.0
_TURN = 2.0 * np.pi
# Keeps the ratio of a vanishing chord and its tangents finite.
_LEAST_SPEED = 1e-12


class SpecialKind(StrEnum):
    """What happens at a special point of a diagram."""

    FOLD = "fold"
    PITCHFORK = "pitchfork"
    TRANSCRITICAL = "transcritical"
    BRANCH_POINT = "branch point"

    @property
    def message(self) -> str:
        """What the kind means, in a sentence."""
        return _MESSAGES[self]


_MESSAGES = {
    SpecialKind.FOLD: "Two equilibria meet and vanish: driven past it, the mechanism snaps.",
    SpecialKind.PITCHFORK: "A branch that turns round here crosses another one, as symmetry makes them do.",
    SpecialKind.TRANSCRITICAL: "Two branches cross, and both go on to both sides.",
    SpecialKind.BRANCH_POINT: "The index changes, and how many branches meet could not be told.",
}


@dataclass(frozen=True, eq=False)
class Way:
    """A straight line in inputs and load, from fraction 0 to 1.

    Attributes
    ----------
    mechanism : Mechanism
    inputs : array (2, legs)
        At its start and at its end, rad or m.
    loads : array (2, d)
        N and N m.
    """

    mechanism: Mechanism
    inputs: Array
    loads: Array

    @cached_property
    def length(self) -> float:
        """Length in rad and mean rod lengths, a load of 10 EI / L^2 counted as 1."""
        units = self.mechanism.units
        inputs, loads = units.kernel_from_inputs(self.inputs), units.kernel_from_load(self.loads)
        return float(np.hypot(np.linalg.norm(inputs[1] - inputs[0]), np.linalg.norm(loads[1] - loads[0]) / _LOAD_UNIT))

    def inputs_at(self, fraction: float) -> Array:
        """Return the inputs at a fraction of the way, (legs,), rad or m."""
        inputs: Array = self.inputs[0] + fraction * (self.inputs[1] - self.inputs[0])
        return inputs

    def load_at(self, fraction: float) -> Array:
        """Return the load at a fraction of the way, (d,), N and N m."""
        load: Array = self.loads[0] + fraction * (self.loads[1] - self.loads[0])
        return load

    def problem(self, rho_max: float) -> Problem:
        """Return the curves of all equilibria along the way; their one parameter is fraction times length."""
        mechanism, units = self.mechanism, self.mechanism.units
        inputs, loads = units.kernel_from_inputs(self.inputs), units.kernel_from_load(self.loads)
        size = mechanism.state_size
        box = np.tile([-np.inf, np.inf, 0.0], (size + 1, 1))
        box[size, :2] = 0.0, self.length
        if mechanism.dof == 3:
            box[size - 1, 2] = _TURN
        rates = (inputs[1:] - inputs[:1]) / self.length, (loads[1:] - loads[:1]) / self.length
        parameters = Parameters(inputs[0].copy(), loads[0].copy(), *rates)
        return Problem(parameters, np.zeros((0, size + 1)), box, rho_max, FORWARD, False)

    def is_among(self, state: Array, known: Sequence[Equilibrium]) -> bool:
        """Return whether the kernels' `state` is that of one of some equilibria."""
        legs = self.mechanism.leg_count
        return any(are_same(np.array(state), np.array(own.state), legs) for own in known)

    def equilibrium(self, state: Array, fraction: float) -> Equilibrium:
        """Return the equilibrium with the kernels' `state` at a fraction of the way."""
        return Equilibrium.unchecked(self.mechanism, state, self.inputs_at(fraction), self.load_at(fraction))


@dataclass(frozen=True, eq=False)
class DiagramBranch:
    """One smooth curve of equilibria along a way, through all its folds.

    Attributes
    ----------
    way : Way
    states : array (n, 2 legs + d)
        The kernels' dimensionless states, one per vertex.
    fractions : array (n,)
        Part of the way, in [0, 1]; it turns round at folds alone, and at branch points.
    tangents : array (n, 2 legs + d + 1)
        Derivative of state and `Way` parameter, fraction times length, by the length of the curve.
    energies : array (n,)
        Bending energy less the work of the load, J.
    indices : array (n,)
        Morse index; at a special vertex that of one of its sides.
    stability_margins, singularity_margins : array (n,)
        As of `Equilibrium`.
    largest_rhos : array (n,)
        Largest dimensionless load of a rod.
    special : tuple of int
        The vertices that are folds or branch points.
    ends : (CurveEnd, CurveEnd)
        How it ends before its first and after its last vertex: at an end of the way (`BOUNDS`), at the largest load,
        not at all (`CLOSED`), or for want of a solution (`SOLVER_FAILURE`).
    """

    way: Way
    states: Array
    fractions: Array
    tangents: Array
    energies: Array
    indices: NDArray[np.int64]
    stability_margins: Array
    singularity_margins: Array
    largest_rhos: Array
    special: tuple[int, ...]
    ends: tuple[CurveEnd, CurveEnd]

    def __post_init__(self) -> None:
        check_kinds(self, way=Way, states=np.ndarray, fractions=np.ndarray, special=tuple, ends=tuple)

    def __len__(self) -> int:
        """Return the number of vertices."""
        return len(self.states)

    @cached_property
    def path(self) -> Array:
        """The vertices in the unknowns, (n, 2 legs + d + 1): state and `Way` parameter, fraction times length."""
        return np.column_stack([self.states, self.fractions * self.way.length])

    @property
    def poses(self) -> Array:
        """Poses of the end-effector, (n, d), m and rad."""
        return self.way.mechanism.units.pose_from_kernel(self.states[:, 2 * self.way.mechanism.leg_count :])

    @property
    def is_stable(self) -> Mask:
        """Which vertices are stable, (n,): of index 0, and neither fold nor branch point."""
        stable: Mask = self.indices == 0
        stable[list(self.special)] = False
        return stable

    def pieces(self) -> tuple[tuple[int, int], ...]:
        """Return (first, last) vertex of each piece between special vertices: on it the index does not change."""
        cuts = sorted({0, *self.special, len(self) - 1})
        return tuple(pairwise(cuts))

    def index_of(self, piece: tuple[int, int]) -> int:
        """Return the Morse index of a piece."""
        return int(self.indices[(piece[0] + piece[1]) // 2])

    def equilibrium(self, k: int) -> Equilibrium:
        """Return the equilibrium at vertex `k`."""
        return self.way.equilibrium(self.states[k], float(self.fractions[k]))

    def at(self, fraction: float) -> tuple[Equilibrium, ...]:
        """Return the equilibria of this branch at a fraction of the way, in the order of its vertices."""
        found: list[Equilibrium] = []
        ahead = self.fractions - fraction
        for k in np.flatnonzero(ahead[:-1] * ahead[1:] <= 0.0).tolist():
            state = self._between(k, fraction)
            if state is not None and not self.way.is_among(state, found):
                found.append(self.way.equilibrium(state, fraction))
        return tuple(found)

    def _between(self, k: int, fraction: float) -> Array | None:
        """Return the state at a fraction between the vertices `k` and `k` + 1; None without one."""
        way, size = self.way, self.way.mechanism.state_size
        parameter = fraction * way.length
        ends = self.path[k : k + 2]
        chord = ends[1] - ends[0]
        speed = float(np.linalg.norm(self.tangents[k : k + 2].mean(axis=0)))
        arc = float(np.linalg.norm(chord)) / max(speed, _LEAST_SPEED)
        first, last = arc * self.tangents[k], arc * self.tangents[k + 1]
        # cubic in the part u of the arc: c0 + c1 u + c2 u^2 + c3 u^3
        cubic = np.array([ends[0], first, 3.0 * chord - 2.0 * first - last, first + last - 2.0 * chord])
        y = np.polynomial.polynomial.polyval(_root(cubic[:, -1] - [parameter, 0.0, 0.0, 0.0]), cubic)
        y[-1] = parameter
        condition = np.zeros(size + 1)
        condition[-1] = 1.0
        is_found = polish(way.mechanism.leg_table, y, condition, way.problem(np.inf))
        return y[:size] if is_found else None


def _root(cubic: Array) -> float:
    """Return the root in [0, 1] of a cubic, lowest power first, that changes its sign there; the nearest if none."""
    roots = np.polynomial.polynomial.polyroots(cubic)
    beyond = np.abs(roots.imag) + np.maximum(np.abs(roots.real - 0.5) - 0.5, 0.0)
    return float(np.clip(roots.real[np.argmin(beyond)], 0.0, 1.0)) if len(roots) else 0.0


@dataclass(frozen=True, eq=False)
class SpecialPoint:
    """A fold, or where branches of a diagram cross.

    Attributes
    ----------
    kind : SpecialKind
    fraction : float
        Part of the way.
    equilibrium : Equilibrium
        The singular equilibrium.
    branches : tuple of (int, int)
        Number of a branch and its vertex, of all that go through the point.
    indices : (int, int)
        Morse indices before and after it on the first of these branches, in the order of its vertices.
    """

    kind: SpecialKind
    fraction: float
    equilibrium: Equilibrium
    branches: tuple[tuple[int, int], ...]
    indices: tuple[int, int]

    def __post_init__(self) -> None:
        check_kinds(self, kind=SpecialKind, fraction=float, equilibrium=Equilibrium, branches=tuple, indices=tuple)

    def __repr__(self) -> str:
        """Return a line with what happens, and where."""
        pose = ", ".join(f"{value:.6g}" for value in self.equilibrium.pose)
        return f"SpecialPoint({self.kind}, fraction={self.fraction:.9g}, indices={self.indices}, pose=({pose}))"


class Slice(NamedTuple):
    """The complete set of equilibria at one place of a way.

    Attributes
    ----------
    fraction : float
        Part of the way.
    found : int
        How many isolated equilibria there are.
    is_proved : bool
        Whether that is proved to be all of them.
    unfollowed : tuple of Equilibrium
        Those of them that could not be followed, and so are on no branch: singular ones.
    """

    fraction: float
    found: int
    is_proved: bool
    unfollowed: tuple[Equilibrium, ...]


@dataclass(frozen=True, eq=False)
class BifurcationDiagram:
    """Every equilibrium along a way, as smooth curves; `bifurcation_diagram` makes it.

    Attributes
    ----------
    way : Way
    rho_max : float
        Largest dimensionless load of any rod.
    branches : tuple of DiagramBranch
        By ascending energy of their first stable vertex, or of their first one.
    points : tuple of SpecialPoint
        By ascending fraction.
    slices : tuple of Slice
        Where complete sets of equilibria were found: each of these is on a branch, but for those named there.
    """

    way: Way
    rho_max: float
    branches: tuple[DiagramBranch, ...]
    points: tuple[SpecialPoint, ...]
    slices: tuple[Slice, ...]

    def __post_init__(self) -> None:
        check_kinds(self, way=Way, rho_max=float, branches=tuple, points=tuple, slices=tuple)

    @property
    def mechanism(self) -> Mechanism:
        """The mechanism."""
        return self.way.mechanism

    @property
    def folds(self) -> tuple[SpecialPoint, ...]:
        """The folds alone."""
        return tuple(point for point in self.points if point.kind is SpecialKind.FOLD)

    def at(self, fraction: float) -> tuple[tuple[int, Equilibrium], ...]:
        """Return all equilibria at a place of the way, with the numbers of their branches, by ascending energy.

        Parameters
        ----------
        fraction : float
            Part of the way, in [0, 1].

        Raises
        ------
        ValueError
            If it is out of range.
        """
        fraction = finite_number("fraction", fraction)
        if not 0.0 <= fraction <= 1.0:
            raise ValueError(f"fraction must be in [0, 1], got {fraction}")
        found = [(number, own) for number, branch in enumerate(self.branches) for own in branch.at(fraction)]
        return tuple(sorted(found, key=lambda entry: entry[1].energy))

    def __repr__(self) -> str:
        """Return a line with what the diagram holds, and one for each special point."""
        title = f"BifurcationDiagram({self.mechanism.name}, {len(self.branches)} branches, {len(self.points)} points)"
        return "\n".join([title, *(f"  {point!r}" for point in self.points)])
