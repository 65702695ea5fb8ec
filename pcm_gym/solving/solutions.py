"""Sets of equilibria: all solutions of one problem, families among them, and stable ones with their branches."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, overload

import numpy as np
from numpy.typing import NDArray

from pcm_gym.mechanism import Mechanism
from pcm_gym.mechanism.validation import check_kinds, finite_array, instance_of, sequence_of, whole_array
from pcm_gym.solving.certification import Certificate
from pcm_gym.solving.equilibrium import Equilibrium


class FamilyKind(StrEnum):
    """What varies along a family of equilibria."""

    SELF_STRESS = "self-stress of straight rods"
    FREE_ROTATION = "rotation of rods whose tips are on their motors"
    OPPOSED_RODS = "rods that balance each other in any shape"


@dataclass(frozen=True, eq=False)
class Family:
    """Equilibria that are not isolated: a curve of them, or a surface, at the same inputs or at the same pose.

    Attributes
    ----------
    kind : FamilyKind
        What varies. `SELF_STRESS`: rods on one line, or on lines that meet in a point, are straight and push or pull
        each other by any force. `FREE_ROTATION`: rods form loops that turn about their motors. `OPPOSED_RODS`: each
        shape of one rod is matched by one of the others, as at a pose about which a mechanism is symmetric.
    representative : Equilibrium
        One of them, with loads about as small as any. Where a family has the same inputs all along it is singular, and
        so never called stable.
    directions : array (dimension, 2 legs + d + legs)
        Orthonormal directions in which the family goes on from there: changes of `Equilibrium.state`, then of the
        inputs in the same dimensionless units (rad, and lengths of the reference rod).
    """

    kind: FamilyKind
    representative: Equilibrium
    directions: NDArray[np.float64]

    def __post_init__(self) -> None:
        check_kinds(self, kind=FamilyKind, representative=Equilibrium, directions=np.ndarray)

    @property
    def dimension(self) -> int:
        """Number of directions: 1 for a curve, 2 for a surface."""
        return len(self.directions)

    def __repr__(self) -> str:
        """Return what varies, in how many dimensions, and where."""
        pose = ", ".join(f"{value:.6g}" for value in self.representative.pose)
        return f"Family({self.kind.value}, dimension={self.dimension}, at pose=({pose}))"


@dataclass(frozen=True)
class EquilibriumSet(Sequence[Equilibrium]):
    """All solutions of one forward or inverse problem: a sequence of the isolated ones, by ascending energy.

    Attributes
    ----------
    equilibria : tuple of Equilibrium
    reason : str
        Why the set is empty; empty itself where there are solutions.
    certificate : Certificate or None
        What is proved of the set's completeness, in all modes; None if that was not asked for.
    families : tuple of Family
        Solutions that are not isolated, in all modes; empty as a rule.
    """

    equilibria: tuple[Equilibrium, ...]
    reason: str = ""
    certificate: Certificate | None = None
    families: tuple[Family, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "equilibria", sequence_of("equilibria", self.equilibria, Equilibrium))
        check_kinds(self, reason=str, certificate=Certificate | None)

    @property
    def stable(self) -> tuple[Equilibrium, ...]:
        """The stable ones among the isolated ones."""
        return tuple(found for found in self.equilibria if found.is_stable)

    @overload
    def __getitem__(self, key: int) -> Equilibrium: ...

    @overload
    def __getitem__(self, key: slice) -> tuple[Equilibrium, ...]: ...

    def __getitem__(self, key: int | slice) -> Equilibrium | tuple[Equilibrium, ...]:
        """Return one equilibrium, or a tuple of them."""
        return self.equilibria[key]

    def __len__(self) -> int:
        """Return the number of equilibria."""
        return len(self.equilibria)

    def __iter__(self) -> Iterator[Equilibrium]:
        """Return an iterator over the equilibria."""
        return iter(self.equilibria)

    def __repr__(self) -> str:
        """Return a line per equilibrium, or the reason why there is none."""
        if not self.equilibria:
            return f"EquilibriumSet of none: {self.reason}"
        members = (*self.equilibria, *self.families)
        return "\n".join([f"EquilibriumSet of {len(self)}:", *(f"  {member!r}" for member in members)])


@dataclass(frozen=True, eq=False)
class StableStates(Sequence[Equilibrium]):
    """Stable equilibria as arrays, with the branches of an atlas on which they are.

    Attributes
    ----------
    mechanism : Mechanism
    load : array (d,)
        Load on the end-effector, N and N m.
    states : array (n, 2 legs + d)
        The kernels' dimensionless states.
    inputs : array (n, legs)
        Actuator inputs, rad or m.
    branches : array (n,)
        Numbers of the branches.
    """

    mechanism: Mechanism
    load: NDArray[np.float64]
    states: NDArray[np.float64]
    inputs: NDArray[np.float64]
    branches: NDArray[np.int32]

    def __post_init__(self) -> None:
        mechanism = instance_of("mechanism", self.mechanism, Mechanism)
        states = finite_array("states", self.states, ("n", mechanism.state_size))
        count = len(states)
        checked = {
            "load": mechanism.check_load(self.load),
            "states": states,
            "inputs": finite_array("inputs", self.inputs, (count, mechanism.leg_count)),
            "branches": whole_array("branches", self.branches, (count,), -1, (1 << 31) - 1).astype(np.int32),
        }
        self.__dict__.update(checked)

    @property
    def poses(self) -> NDArray[np.float64]:
        """Poses of the end-effector, (n, d), m and rad."""
        return self.mechanism.units.pose_from_kernel(self.states[:, 2 * self.mechanism.leg_count :])

    @overload
    def __getitem__(self, key: int) -> Equilibrium: ...

    @overload
    def __getitem__(self, key: slice | NDArray[Any]) -> "StableStates": ...

    def __getitem__(self, key: int | slice | NDArray[Any]) -> "Equilibrium | StableStates":
        """Return one equilibrium, or those of a slice, a mask or an array of places."""
        if isinstance(key, slice | np.ndarray):
            return StableStates(self.mechanism, self.load, self.states[key], self.inputs[key], self.branches[key])
        return Equilibrium.unchecked(self.mechanism, self.states[key], self.inputs[key], self.load)

    def __len__(self) -> int:
        """Return the number of equilibria."""
        return len(self.states)
