"""One equilibrium of a mechanism and everything that is known of it."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from pcm_gym.arrays import Array
from pcm_gym.kernels.statics.equilibrium import (
    ENERGY,
    MODE,
    MODULUS,
    PSI,
    RESIDUAL,
    RHO,
    SINGULARITY_MARGIN,
    STABILITY_MARGIN,
    TIP_FORCE_X,
    TIP_FORCE_Y,
    describe_equilibrium,
    set_world_shapes,
)
from pcm_gym.mechanism import Mechanism


@dataclass(frozen=True)
class RodState:
    """One loaded rod in the paper's parameters (Altuzarra et al. 2019, Eqs. 13-23).

    Attributes
    ----------
    modulus : float
        Elliptic modulus k in [-1, 1]; its sign tells on which side the rod bends.
    psi : float
        Direction of the tip force in the clamp's frame, rad, in [0, 2 pi).
    mode : int
        Buckling mode q: number of inflections, the hinge included.
    rho : float
        Dimensionless load L sqrt(|force| / EI).
    force : array (2,)
        Force of the end-effector on the rod's tip, world frame, in N.
    """

    modulus: float
    psi: float
    mode: int
    rho: float
    force: Array


@dataclass(frozen=True, eq=False)
class Equilibrium:
    """An equilibrium of a mechanism at given inputs and load.

    Solvers make it; its numbers are computed on first use from the rods' loads in `state`.

    Attributes
    ----------
    mechanism : Mechanism
    state : array (2 legs + d,)
        The kernels' dimensionless state: per rod its load as seen from its tip, then the pose.
    inputs : array (legs,)
        Actuator inputs, rad or m.
    load : array (d,)
        External load on the end-effector at its origin, N (and N m).
    """

    mechanism: Mechanism
    state: Array
    inputs: Array
    load: Array

    def __post_init__(self) -> None:
        for name in ("state", "inputs", "load"):
            array = np.array(getattr(self, name), dtype=np.float64)
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    @cached_property
    def _facts(self) -> tuple[Array, Array, Array, Array, int, bool]:
        mechanism, units = self.mechanism, self.mechanism.units
        return describe_equilibrium(
            mechanism.leg_table, np.array(self.state), self.inputs / units.inputs, self.load / units.load
        )

    @property
    def pose(self) -> Array:
        """Pose of the end-effector, (x, y) in m or (x, y, phi) with phi in rad."""
        return self.state[2 * self.mechanism.leg_count :] * self.mechanism.units.pose

    @cached_property
    def rods(self) -> tuple[RodState, ...]:
        """The rods in the paper's parameters, one per leg."""
        force_unit = self.mechanism.units.force
        return tuple(
            RodState(
                float(row[MODULUS]),
                float(row[PSI]),
                int(row[MODE]),
                float(row[RHO]),
                row[TIP_FORCE_X : TIP_FORCE_Y + 1] * force_unit,
            )
            for row in self._facts[1]
        )

    @property
    def modes(self) -> tuple[int, ...]:
        """Buckling mode of each rod."""
        return tuple(rod.mode for rod in self.rods)

    @property
    def energy(self) -> float:
        """Bending energy of the rods less the work of the load on the end-effector, in J."""
        return float(self._facts[0][ENERGY]) * self.mechanism.units.energy

    @property
    def residual(self) -> float:
        """Largest error of closure, relative to the mean rod length, or of equilibrium, relative to 1 + force."""
        return float(self._facts[0][RESIDUAL])

    @property
    def index(self) -> int:
        """Morse index: number of unstable directions of the rods' whole energy under the closure constraints."""
        return self._facts[4]

    @property
    def is_stable(self) -> bool:
        """Whether the energy has a strict local minimum here: index 0 with positive definite stiffness."""
        return self.index == 0

    @property
    def stability_margin(self) -> float:
        """Least eigenvalue of the stiffness, dimensionless (EI = L = 1); means stability only of a stable state."""
        return float(self._facts[0][STABILITY_MARGIN])

    @property
    def singularity_margin(self) -> float:
        """About how far, in input space, the nearest fold is, in rad and mean rod lengths; zero exactly at a fold.

        The cheap stand-in for `nearest_fold`. It extrapolates the squared eigenvalues of the stiffness, which are
        linear in the inputs near a fold, to zero: exact in the limit, and within a factor of a few in general. Where no
        fold is near it means nothing but that; it is at most 10.
        """
        return float(self._facts[0][SINGULARITY_MARGIN])

    @property
    def stiffness(self) -> Array:
        """Stiffness of the end-effector, d force / d pose at fixed inputs, (d, d), in N/m, N and N m."""
        return self._facts[2] * self.mechanism.units.stiffness

    @property
    def forward_jacobian(self) -> Array:
        """Derivative of the pose by the inputs along the branch, (d, legs), by implicit differentiation.

        Raises
        ------
        numpy.linalg.LinAlgError
            At a singular point, where it does not exist.
        """
        *_, jacobian, _, is_regular = self._facts
        if not is_regular:
            raise np.linalg.LinAlgError("the forward Jacobian does not exist: this equilibrium is a singular point")
        units = self.mechanism.units
        return jacobian * np.outer(units.pose, 1.0 / units.inputs)

    @property
    def within_limits(self) -> bool:
        """Whether every input is within its actuator's limits."""
        mechanism = self.mechanism
        return bool(np.all((mechanism.lower_limits <= self.inputs) & (self.inputs <= mechanism.upper_limits)))

    def shape(self, points: int = 50) -> Array:
        """Return the rods' centre lines, base to tip at equal steps of arc length.

        Parameters
        ----------
        points : int
            Points per rod, at least 2.

        Returns
        -------
        array (legs, points, 2)
            World coordinates in m, exact to rounding.
        """
        if points < 2:
            raise ValueError(f"points must be at least 2, got {points}")
        mechanism = self.mechanism
        shapes = np.empty((mechanism.leg_count, points, 2))
        set_world_shapes(mechanism.leg_table, np.array(self.state), self.inputs / mechanism.units.inputs, shapes)
        return shapes * mechanism.units.length

    def __getstate__(self) -> dict[str, Any]:
        """Pickle the defining data alone; what is derived is made again."""
        return {name: getattr(self, name) for name in self.__dataclass_fields__}

    def __setstate__(self, state: dict[str, Any]) -> None:
        for name, value in state.items():
            object.__setattr__(self, name, value)
        self.__post_init__()

    def __repr__(self) -> str:
        """Return a line with what identifies the equilibrium."""
        pose = ", ".join(f"{value:.6g}" for value in self.pose)
        return (
            f"Equilibrium({self.mechanism.name}, pose=({pose}), modes={self.modes}, index={self.index}, "
            f"energy={self.energy:.6g})"
        )
