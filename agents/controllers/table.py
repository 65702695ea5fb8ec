"""The table of controllers. A new one is a file in this folder and a line here."""

from dataclasses import dataclass
from pkgutil import resolve_name
from typing import TYPE_CHECKING

if TYPE_CHECKING:  # they load numba and torch, which the table does without
    from agents.controllers.controller import Controller
    from agents.learners.policy import LearntPolicy


@dataclass(frozen=True)
class Entry:
    """A controller that can be chosen by name.

    Attributes
    ----------
    path
        Where its class is, ``package.module:name``; imported when it is needed.
    needs_policy
        Whether it is made with the policy that has been learnt; else it is made without arguments.
    remark
        What a reader of results must know of it.
    """

    path: str
    needs_policy: bool = False
    remark: str = ""


CONTROLLERS: dict[str, Entry] = {
    "trained": Entry("agents.controllers.trained:TrainedController", needs_policy=True),
    "random": Entry("agents.controllers.random:RandomController"),
    "resolved rate": Entry(
        "agents.controllers.resolved_rate:ResolvedRateController",
        remark="The resolved-rate controller heads straight for the goal through the exact Jacobian and knows nothing "
        "of stability.",
    ),
}


def new_controller(name: str, policy: "LearntPolicy") -> "Controller":
    """Controller of that name in `CONTROLLERS`."""
    entry = CONTROLLERS[name]
    make = resolve_name(entry.path)
    controller: Controller = make(policy) if entry.needs_policy else make()
    return controller
