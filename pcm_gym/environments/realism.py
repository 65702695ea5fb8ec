"""What real mechanisms add: parts that differ, and actuators that lag and have play. All off by default."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from pcm_gym.arrays import Array
from pcm_gym.environments.motion import Motion, Response
from pcm_gym.mechanism import Mechanism, Rod
from pcm_gym.mechanism.validation import (
    finite_number,
    finite_vector,
    number_not_negative,
    one_of,
    shape_of,
    shown,
)


@dataclass(frozen=True)
class Randomisation:
    """How much a mechanism differs from episode to episode. Every number is drawn evenly and by itself.

    Attributes
    ----------
    stiffness, length : float
        Largest relative deviation of each rod's bending stiffness and length, in [0, 1).
    base, attachment : float
        Largest deviation, along x and along y, of each leg's base and hinge on the platform, in m.
    """

    stiffness: float = 0.0
    length: float = 0.0
    base: float = 0.0
    attachment: float = 0.0

    def __post_init__(self) -> None:
        for field in fields(self):
            name = f"randomisation[{field.name!r}]"
            value = finite_number(name, getattr(self, field.name))
            most = 1.0 if field.name in ("stiffness", "length") else math.inf
            if not 0.0 <= value < most:
                raise ValueError(f"{name} must be at least 0 and less than {most:g}, got {value}")
            object.__setattr__(self, field.name, value)

    @classmethod
    def from_mapping(cls, deviations: Mapping[str, float] | None) -> "Randomisation":
        """Return the randomisation with these deviations, by name."""
        if not isinstance(deviations, Mapping | None):
            raise TypeError(f"randomisation must be a mapping of deviations, got {shown(deviations)}")
        for name in deviations or {}:
            one_of("randomisation key", name, [field.name for field in fields(cls)])
        return cls(**(deviations or {}))

    @property
    def is_off(self) -> bool:
        """Whether nothing deviates."""
        return self == Randomisation()

    def check(self, mechanism: Mechanism) -> "Randomisation":
        """Return itself; raise if the mechanism has no such parts."""
        if self.attachment > 0.0 and mechanism.dof == 2:
            raise ValueError(
                f"randomisation['attachment'] must be 0 for mechanism {mechanism.name!r}: its hinges share one point"
            )
        return self

    def draw(self, mechanism: Mechanism, numbers: np.random.Generator) -> Mechanism:
        """Return a variant of a mechanism. Its dimensionless numbers are relative to the mechanism's own rods."""
        units = mechanism.units
        reference = Rod(units.length, units.force * units.length**2)
        legs = []
        for leg in mechanism.legs:
            factors = 1.0 + numbers.uniform(-1.0, 1.0, 2) * (self.length, self.stiffness)
            base = np.array(leg.actuator.base) + numbers.uniform(-self.base, self.base, 2)
            attachment = np.array(leg.attachment) + numbers.uniform(-self.attachment, self.attachment, 2)
            legs.append(
                replace(
                    leg,
                    actuator=replace(leg.actuator, base=tuple(base.tolist())),
                    rod=leg.rod.scaled(*factors.tolist()),
                    attachment=tuple(attachment.tolist()),
                )
            )
        return replace(mechanism, legs=tuple(legs), reference=reference)


@dataclass(frozen=True)
class Actuators:
    """How the actuators follow what they are told, step by step; ideal ones at once.

    A command moves by the action. The drive follows it with a first-order lag and at a limited rate, and moves the
    clamp through a gear with play.

    Attributes
    ----------
    lag : float
        Time constant of the drive, in steps.
    rate_limit : array (legs,)
        Largest move of the drive in one step, dimensionless; infinite without a limit.
    backlash : array (legs,)
        Play between drive and clamp, dimensionless.
    """

    lag: float
    rate_limit: Array
    backlash: Array

    @classmethod
    def from_arguments(
        cls, mechanism: Mechanism, lag: float, rate_limit: ArrayLike | None, backlash: ArrayLike
    ) -> "Actuators":
        """Return the actuators for the keyword arguments of an environment, which are in rad or m."""
        units = mechanism.units
        rates = np.full(mechanism.leg_count, math.inf)
        if rate_limit is not None:
            rates = units.kernel_from_inputs(per_leg("rate_limit", rate_limit, mechanism))
            if not (rates > 0.0).all():
                raise ValueError(f"rate_limit must be greater than 0, got {shown(rate_limit)}")
        play = units.kernel_from_inputs(per_leg("backlash", backlash, mechanism))
        if not (play >= 0.0).all():
            raise ValueError(f"backlash must be at least 0, got {shown(backlash)}")
        return cls(number_not_negative("actuator_lag", lag), rates, play)

    @cached_property
    def are_ideal(self) -> bool:
        """Whether the clamps go at once where they are told to."""
        return self.lag == 0.0 and not self.backlash.any() and bool(np.isinf(self.rate_limit).all())

    @property
    def part(self) -> float:
        """Part of the way to its command that a drive goes in a step, unless its rate is limited."""
        return 1.0 if self.lag == 0.0 else -math.expm1(-1.0 / self.lag)

    def told(self, motion: Motion) -> tuple[Array, Array]:
        """Return what the actuators have been told and where their drives are, (n, legs) each."""
        return (motion.inputs, motion.inputs) if self.are_ideal else (motion.commands, motion.drives)

    def respond(self, actions: Array, motion: Motion, stride: Array, limits: tuple[Array, Array]) -> Response:
        """Return where actions (n, legs), cut to [-1, 1], times the stride take the actuators; nothing is moved.

        Commands are cut at the least and the greatest inputs, the limits, (legs,) each.
        """
        wishes = motion.commands + np.clip(actions, -1.0, 1.0) * stride
        commands = np.clip(wishes, *limits)
        drives, clamps = self.follow(commands, motion.drives, motion.inputs)
        return Response((clamps - motion.inputs) / stride, commands, drives, (commands != wishes).any(axis=1))

    def follow(self, commands: Array, drives: Array, clamps: Array) -> tuple[Array, Array]:
        """Return drives and clamps (n, legs) one step after they were told to go to the commands."""
        moved = drives + np.clip(self.part * (commands - drives), -self.rate_limit, self.rate_limit)
        return moved, np.clip(clamps, moved - 0.5 * self.backlash, moved + 0.5 * self.backlash)


def per_leg(name: str, value: Any, mechanism: Mechanism) -> Array:
    """Return one number for each leg, from one for all or one for each."""
    count = mechanism.leg_count
    return finite_vector(name, np.full(count, finite_number(name, value)) if shape_of(value) == () else value, count)
