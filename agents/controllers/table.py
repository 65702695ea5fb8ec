"""The table of controllers: what has learnt, and the references. A new reference is a line in `pcm_gym.references`."""

from collections.abc import Mapping
from functools import cache
from typing import TYPE_CHECKING

if TYPE_CHECKING:  # they load numba and torch, which a look at the help does without
    from agents.learners.exported import ActingPolicy
    from pcm_gym.references import Controller

TRAINED = "trained"


@cache
def remarks() -> Mapping[str, str]:
    """What a reader of results must know of each controller, by its name: of all there are."""
    from pcm_gym.references import REFERENCES

    return {TRAINED: "", **{name: reference.remark for name, reference in REFERENCES.items()}}


def new_controller(name: str, policy: "ActingPolicy") -> "Controller":
    """Controller of that name in `remarks`."""
    if name == TRAINED:
        from agents.controllers.trained import TrainedController

        return TrainedController(policy)
    from pcm_gym.references import new_reference

    return new_reference(name)
