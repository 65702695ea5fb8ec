"""One equilibrium of a mechanism and everything that is known of it."""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from pcm_gym.arrays import Array
from pcm_gym.kernels.enumeration.linearisation import linearised
from pcm_gym.kernels.statics.equilibrium import describe_equilibrium, set_world_shapes
from pcm_gym.kernels.structure.contact import CROSSING_COLUMNS, find_crossings
from pcm_gym.kernels.structure.strength import set_strengths
from pcm_gym.mechanism import Mechanism
from pcm_gym.mechanism.leg import Actuator
from pcm_gym.mechanism.validation import (
    finite_number,
    finite_vector,
    instance_of,
    number_not_negative,
    number_or_nan,
    whole_number,
)

_MOST_POINTS = 1_000_000

# Room for crossings of the parts of a mechanism at first; there is more where that is not enough.
_CROSSINGS = 64

# Singular values below this part of the largest one are zero but for rounding.
_ROUNDING = 1e-13


@dataclass(frozen=True, eq=False)
class RodState:
    """One loaded rod in the paper's parameters (Altuzarra et al. 2019, Eqs. 13-23). It is a value.

    Attributes
    ----------
    modulus : float
        Elliptic modulus k in [-1, 1]; its sign tells on which side the rod bends.
    psi : float
        Direction of the tip force in the clamp's frame, rad, in [0, 2 pi).
    mode : int
        Buckling mode q: number of inflections, the hinge included.
    rho : float
        Dimensionless load ``L sqrt(|force| / EI)``.
    force : array (2,)
        Force of the end-effector on the rod's tip, world frame, in N: what the hinge carries, which bears no moment.
    largest_curvature : float
        Greatest magnitude of the curvature anywhere along the rod, 1/m, in closed form: ``2 rho |k| / L`` where the rod
        is at least a quarter wave long (rho > K), and that at the clamp where it is shorter.
    stress_ratio : float
        Greatest bending stress over the yield stress of the rod's material; nan without section and material.
    """

    modulus: float
    psi: float
    mode: int
    rho: float
    force: Array
    largest_curvature: float
    stress_ratio: float = math.nan

    def __post_init__(self) -> None:
        for name in ("modulus", "psi", "rho"):
            object.__setattr__(self, name, finite_number(name, getattr(self, name)))
        curvature = number_not_negative("largest_curvature", self.largest_curvature)
        object.__setattr__(self, "largest_curvature", curvature)
        object.__setattr__(self, "stress_ratio", number_or_nan("stress_ratio", self.stress_ratio))
        object.__setattr__(self, "mode", whole_number("mode", self.mode, least=1))
        object.__setattr__(self, "force", _frozen(finite_vector("force", self.force, 2)))

    @property
    def _key(self) -> tuple[float | None, ...]:
        stress = None if math.isnan(self.stress_ratio) else self.stress_ratio  # nan is not even equal to itself
        numbers = self.modulus, self.psi, self.mode, self.rho, *self.force.tolist(), self.largest_curvature
        return (*numbers, stress)

    def __eq__(self, other: object) -> bool:
        """Return whether `other` is a rod in the same state."""
        return isinstance(other, RodState) and self._key == other._key

    def __hash__(self) -> int:
        """Return the hash of what makes rods equal."""
        return hash(self._key)


class RodCrossing(NamedTuple):
    """Where two parts of a mechanism cross, or one rod itself.

    Attributes
    ----------
    legs : (int, int)
        Numbers of the two parts, the lesser first; the same twice where a rod crosses itself. Below the number of legs
        they are rods. Edge k of a platform, from hinge k to the next one, has the number ``leg_count + k``.
    arc_lengths : (float, float)
        How far along each part the place is, in m: from a rod's base, or from the hinge at which an edge begins.
    place : (float, float)
        World coordinates in m.
    """

    legs: tuple[int, int]
    arc_lengths: tuple[float, float]
    place: tuple[float, float]


class _Facts(NamedTuple):
    """All that the kernels tell of one equilibrium, dimensionless."""

    energy: float
    residual: float
    stability_margin: float
    singularity_margin: float
    rods: Array  # (legs, 6): modulus, psi, mode, rho, force along x and y
    stiffness: Array  # (d, d)
    jacobian: Array  # (d, legs)
    morse_index: int
    is_regular: bool  # whether the Jacobian exists


