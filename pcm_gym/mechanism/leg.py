"""Actuators and legs: the parts of a mechanism, as frozen and validated data."""

import math
from dataclasses import dataclass, field
from typing import ClassVar

from pcm_gym.mechanism.rod import Rod
from pcm_gym.mechanism.validation import finite_number, finite_tuple, instance_of, limit_pair, positive_number, shown


@dataclass(frozen=True)
class Revolute:
    """A motor that turns the clamp about its base point; its input is an angle in rad.

    Parameters
    ----------
    base : (x, y)
        The clamped point, in m.
    clamp_angle : float
        World angle of the clamp at input 0, in rad: the rod leaves at ``clamp_angle + input``.
    limits : (lower, upper)
        Range of the input, in rad.
    greatest_torque : float, optional
        Greatest moment that the motor gives, in N m, to either side; None where it is not limited.

    Attributes
    ----------
    is_angle : bool
        True: the input is an angle.
    unit : str
        "rad".
    period : float
        Change of the input after which everything is the same again: a full turn, in rad.
    default_step : float
        Step of the input that agents take by default, in the kernels' unit: rad.
    axis : (x, y)
        Change of the clamped point by the input: none.
    rail_angle : None
        A motor has no rail.
    """

    is_angle: ClassVar[bool] = True
    unit: ClassVar[str] = "rad"
    period: ClassVar[float] = 2.0 * math.pi
    default_step: ClassVar[float] = 0.1
    axis: ClassVar[tuple[float, float]] = (0.0, 0.0)
    rail_angle: ClassVar[None] = None

    base: tuple[float, float]
    clamp_angle: float = 0.0
    limits: tuple[float, float] = (-3.141592653589793, 3.141592653589793)
    greatest_torque: float | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "base", finite_tuple("base", self.base, 2))
        object.__setattr__(self, "clamp_angle", finite_number("clamp_angle", self.clamp_angle))
        object.__setattr__(self, "limits", limit_pair("limits", self.limits))
        if self.greatest_torque is not None:
            object.__setattr__(self, "greatest_torque", positive_number("greatest_torque", self.greatest_torque))

    @property
    def greatest_effort(self) -> float | None:
        """Greatest torque."""
        return self.greatest_torque

    def clamp_point(self, value: float) -> tuple[float, float]:
        """Return the clamped point at an input: the base, whatever the angle."""
        finite_number("value", value)
        return self.base

    def clamp_direction(self, value: float) -> float:
        """Return the world angle, in rad, at which the rod leaves the clamp at an input."""
        return self.clamp_angle + finite_number("value", value)

    def distance(self, point: tuple[float, float]) -> float:
        """Return the least distance, in m, of the clamped point from `point` over all inputs."""
        return math.dist(self.base, finite_tuple("point", point, 2))


@dataclass(frozen=True)
class Prismatic:
    """A slider that moves the clamp along an axis, its direction unchanged; its input is a distance in m.

    Parameters
    ----------
    base : (x, y)
        The clamped point at input 0, in m.
    axis_angle : float
        World angle of the axis, in rad: the clamped point is ``base + input (cos axis_angle, sin axis_angle)``.
    clamp_angle : float
        World angle at which the rod leaves the clamp, in rad.
    limits : (lower, upper)
        Range of the input, in m.
    greatest_force : float, optional
        Greatest force that the slider gives, in N, to either side; None where it is not limited.

    Attributes
    ----------
    is_angle : bool
        False: the input is a distance.
    unit : str
        "m".
    period : float
        0: no two inputs are the same.
    default_step : float
        Step of the input that agents take by default, in the kernels' unit: mean rod lengths.
    """

    is_angle: ClassVar[bool] = False
    unit: ClassVar[str] = "m"
    period: ClassVar[float] = 0.0
    default_step: ClassVar[float] = 0.03

    base: tuple[float, float]
    axis_angle: float
    clamp_angle: float
    limits: tuple[float, float] = (-0.5, 0.5)
    greatest_force: float | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "base", finite_tuple("base", self.base, 2))
        object.__setattr__(self, "axis_angle", finite_number("axis_angle", self.axis_angle))
        object.__setattr__(self, "clamp_angle", finite_number("clamp_angle", self.clamp_angle))
        object.__setattr__(self, "limits", limit_pair("limits", self.limits))
        if self.greatest_force is not None:
            object.__setattr__(self, "greatest_force", positive_number("greatest_force", self.greatest_force))

    @property
    def greatest_effort(self) -> float | None:
        """Greatest force."""
        return self.greatest_force

    @property
    def axis(self) -> tuple[float, float]:
        """Change of the clamped point by the input: the unit vector along the axis."""
        return math.cos(self.axis_angle), math.sin(self.axis_angle)

    @property
    def rail_angle(self) -> float:
        """World angle of the rail along which the slider moves, in rad."""
        return self.axis_angle

    def clamp_point(self, value: float) -> tuple[float, float]:
        """Return the clamped point, in m, at an input."""
        (x, y), way = self.axis, finite_number("value", value)
        return self.base[0] + way * x, self.base[1] + way * y

    def clamp_direction(self, value: float) -> float:
        """Return the world angle, in rad, at which the rod leaves the clamp: the same at every input."""
        finite_number("value", value)
        return self.clamp_angle

    def distance(self, point: tuple[float, float]) -> float:
        """Return the least distance, in m, of the clamped point from `point` over all inputs."""
        (there_x, there_y), (x, y) = finite_tuple("point", point, 2), self.axis
        away_x, away_y = there_x - self.base[0], there_y - self.base[1]
        return abs(away_x * y - away_y * x)


Actuator = Revolute | Prismatic


@dataclass(frozen=True)
class Leg:
    """An actuator, the rod clamped to it, and the hinge that joins the rod's tip to the end-effector.

    Parameters
    ----------
    actuator : Revolute or Prismatic
    rod : Rod
    attachment : (x, y)
        The hinge in the end-effector's frame, in m; (0, 0) for a point end-effector.
    """

    actuator: Actuator
    rod: Rod = field(default_factory=Rod)
    attachment: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        if not isinstance(self.actuator, Actuator):
            raise TypeError(f"actuator must be a Revolute or a Prismatic, got {shown(self.actuator)}")
        instance_of("rod", self.rod, Rod)
        object.__setattr__(self, "attachment", finite_tuple("attachment", self.attachment, 2))
