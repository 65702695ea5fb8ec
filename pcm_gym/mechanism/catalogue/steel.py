"""The rod of the catalogue: round steel wire, 1 m long, 1 mm in radius."""

import math

from pcm_gym.mechanism.leg import Rod

_YOUNG_MODULUS = 200e9  # Pa
_RADIUS = 1e-3  # m

STEEL_ROD = Rod(length=1.0, bending_stiffness=_YOUNG_MODULUS * math.pi * _RADIUS**4 / 4.0)
