"""2PFR: two rods on parallel vertical rails, hinged tip to tip."""

import math

from pcm_gym.mechanism.catalogue.steel import STEEL_ROD
from pcm_gym.mechanism.leg import Leg, Prismatic
from pcm_gym.mechanism.mechanism import Mechanism

_UP = math.pi / 2.0


def make() -> Mechanism:
    """Return the 2PFR: rails 0.4 m apart, rods clamped along them."""
    return Mechanism(
        name="2PFR",
        description="two rods, sliding actuators, point end-effector",
        legs=tuple(
            Leg(Prismatic(base=(x, 0.0), axis_angle=_UP, clamp_angle=_UP, limits=(-0.5, 0.5)), STEEL_ROD)
            for x in (-0.2, 0.2)
        ),
        home_inputs=(0.0, 0.0),
        home_pose=(0.0, 0.976),
    )
