"""Mechanisms as text: JSON with every number in full."""

import json
from dataclasses import asdict
from typing import Any

from pcm_gym.mechanism.leg import Actuator, Leg, Prismatic, Revolute, Rod
from pcm_gym.mechanism.mechanism import Mechanism
from pcm_gym.mechanism.validation import shown

_ACTUATORS: dict[str, type[Actuator]] = {"revolute": Revolute, "prismatic": Prismatic}


def mechanism_to_json(mechanism: Mechanism) -> str:
    """Return the mechanism as JSON, from which `mechanism_from_json` makes an equal one."""
    content = asdict(mechanism)
    for leg, entry in zip(mechanism.legs, content["legs"], strict=True):
        entry["actuator"]["kind"] = type(leg.actuator).__name__.lower()
    return json.dumps(content)


def mechanism_from_json(text: str) -> Mechanism:
    """Return the mechanism of a JSON text.

    Raises
    ------
    ValueError
        If the text does not describe a mechanism.
    """
    try:
        content = json.loads(text)
        legs = tuple(_leg(entry) for entry in content.pop("legs"))
        reference = content.pop("reference", None)
        return Mechanism(legs=legs, reference=reference and Rod(**reference), **content)
    except (AttributeError, KeyError, RecursionError, TypeError, ValueError) as error:
        raise ValueError(f"the text does not describe a mechanism: {shown(error)}") from error


def _leg(entry: dict[str, Any]) -> Leg:
    actuator = dict(entry["actuator"])
    make = _ACTUATORS[actuator.pop("kind")]
    return Leg(make(**actuator), Rod(**entry["rod"]), tuple(entry["attachment"]))