@dataclass(frozen=True, eq=False)
class Equilibrium:
    """An equilibrium of a mechanism at given inputs and load.

    Solvers make it; its numbers are computed on first use from the rods' loads in `state`. It is a value: two with the
    same mechanism, state, inputs and load, to the last bit, are equal.

    Attributes
    ----------
    mechanism : Mechanism
    state : array (2 legs + d,)
        The kernels' dimensionless state: per rod its load as seen from its tip, then the pose.
    inputs : array (legs,)
        Actuator inputs, rad or m.
    load : array (d,)
        External load on the end-effector at its origin, N (and N m).

    Raises
    ------
    TypeError, ValueError
        If a part is of the wrong kind or shape, or not finite. Whether the state is an equilibrium, `residual` tells.
    """

    mechanism: Mechanism
    state: Array
    inputs: Array
    load: Array

    def __post_init__(self) -> None:
        mechanism = instance_of("mechanism", self.mechanism, Mechanism)
        sizes = {"state": mechanism.state_size, "inputs": mechanism.leg_count, "load": mechanism.dof}
        self.__dict__.update(
            {name: _frozen(finite_vector(name, getattr(self, name), size)) for name, size in sizes.items()}
        )

    @classmethod
    def unchecked(cls, mechanism: Mechanism, state: Array, inputs: Array, load: Array) -> "Equilibrium":
        """Return an equilibrium of copies of arrays that are known to be right: solvers make hundreds at a time."""
        made = cls.__new__(cls)
        made.__dict__.update(mechanism=mechanism, state=_frozen(state), inputs=_frozen(inputs), load=_frozen(load))
        return made

    def kernel_values(self) -> tuple[Array, Array, Array]:
        """Return state, inputs and load as the kernels take them: new arrays, dimensionless."""
        units = self.mechanism.units
        return self.state.copy(), units.kernel_from_inputs(self.inputs), units.kernel_from_load(self.load)

    @cached_property
    def _key(self) -> tuple[Mechanism, bytes, bytes, bytes]:
        """What makes equilibria equal; adding zero makes one zero of the two."""
        state, inputs, load = ((array + 0.0).tobytes() for array in (self.state, self.inputs, self.load))
        return self.mechanism, state, inputs, load

    def __eq__(self, other: object) -> bool:
        """Return whether `other` is the same state of the same mechanism at the same inputs and load."""
        return self is other or (isinstance(other, Equilibrium) and self._key == other._key)

    def __hash__(self) -> int:
        """Return the hash of what makes equilibria equal, worked out once."""
        return self._hash

    @cached_property
    def _hash(self) -> int:
        return hash(self._key)

    @cached_property
    def _facts(self) -> _Facts:
        scalars, *others = describe_equilibrium(self.mechanism.leg_table, *self.kernel_values())
        return _Facts(*scalars.tolist(), *others)

    @property
    def pose(self) -> Array:
        """Pose of the end-effector, (x, y) in m or (x, y, phi) with phi in rad."""
        return self.mechanism.units.pose_from_kernel(self.state[2 * self.mechanism.leg_count :])

    @cached_property
    def rods(self) -> tuple[RodState, ...]:
        """The rods in the paper's parameters, one per leg."""
        rods, units = self._facts.rods, self.mechanism.units
        curvatures = (self._strength[0] / units.length).tolist()
        stresses = (leg.rod.stress_ratio(own) for leg, own in zip(self.mechanism.legs, curvatures, strict=True))
        return tuple(
            RodState(modulus, psi, int(mode), rho, force * units.force, curvature, stress)
            for (modulus, psi, mode, rho), force, curvature, stress in zip(
                rods[:, :4].tolist(), rods[:, 4:], curvatures, stresses, strict=True
            )
        )

    @cached_property
    def _strength(self) -> tuple[Array, Array]:
        """Each rod's largest curvature and each actuator's force, dimensionless, (legs,) each."""
        state, inputs, _ = self.kernel_values()
        curvatures, forces = np.empty((2, 1, self.mechanism.leg_count))
        set_strengths(self.mechanism.leg_table, state[None], inputs[None], curvatures, forces)
        return curvatures[0], forces[0]

    @property
    def actuator_forces(self) -> Array:
        """What each actuator must give, (legs,), a motor's moment in N m and a slider's force in N.

        The derivative of `energy` by the input, at a constant load: positive where the actuator must push towards
        larger inputs to hold the mechanism. With p the tip seen from the clamp, f the force on it and a the axis it is
        -p x f of a motor and -a . f of a slider.
        """
        units = self.mechanism.units
        return self._strength[1] * (units.energy / units.inputs)

    @cached_property
    def crossings(self) -> tuple[RodCrossing, ...]:
        """Where rods cross themselves, each other or the edges of the platform: every place, exact to rounding.

        In closed form of a rod with itself; of two parts by halving both until they are apart, or cross once at most,
        with the largest curvature as bound, and by Newton's method on the closed form then. Only where they touch is
        one missed. Parts that share a hinge do not cross there. The rods are lines: their thickness is left out.
        """
        state, inputs, _ = self.kernel_values()
        room, count = 0, _CROSSINGS
        while count > room:
            room = count
            found = np.empty((room, CROSSING_COLUMNS))
            count = find_crossings(self.mechanism.leg_table, state, inputs, found)
        found[:count, 2:] *= self.mechanism.units.length
        return tuple(
            RodCrossing((int(first), int(second)), (arc, other_arc), (x, y))
            for first, second, arc, other_arc, x, y in found[:count].tolist()
        )

    @property
    def modes(self) -> tuple[int, ...]:
        """Buckling mode of each rod."""
        return tuple(rod.mode for rod in self.rods)

    @property
    def energy(self) -> float:
        """Bending energy of the rods less the work of the load on the end-effector, in J."""
        return self._facts.energy * self.mechanism.units.energy

    @property
    def residual(self) -> float:
        """Largest error of closure, relative to the mean rod length, or of equilibrium, relative to 1 + force."""
        return self._facts.residual

    @property
    def index(self) -> int:
        """Morse index: number of unstable directions of the rods' whole energy under the closure constraints."""
        return self._facts.morse_index

    @property
    def is_stable(self) -> bool:
        """Whether the energy has a strict local minimum here: index 0 with positive definite stiffness.

        Of a singular state, at a fold or on a family of equilibria, rounding alone would decide: it is not called so.
        """
        return self.index == 0 and not self._is_singular

    @cached_property
    def _is_singular(self) -> bool:
        """Whether the equations do not fix the state: their least singular value is rounding."""
        state, inputs, load = self.kernel_values()
        _, matrix, _ = linearised(self.mechanism.leg_table, state, inputs, load, False)
        values = np.linalg.svd(matrix, compute_uv=False)
        return bool(values[-1] < _ROUNDING * values[0])

    @property
    def stability_margin(self) -> float:
        """Least eigenvalue of the stiffness, dimensionless (EI = L = 1); means stability only of a stable state."""
        return self._facts.stability_margin

    @property
    def singularity_margin(self) -> float:
        """About how far, in input space, the nearest fold is, in rad and mean rod lengths; zero exactly at a fold.

        The cheap stand-in for `nearest_fold`. It extrapolates the squared eigenvalues of the stiffness, which are
        linear in the inputs near a fold, to zero: exact in the limit. Elsewhere it errs to both sides, by
        several times at worst, and proves nothing; ``python -m benchmarks margins`` says how often it misleads. Where
        no fold is near it means nothing but that; it is at most 10.
        """
        return self._facts.singularity_margin

    @property
    def stiffness(self) -> Array:
        """Stiffness of the end-effector, d force / d pose at fixed inputs, (d, d), in N/m, N and N m."""
        return self._facts.stiffness * self.mechanism.units.stiffness

    @property
    def forward_jacobian(self) -> Array:
        """Derivative of the pose by the inputs along the branch, (d, legs), by implicit differentiation.

        Raises
        ------
        numpy.linalg.LinAlgError
            At a singular point, where it does not exist.
        """
        if not self._facts.is_regular:
            raise np.linalg.LinAlgError("the forward Jacobian does not exist: this equilibrium is a singular point")
        return self._facts.jacobian * self.mechanism.units.jacobian

    @cached_property
    def inputs_within_limits(self) -> Array | None:
        """The inputs with full turns of motors added that bring them within the limits: the fewest; None if none do."""
        actuators = [leg.actuator for leg in self.mechanism.legs]
        inputs = [_turned_within(*each) for each in zip(self.inputs.tolist(), actuators, strict=True)]
        limits = [actuator.limits for actuator in actuators]
        is_within = all(lower <= value <= upper for value, (lower, upper) in zip(inputs, limits, strict=True))
        return _frozen(np.array(inputs)) if is_within else None

    @property
    def within_limits(self) -> bool:
        """Whether every input, or of a motor any number of full turns from it, is within its actuator's limits."""
        return self.inputs_within_limits is not None

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
        points = whole_number("points", points, least=2, most=_MOST_POINTS)
        mechanism = self.mechanism
        shapes = np.empty((mechanism.leg_count, points, 2))
        state, inputs, _ = self.kernel_values()
        set_world_shapes(mechanism.leg_table, state, inputs, shapes)
        return shapes * mechanism.units.length

    def __getstate__(self) -> dict[str, Any]:
        """Pickle the defining data alone; what is derived is made again."""
        return {name: getattr(self, name) for name in self.__dataclass_fields__}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(
            {name: _frozen(value) if isinstance(value, np.ndarray) else value for name, value in state.items()}
        )

    def __repr__(self) -> str:
        """Return a line with what identifies the equilibrium."""
        pose = ", ".join(f"{value:.6g}" for value in self.pose)
        return (
            f"Equilibrium({self.mechanism.name}, pose=({pose}), modes={self.modes}, index={self.index}, "
            f"energy={self.energy:.6g})"
        )


def _turned_within(value: float, actuator: Actuator) -> float:
    """Return an input with the fewest full turns added that bring it within its limits, or past them if none do."""
    (lower, upper), period = actuator.limits, actuator.period
    if period > 0.0 and value < lower:
        return value + period * math.ceil((lower - value) / period)
    if period > 0.0 and value > upper:
        return value - period * math.ceil((value - upper) / period)
    return value


def _frozen(array: Array) -> Array:
    """Return a copy that cannot be written to."""
    frozen = np.array(array, dtype=np.float64)
    frozen.setflags(write=False)
    return frozen
