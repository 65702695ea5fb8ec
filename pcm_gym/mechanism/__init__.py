"""Mechanisms as frozen, validated data, and the catalogue of named ones.

Read `leg` (rods, actuators and their properties, legs), then `mechanism` (legs around one end-effector; `Units` and the
leg table, the door to the kernels). `catalogue` names some, `text` writes and reads them, `validation` checks
arguments for the whole package.

Symbols
-------
L, EI : length and bending stiffness of a rod; their means over the legs are the kernels' units.
d : degrees of freedom of the end-effector: 2, (x, y), or 3, (x, y, phi).
"""

from pcm_gym.mechanism.catalogue import get_mechanism, mechanism_names, register_mechanism
from pcm_gym.mechanism.leg import Leg, Prismatic, Revolute, Rod
from pcm_gym.mechanism.mechanism import Mechanism, Units
from pcm_gym.mechanism.text import mechanism_from_json, mechanism_to_json

__all__ = [
    "Leg",
    "Mechanism",
    "Prismatic",
    "Revolute",
    "Rod",
    "Units",
    "get_mechanism",
    "mechanism_from_json",
    "mechanism_names",
    "mechanism_to_json",
    "register_mechanism",
]
