"""Mechanisms as frozen, validated data, and the catalogue of named ones.

Read `rod` (rods, their sections and materials; `materials` names some), `leg` (actuators and their properties, legs),
then `mechanism` (legs around one end-effector; `Units` and the leg table, the door to the kernels). `catalogue` names
some, `text` writes and reads them as `schema` says, `validation` checks
arguments for the whole package.

Symbols
-------
L, EI : length and bending stiffness of a rod; their means over the legs are the kernels' units.
d : degrees of freedom of the end-effector: 2, (x, y), or 3, (x, y, phi).
"""

from pcm_gym.mechanism.catalogue import get_mechanism, mechanism_names, register_mechanism
from pcm_gym.mechanism.leg import Leg, Prismatic, Revolute
from pcm_gym.mechanism.materials import FIBREGLASS, NITINOL, SPRING_STEEL
from pcm_gym.mechanism.mechanism import Mechanism, Units
from pcm_gym.mechanism.rod import Material, Rod, Round, Strip
from pcm_gym.mechanism.text import (
    MechanismFileError,
    load_mechanism,
    mechanism_from_json,
    mechanism_to_json,
    save_mechanism,
)

__all__ = [
    "FIBREGLASS",
    "NITINOL",
    "SPRING_STEEL",
    "Leg",
    "Material",
    "Mechanism",
    "MechanismFileError",
    "Prismatic",
    "Revolute",
    "Rod",
    "Round",
    "Strip",
    "Units",
    "get_mechanism",
    "load_mechanism",
    "mechanism_from_json",
    "mechanism_names",
    "mechanism_to_json",
    "register_mechanism",
    "save_mechanism",
]
