"""The numbers of a design: their names, their values, and what each does to its leg."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from pcm_gym.arrays import Array
from pcm_gym.kernels.statics.sensitivity import (
    CLAMP_TURN,
    CLAMP_X,
    CLAMP_Y,
    EFFECTS,
    HINGE_X,
    HINGE_Y,
    STIFFENING,
    STRETCH,
    TILT_X,
    TILT_Y,
)
from pcm_gym.mechanism import Leg, Mechanism, Prismatic, Rod
from pcm_gym.mechanism.mechanism import Units
from pcm_gym.mechanism.validation import finite_vector, instance_of, one_of, sequence_of, whole_number

# Effects of a parameter on its leg at a dimensionless input, by columns of the kernels' table.
_Effect = dict[int, float]


class _Kind(NamedTuple):
    """What a parameter is."""

    value: Callable[[Leg], float]
    changed: Callable[[Leg, float], Leg]
    effect: Callable[[Leg, Units, float], _Effect]


def _at(pair: tuple[float, float], axis: int, value: float) -> tuple[float, float]:
    return (value, pair[1]) if axis == 0 else (pair[0], value)


def _with_actuator(leg: Leg, **changes: Any) -> Leg:
    return replace(leg, actuator=replace(leg.actuator, **changes))


def _with_length(leg: Leg, value: float) -> Leg:
    return replace(leg, rod=replace(leg.rod, length=value))


def _with_stiffness(leg: Leg, value: float) -> Leg:
    rod = leg.rod
    if rod.material is None:
        return replace(leg, rod=replace(rod, bending_stiffness=value))
    return replace(leg, rod=rod.scaled(1.0, value / rod.bending_stiffness))


def _tilt(leg: Leg, units: Units, value: float) -> _Effect:
    x, y = leg.actuator.axis
    return {TILT_X: -y, TILT_Y: x, CLAMP_X: -value * y, CLAMP_Y: value * x}


def _axis_angle(leg: Leg) -> float:
    assert isinstance(leg.actuator, Prismatic)
    return leg.actuator.axis_angle


def _of_base(axis: int) -> _Kind:
    return _Kind(
        lambda leg: leg.actuator.base[axis],
        lambda leg, value: _with_actuator(leg, base=_at(leg.actuator.base, axis, value)),
        lambda leg, units, value: {(CLAMP_X, CLAMP_Y)[axis]: 1.0 / units.length},
    )


def _of_attachment(axis: int) -> _Kind:
    return _Kind(
        lambda leg: leg.attachment[axis],
        lambda leg, value: replace(leg, attachment=_at(leg.attachment, axis, value)),
        lambda leg, units, value: {(HINGE_X, HINGE_Y)[axis]: 1.0 / units.length},
    )


_KINDS = {
    "length": _Kind(
        lambda leg: leg.rod.length, _with_length, lambda leg, units, value: {STRETCH: 1.0 / leg.rod.length}
    ),
    "bending_stiffness": _Kind(
        lambda leg: leg.rod.bending_stiffness,
        _with_stiffness,
        lambda leg, units, value: {STIFFENING: 1.0 / leg.rod.bending_stiffness},
    ),
    "base_x": _of_base(0),
    "base_y": _of_base(1),
    "clamp_angle": _Kind(
        lambda leg: leg.actuator.clamp_angle,
        lambda leg, value: _with_actuator(leg, clamp_angle=value),
        lambda leg, units, value: {CLAMP_TURN: 1.0},
    ),
    "axis_angle": _Kind(_axis_angle, lambda leg, value: _with_actuator(leg, axis_angle=value), _tilt),
    "attachment_x": _of_attachment(0),
    "attachment_y": _of_attachment(1),
}
NAMES = tuple(_KINDS)
_OF_RODS = ("length", "bending_stiffness")


@dataclass(frozen=True)
class DesignParameter:
    """A number of a mechanism's design.

    Parameters
    ----------
    name : str
        "length" (m) or "bending_stiffness" (N m^2) of the rod, "base_x", "base_y" (m) or "clamp_angle" (rad) of the
        actuator, "axis_angle" (rad) of a slider, "attachment_x" or "attachment_y" (m) of the hinge on a platform.
    leg : int
        Whose it is, from 0.

    Raises
    ------
    TypeError, ValueError
        If there is no such name, or the leg is no whole number from 0 to 2.
    """

    name: str
    leg: int

    def __post_init__(self) -> None:
        one_of("name", self.name, NAMES)
        object.__setattr__(self, "leg", whole_number("leg", self.leg, least=0, most=2))

    def __str__(self) -> str:
        """Return the name and the leg, such as "length of leg 0"."""
        return f"{self.name} of leg {self.leg}"

    @property
    def is_positive(self) -> bool:
        """Whether the number must be greater than zero: a length or a stiffness of a rod."""
        return self.name in _OF_RODS

    def value(self, mechanism: Mechanism) -> float:
        """Return the value that a mechanism has.

        Raises
        ------
        TypeError, ValueError
            If it is no mechanism, or one without such a parameter.
        """
        checked_parameters(mechanism, [self])
        return _KINDS[self.name].value(mechanism.legs[self.leg])


def checked_parameters(mechanism: Mechanism, parameters: Sequence[DesignParameter]) -> tuple[DesignParameter, ...]:
    """Return parameters as a tuple; raise unless there are some, once each, that the mechanism has."""
    instance_of("mechanism", mechanism, Mechanism)
    members = sequence_of("parameters", parameters, DesignParameter)
    if not members:
        raise ValueError("parameters must be one at least, got none")
    for own in members:
        if members.count(own) > 1:
            raise ValueError(f"parameters must be named once each, got {own} more than once")
        if own.leg >= mechanism.leg_count:
            raise ValueError(
                f"parameters must be of legs 0 to {mechanism.leg_count - 1} of {mechanism.name!r}, got {own}"
            )
        if own.name == "axis_angle" and mechanism.legs[own.leg].actuator.is_angle:
            raise ValueError(f"parameters: 'axis_angle' is one of sliders, and leg {own.leg} has a motor")
        if own.name.startswith("attachment") and mechanism.dof == 2:
            raise ValueError(f"parameters: {own.name!r} is one of platforms, and two legs share a point")
    return members


def change_design(mechanism: Mechanism, parameters: Sequence[DesignParameter], values: ArrayLike) -> Mechanism:
    """Return a variant of a mechanism with other values of some parameters.

    Parameters
    ----------
    mechanism : Mechanism
    parameters : sequence of DesignParameter
    values : array_like (m,)
        One for each, in its unit. Where a rod has a material, its modulus makes the bending stiffness.

    Returns
    -------
    Mechanism
        With the same `reference`, or that of the mechanism's own means: dimensionless numbers keep their meaning.

    Raises
    ------
    TypeError, ValueError
        If a parameter is none of the mechanism, or a value one that it cannot have.
    """
    members = checked_parameters(mechanism, parameters)
    legs = list(mechanism.legs)
    for own, value in zip(members, finite_vector("values", values, len(members)).tolist(), strict=True):
        if own.is_positive and not value > 0.0:
            raise ValueError(f"values must be greater than 0 for {own}, got {value}")
        legs[own.leg] = _KINDS[own.name].changed(legs[own.leg], value)
    return replace(mechanism, legs=tuple(legs), reference=reference_of(mechanism))


def reference_of(mechanism: Mechanism) -> Rod:
    """Return the rod whose length and stiffness are the units of a mechanism's dimensionless numbers."""
    units = mechanism.units
    return mechanism.reference or Rod(units.length, units.force * units.length**2)


def effects_of(mechanism: Mechanism, parameters: Sequence[DesignParameter], inputs: Array) -> Array:
    """Return the kernels' table of what parameters, each in its unit, do at inputs (legs,): (m, legs, `EFFECTS`)."""
    effects, units = np.zeros((len(parameters), mechanism.leg_count, EFFECTS)), mechanism.units
    values = units.kernel_from_inputs(inputs)
    for row, own in zip(effects, parameters, strict=True):
        effect = _KINDS[own.name].effect(mechanism.legs[own.leg], units, float(values[own.leg]))
        row[own.leg, list(effect)] = list(effect.values())
    return effects


def least_value(parameter: DesignParameter) -> float:
    """Return what a parameter's values must be greater than."""
    return 0.0 if parameter.is_positive else -math.inf
