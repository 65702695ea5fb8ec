"""2RFR: two rods on rotating motors, hinged tip to tip."""

import math

from pcm_gym.mechanism.catalogue.steel import STEEL_ROD
from pcm_gym.mechanism.leg import Leg, Revolute
from pcm_gym.mechanism.mechanism import Mechanism

_LIMITS = (-math.pi / 2.0, 3.0 * math.pi / 2.0)  # one full turn, downwards to downwards


def make() -> Mechanism:
    """Return the 2RFR: motors 0.4 m apart, home with both rods bowed outwards."""
    return Mechanism(
        name="2RFR",
        description="two rods, rotating actuators, point end-effector",
        legs=tuple(Leg(Revolute(base=(x, 0.0), limits=_LIMITS), STEEL_ROD) for x in (-0.2, 0.2)),
        home_inputs=(math.radians(120.0), math.radians(60.0)),
        home_pose=(0.0, 0.9275),
    )
