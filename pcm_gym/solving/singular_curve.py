"""A curve of singular states: folds in input space, or a boundary of the workspace."""

from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property
from typing import Any

import numpy as np

from pcm_gym.arrays import Array
from pcm_gym.mechanism import Mechanism
from pcm_gym.mechanism.validation import finite_array, instance_of, truth_value, whole_array, whole_number
from pcm_gym.solving.equilibrium import Equilibrium


class CurveEnd(StrEnum):
    """How a singular curve ends at one of its ends."""

    CLOSED = "closed"
    LARGEST_LOAD = "largest_load"
    BOUNDS = "bounds"
    SOLVER_FAILURE = "solver_failure"


@dataclass(frozen=True, eq=False)
class SingularCurve:
    """A curve of singular states, smooth in state and inputs; its projection may have cusps.

    Attributes
    ----------
    mechanism : Mechanism
    load : array (d,)
        External load, N (and N m).
    is_forward : bool
        Whether its states are folds (forward singularities, projected to inputs) or inverse singularities (projected to
        poses).
    states : array (n, 2 legs + d)
        The kernels' dimensionless states, one per vertex.
    inputs : array (n, legs)
        Actuator inputs, rad or m. Angles of actuators with a full turn run on without a jump.
    tangents : array (n, 2 legs + d + legs)
        Derivative of state and dimensionless inputs by the length of the curve that was used to trace it.
    plane : (int, int)
        The two inputs, or coordinates of the pose, in which the curve is drawn; with two legs (0, 1).
    cusps : tuple of int
        The vertices at which the projected curve has a cusp: exact in the projection, to about 1e-5 in state.
    ends : (CurveEnd, CurveEnd)
        How it ends before its first and after its last vertex.
    indices : (int, int), optional
        Morse indices of the equilibria on the two sides of a fold; None for an inverse singularity, which leaves the
        index alone.
    """

    mechanism: Mechanism
    load: Array
    is_forward: bool
    states: Array
    inputs: Array
    tangents: Array
    plane: tuple[int, int]
    cusps: tuple[int, ...]
    ends: tuple[CurveEnd, CurveEnd]
    indices: tuple[int, int] | None

    def __post_init__(self) -> None:
        mechanism = instance_of("mechanism", self.mechanism, Mechanism)
        size, legs = mechanism.state_size, mechanism.leg_count
        states = finite_array("states", self.states, ("n", size))
        count = len(states)
        checked: dict[str, Any] = {
            "load": mechanism.check_load(self.load),
            "states": states,
            "inputs": finite_array("inputs", self.inputs, (count, legs)),
            "tangents": finite_array("tangents", self.tangents, (count, size + legs)),
        }
        for array in checked.values():
            array.setflags(write=False)
        checked["is_forward"] = truth_value("is_forward", self.is_forward)
        checked["plane"] = tuple(whole_array("plane", self.plane, (2,), 0, legs - 1).tolist())
        checked["cusps"] = tuple(whole_array("cusps", self.cusps, ("n",), 0, count - 1).tolist())
        self.__dict__.update(checked)

    def __len__(self) -> int:
        """Return the number of vertices."""
        return len(self.states)

    @property
    def is_closed(self) -> bool:
        """Whether the last vertex is the first again, full turns of angles aside."""
        return self.ends[1] is CurveEnd.CLOSED

    @property
    def is_stability_limit(self) -> bool:
        """Whether stable equilibria end here: a fold between index 0 and 1."""
        return self.indices == (0, 1)

    @cached_property
    def poses(self) -> Array:
        """Poses of the end-effector, (n, d), (x, y) in m or (x, y, phi) with phi in rad."""
        return self.mechanism.units.pose_from_kernel(self.states[:, 2 * self.mechanism.leg_count :])

    @property
    def points(self) -> Array:
        """The projected curve, (n, 2): the inputs, or the coordinates of the pose, that `plane` names."""
        return (self.inputs if self.is_forward else self.poses)[:, self.plane]

    @cached_property
    def arc_length(self) -> Array:
        """Length of the projected curve up to each vertex, (n,), in units of the inputs or the pose."""
        scaled = self.points / self.plane_units
        return np.append(0.0, np.cumsum(np.linalg.norm(np.diff(scaled, axis=0), axis=1)))

    @property
    def plane_units(self) -> Array:
        """Units of the coordinates of `points`, (2,): factors out of the kernels' dimensionless numbers."""
        units = self.mechanism.units
        return (units.inputs if self.is_forward else units.pose)[list(self.plane)]

    @cached_property
    def unknowns(self) -> Array:
        """State and dimensionless inputs of every vertex, (n, 2 legs + d + legs)."""
        return np.hstack([self.states, self.mechanism.units.kernel_from_inputs(self.inputs)])

    def equilibrium(self, k: int) -> Equilibrium:
        """Return the singular equilibrium at vertex `k`, counted from the end where it is negative."""
        k = whole_number("k", k, least=-len(self), most=len(self) - 1)
        return Equilibrium.unchecked(self.mechanism, self.states[k], self.inputs[k], self.load)

    def __repr__(self) -> str:
        """Return a line with what identifies the curve."""
        kind = f"folds {self.indices}" if self.is_forward else "inverse singularities"
        ends = "closed" if self.is_closed else f"ends={tuple(str(end) for end in self.ends)}"
        return f"SingularCurve({self.mechanism.name}, {kind}, {len(self)} points, {len(self.cusps)} cusps, {ends})"
