"""2RFR: two rods on rotating motors, hinged tip to tip."""

import math

from pcm_gym.mechanism.catalogue.steel import STRIP, WIRE
from pcm_gym.mechanism.leg import Leg, Revolute
from pcm_gym.mechanism.mechanism import Mechanism
from pcm_gym.mechanism.rod import Rod

_HALF_TURN = math.pi
# One full turn each: of the left motor from left to left, of the right one from right to right.
_LIMITS = ((-_HALF_TURN, _HALF_TURN), (0.0, 2.0 * _HALF_TURN))
# The same for both, from downwards to downwards.
_PAPER_LIMITS = ((-0.5 * _HALF_TURN, 1.5 * _HALF_TURN),) * 2


def make() -> Mechanism:
    """Return the 2RFR: motors 0.4 m apart, steel strips, home with both rods bowed outwards."""
    return _with("2RFR", STRIP, _LIMITS)


def make_paper() -> Mechanism:
    """Return the 2RFR of the paper's figures: the same motors, with steel wires that yield within the limits."""
    return _with("2RFR-paper", WIRE, _PAPER_LIMITS)


def _with(name: str, rod: Rod, limits: tuple[tuple[float, float], ...]) -> Mechanism:
    motors = [Revolute(base=(x, 0.0), limits=own) for x, own in zip((-0.2, 0.2), limits, strict=True)]
    return Mechanism(
        name=name,
        description="two rods, rotating actuators, point end-effector",
        legs=tuple(Leg(motor, rod) for motor in motors),
        home_inputs=(math.radians(120.0), math.radians(60.0)),
        home_pose=(0.0, 0.9275),
    )
