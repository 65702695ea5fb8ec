"""2PFR: two rods on straight rails, hinged tip to tip."""

import math

from pcm_gym.mechanism.catalogue.steel import STRIP, WIRE
from pcm_gym.mechanism.leg import Leg, Prismatic
from pcm_gym.mechanism.mechanism import Mechanism

_DESCRIPTION = "two rods, sliding actuators, point end-effector"
_UP = math.pi / 2.0
_LEAN, _TURN = math.radians(40.0), math.radians(35.0)
_SIDES = (-1.0, 1.0)


def make() -> Mechanism:
    """Return the 2PFR: rails that lean outwards by 40 degrees and cross below, strips clamped 35 degrees inwards."""
    rails = [
        Prismatic(
            base=(0.08 * side, 0.0),
            axis_angle=_UP - side * _LEAN,
            clamp_angle=_UP + side * _TURN,
            limits=(-0.7, 0.7),
        )
        for side in _SIDES
    ]
    return Mechanism(
        name="2PFR",
        description=_DESCRIPTION,
        legs=tuple(Leg(rail, STRIP) for rail in rails),
        home_inputs=(0.0, 0.0),
        home_pose=(0.0, 0.969),
    )


def make_paper() -> Mechanism:
    """Return the 2PFR of the paper's figures: vertical rails 0.4 m apart, steel wires clamped along them."""
    rails = [Prismatic(base=(0.2 * side, 0.0), axis_angle=_UP, clamp_angle=_UP, limits=(-0.5, 0.5)) for side in _SIDES]
    return Mechanism(
        name="2PFR-paper",
        description=_DESCRIPTION,
        legs=tuple(Leg(rail, WIRE) for rail in rails),
        home_inputs=(0.0, 0.0),
        home_pose=(0.0, 0.976),
    )
