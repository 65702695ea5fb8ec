"""3PFR: a triangular platform on three rods whose clamps slide on tangential rails."""

import math

from pcm_gym.mechanism.catalogue.steel import STEEL_ROD
from pcm_gym.mechanism.leg import Leg, Prismatic
from pcm_gym.mechanism.mechanism import Mechanism

_BASE_RADIUS, _PLATFORM_RADIUS = 0.7, 0.3  # m
_DIRECTIONS = tuple(math.radians(angle_deg) for angle_deg in (90.0, 210.0, 330.0))
_CLAMP_TURN = math.pi + 0.9  # from the outward direction: inwards and 0.9 rad aside


def _leg(direction: float) -> Leg:
    outwards = (math.cos(direction), math.sin(direction))
    actuator = Prismatic(
        base=(_BASE_RADIUS * outwards[0], _BASE_RADIUS * outwards[1]),
        axis_angle=direction + math.pi / 2.0,
        clamp_angle=direction + _CLAMP_TURN,
        limits=(-0.5, 0.5),
    )
    return Leg(actuator, STEEL_ROD, (_PLATFORM_RADIUS * outwards[0], _PLATFORM_RADIUS * outwards[1]))


def make() -> Mechanism:
    """Return the 3PFR with pre-compressed legs; home is the equilibrium at the centre."""
    return Mechanism(
        name="3PFR",
        description="three rods, sliding actuators, rigid platform",
        legs=tuple(_leg(direction) for direction in _DIRECTIONS),
        home_inputs=(0.0, 0.0, 0.0),
        home_pose=(0.0, 0.0, 0.161919),
    )
