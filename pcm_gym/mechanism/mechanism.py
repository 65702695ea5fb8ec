"""A planar parallel continuum mechanism as data, and its translation into the leg table of the kernels."""

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from pcm_gym.arrays import Array
from pcm_gym.kernels.statics import closure
from pcm_gym.mechanism.leg import Leg
from pcm_gym.mechanism.rod import Rod
from pcm_gym.mechanism.validation import finite_tuple, finite_vector, instance_of, sequence_of, shape_of, shown, text

# Largest coordinate of a base in lengths of the shortest rod: there a length is known to about 1e-7 of it.
_FARTHEST_BASE = 1e9


@dataclass(frozen=True)
class Units:
    """The door between the mechanism's own units and the kernels' dimensionless numbers.

    Lengths are measured in the mean rod length L, forces in EI / L^2 with the mean bending stiffness EI, or in those of
    the mechanism's reference rod. The fields are the factors out of the kernels; inputs, poses and loads go in and out
    by the methods, which take one or an array of them, (..., n), or differences of such, and return a new array.
    """

    length: float
    force: float
    inputs: Array  # (legs,): 1 for an angle, L for a distance
    pose: Array  # (d,): (L, L) or (L, L, 1)
    load: Array  # (d,): (force, force) or (force, force, force L)

    def kernel_from_inputs(self, inputs: Array) -> Array:
        """Return inputs, rad or m, as the kernels take them."""
        return inputs / self.inputs

    def inputs_from_kernel(self, inputs: Array) -> Array:
        """Return inputs of the kernels in rad or m."""
        return inputs * self.inputs

    def kernel_from_pose(self, pose: Array) -> Array:
        """Return poses, m and rad, as the kernels take them."""
        return pose / self.pose

    def pose_from_kernel(self, pose: Array) -> Array:
        """Return poses of the kernels in m and rad."""
        return pose * self.pose

    def kernel_from_load(self, load: Array) -> Array:
        """Return loads, N and N m, as the kernels take them."""
        return load / self.load

    def load_from_kernel(self, load: Array) -> Array:
        """Return loads of the kernels in N and N m."""
        return load * self.load

    @property
    def energy(self) -> float:
        """Unit of energy: EI / L."""
        return self.force * self.length

    @property
    def stiffness(self) -> Array:
        """Units of the stiffness matrix, (d, d): energy over pose times pose."""
        return self.energy / np.outer(self.pose, self.pose)

    @property
    def jacobian(self) -> Array:
        """Units of the derivative of the pose by the inputs, (d, legs): pose over inputs."""
        return np.outer(self.pose, 1.0 / self.inputs)


