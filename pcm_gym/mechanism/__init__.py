"""Mechanisms as frozen, validated data, and the catalogue of named ones."""

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
