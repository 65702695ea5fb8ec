"""3PFR: a triangular platform on three rods whose clamps slide on rails."""

import math
from typing import NamedTuple

from pcm_gym.mechanism.catalogue.steel import STRIP, WIRE
from pcm_gym.mechanism.leg import Leg, Prismatic
from pcm_gym.mechanism.mechanism import Mechanism
from pcm_gym.mechanism.rod import Rod

_DIRECTIONS = tuple(math.radians(angle_deg) for angle_deg in (90.0, 210.0, 330.0))


class _Design(NamedTuple):
    """Three equal legs around the centre; angles are turned counter-clockwise, in rad."""

    rod: Rod
    base_radius: float  # of the circle of the bases, m
    rail_turn: float  # of the rail from the tangent of that circle
    clamp_turn: float  # of the clamp from inwards
    platform_radius: float  # of the circle of the hinges, m
    hinge_turn: float  # of the hinge from the direction of its base
    limits: tuple[float, float]  # m

    def legs(self) -> tuple[Leg, ...]:
        return tuple(self._leg(direction) for direction in _DIRECTIONS)

    def _leg(self, direction: float) -> Leg:
        hinge = direction + self.hinge_turn
        actuator = Prismatic(
            base=(self.base_radius * math.cos(direction), self.base_radius * math.sin(direction)),
            axis_angle=direction + math.pi / 2.0 + self.rail_turn,
            clamp_angle=direction + math.pi + self.clamp_turn,
            limits=self.limits,
        )
        return Leg(actuator, self.rod, (self.platform_radius * math.cos(hinge), self.platform_radius * math.sin(hinge)))


# The hinges are turned so that home, with all rods bowed to one side, is at phi = 0. At all inputs within the limits
# there are poses with each hinge within 0.98 m of its base, so that no rod is ever drawn straight.
_DESIGN = _Design(STRIP, 1.4, math.radians(10.0), math.radians(20.0), 0.7, 0.6325822, (-0.7, 0.7))
_PAPER_DESIGN = _Design(WIRE, 0.7, 0.0, 0.9, 0.3, 0.0, (-0.5, 0.5))


def make() -> Mechanism:
    """Return the 3PFR: a large platform on steel strips, rails nearly tangential; home at the centre, rods bowed."""
    return _with("3PFR", _DESIGN, (0.0, 0.0, 0.0))


def make_paper() -> Mechanism:
    """Return the 3PFR of the figures after the paper: tangential rails, wires so compressed that they would yield."""
    return _with("3PFR-paper", _PAPER_DESIGN, (0.0, 0.0, 0.161919))


def _with(name: str, design: _Design, home_pose: tuple[float, float, float]) -> Mechanism:
    return Mechanism(
        name=name,
        description="three rods, sliding actuators, rigid platform",
        legs=design.legs(),
        home_inputs=(0.0, 0.0, 0.0),
        home_pose=home_pose,
    )