@dataclass(frozen=True)
class Mechanism:
    """Two or more legs that share one end-effector.

    Two legs whose hinges coincide at the end-effector's origin make a point end-effector with pose (x, y); anything
    else makes a rigid platform with pose (x, y, phi), which takes three legs.

    Parameters
    ----------
    name : str
    legs : sequence of Leg
        Two for a point end-effector, three for a platform: as many actuators as degrees of freedom.
    home_inputs : sequence of float, optional
        Actuator inputs of the home position, rad or m, within the limits; the middle of the limits by default.
    home_pose : sequence of float, optional
        The stable equilibrium nearest to this pose is home; the one of least energy by default.
    reference : Rod, optional
        Rod whose length and bending stiffness are the units of dimensionless numbers; the legs' means by default.
        Variants of one mechanism share a reference, so that their numbers mean the same.

    Raises
    ------
    TypeError, ValueError
        If a part is of the wrong kind, shape or range.
    """

    name: str
    legs: tuple[Leg, ...]
    home_inputs: tuple[float, ...] | None = None
    home_pose: tuple[float, ...] | None = None
    description: str = field(default="", compare=False)
    reference: Rod | None = None

    def __post_init__(self) -> None:
        text("name", self.name)
        if not isinstance(self.description, str):
            raise TypeError(f"description must be a string, got {shown(self.description)}")
        legs = sequence_of("legs", self.legs, Leg)
        object.__setattr__(self, "legs", legs)
        if len(legs) not in (2, 3):
            raise ValueError(f"legs must number 2 (point end-effector) or 3 (platform), got {len(legs)}")
        if len(legs) == 2 and any(leg.attachment != (0.0, 0.0) for leg in legs):
            raise ValueError(
                "two legs must share a point end-effector, attachment (0, 0) each; "
                f"got {[leg.attachment for leg in legs]} (a platform takes three legs)"
            )
        if len(legs) == 3 and len({leg.attachment for leg in legs}) == 1:
            raise ValueError(f"the attachments of a platform must not all coincide, got {legs[0].attachment}")
        if self.reference is not None:
            instance_of("reference", self.reference, Rod)
        self._check_units()
        limit = _FARTHEST_BASE * min(leg.rod.length for leg in legs)
        for leg in legs:
            if max(map(abs, leg.actuator.base)) > limit:
                raise ValueError(
                    f"base must be within {limit:g} of the origin, {_FARTHEST_BASE:g} lengths of the shortest rod: "
                    f"double precision does not resolve the rod further away; got {leg.actuator.base}"
                )
        self._check_home()

    def _check_units(self) -> None:
        """Raise where sizes are so far apart that some of them are nothing, or infinite, in the units of the others."""
        try:
            with np.errstate(all="ignore"):
                units = self.units
                factors = np.array([units.length, units.force, units.energy])
                numbers = np.concatenate([factors, units.stiffness.ravel(), self.leg_table.ravel()])
                is_sound = bool((factors > 0.0).all() and np.isfinite(numbers).all())
        except (OverflowError, ZeroDivisionError):
            is_sound = False
        if not is_sound:
            raise ValueError(
                "legs must have lengths, stiffnesses and places that double precision can hold in units of each other, "
                f"got {shown(self.legs)}"
            )

    def _check_home(self) -> None:
        if self.home_inputs is None:
            home = tuple(0.5 * sum(leg.actuator.limits) for leg in self.legs)
        else:
            home = finite_tuple("home_inputs", self.home_inputs, len(self.legs))
        object.__setattr__(self, "home_inputs", home)
        for value, leg in zip(home, self.legs, strict=True):
            lower, upper = leg.actuator.limits
            if not lower <= value <= upper:
                raise ValueError(f"home_inputs must be within the limits {leg.actuator.limits}, got {value}")
        if self.home_pose is not None:
            object.__setattr__(self, "home_pose", finite_tuple("home_pose", self.home_pose, self.dof))

    @property
    def leg_count(self) -> int:
        """Number of legs, and of actuator inputs."""
        return len(self.legs)

    @property
    def dof(self) -> int:
        """Degrees of freedom d of the end-effector: 2 (point) or 3 (platform)."""
        return 2 if self.leg_count == 2 else 3

    @property
    def state_size(self) -> int:
        """Size of the kernels' state vector, 2 legs + d."""
        return 2 * self.leg_count + self.dof

    @cached_property
    def lower_limits(self) -> Array:
        """Lower limits of the inputs, (legs,), rad or m."""
        return np.array([leg.actuator.limits[0] for leg in self.legs])

    @cached_property
    def upper_limits(self) -> Array:
        """Upper limits of the inputs, (legs,), rad or m."""
        return np.array([leg.actuator.limits[1] for leg in self.legs])

    @cached_property
    def kernel_limits(self) -> tuple[Array, Array]:
        """Lower and upper limits of the inputs as the kernels take them, (legs,) each."""
        return self.units.kernel_from_inputs(self.lower_limits), self.units.kernel_from_inputs(self.upper_limits)

    @cached_property
    def units(self) -> Units:
        """Factors between the kernels' dimensionless numbers and SI."""
        rods = [leg.rod for leg in self.legs] if self.reference is None else [self.reference]
        length = math.fsum(rod.length for rod in rods) / len(rods)
        stiffness = math.fsum(rod.bending_stiffness for rod in rods) / len(rods)
        force = stiffness / length**2
        is_angle = [leg.actuator.is_angle for leg in self.legs]
        return Units(
            length=length,
            force=force,
            inputs=np.where(is_angle, 1.0, length),
            pose=np.array([length, length, 1.0])[: self.dof],
            load=np.array([force, force, force * length])[: self.dof],
        )

    @cached_property
    def leg_table(self) -> Array:
        """The kernels' view of the legs, dimensionless, (legs, 12); see `pcm_gym.kernels.statics.closure`."""
        table = np.zeros((self.leg_count, closure.LEG_COLUMNS))
        units = self.units
        for row, leg, input_unit in zip(table, self.legs, units.inputs, strict=True):
            actuator, rod = leg.actuator, leg.rod
            row[[closure.BASE_X, closure.BASE_Y]] = np.array(actuator.base) / units.length
            row[closure.CLAMP_ANGLE] = actuator.clamp_angle
            row[closure.TURN] = float(actuator.is_angle)
            row[[closure.AXIS_X, closure.AXIS_Y]] = actuator.axis
            row[closure.LENGTH] = rod.length / units.length
            row[closure.STIFFNESS] = rod.bending_stiffness / (units.force * units.length**2)
            row[[closure.ATTACH_X, closure.ATTACH_Y]] = np.array(leg.attachment) / units.length
            row[[closure.LOWER, closure.UPPER]] = np.array(actuator.limits) / input_unit
        table.setflags(write=False)
        return table

    def check_inputs(self, inputs: ArrayLike) -> Array:
        """Return `inputs` as a new array (legs,); raise if shape or values are wrong (limits are not checked)."""
        return finite_vector("inputs", inputs, self.leg_count)

    def check_pose(self, pose: ArrayLike) -> Array:
        """Return `pose` as a new array (d,); raise if shape or values are wrong."""
        return finite_vector("pose", pose, self.dof)

    def check_load(self, load: ArrayLike | None) -> Array:
        """Return `load` as a new array (d,): (Fx, Fy), on a platform also M; missing parts are zero."""
        full = np.zeros(self.dof)
        if load is None:
            return full
        size = 2 if self.dof == 3 and shape_of(load) == (2,) else self.dof
        full[:size] = finite_vector("load", load, size)
        return full

    def hinges(self, pose: ArrayLike) -> Array:
        """Return where the hinges are at a pose, (legs, 2), in m."""
        pose = self.check_pose(pose)
        phi = pose[2] if self.dof == 3 else 0.0
        turn = np.array([[math.cos(phi), -math.sin(phi)], [math.sin(phi), math.cos(phi)]])
        hinges: Array = pose[:2] + np.array([leg.attachment for leg in self.legs]) @ turn.T
        return hinges

    def __hash__(self) -> int:
        """Return the hash of what makes mechanisms equal, worked out once: what is known of one is looked up often."""
        return self._hash

    @cached_property
    def _hash(self) -> int:
        return hash((self.name, self.legs, self.home_inputs, self.home_pose, self.reference))

    def __getstate__(self) -> dict[str, Any]:
        """Pickle the data alone; what is derived is made again."""
        return {name: getattr(self, name) for name in self.__dataclass_fields__}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
