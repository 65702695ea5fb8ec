"""The table of references. A new one is a file in this folder and a line here."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from pcm_gym.mechanism.validation import one_of
from pcm_gym.references.controller import Controller
from pcm_gym.references.planner import PlannerController
from pcm_gym.references.predictive import PredictiveController
from pcm_gym.references.random import RandomController
from pcm_gym.references.resolved_rate import ResolvedRateController
from pcm_gym.references.shielded import ShieldedController
from pcm_gym.references.standing_still import StandingStill


@dataclass(frozen=True)
class Reference:
    """A controller that can be chosen by name.

    Attributes
    ----------
    make : callable
        Makes it; one for each batch.
    remark : str
        What a reader of results must know of it.
    """

    make: Callable[[], Controller]
    remark: str


REFERENCES: Mapping[str, Reference] = {
    "standing still": Reference(StandingStill, "Never acts."),
    "random": Reference(RandomController, "Acts at random."),
    "resolved rate": Reference(
        ResolvedRateController,
        "Heads straight for the goal through the exact Jacobian, damped, and knows nothing of stability.",
    ),
    "shielded resolved rate": Reference(
        lambda: ShieldedController(ResolvedRateController()), "The same, behind the solver's shield."
    ),
    "predictive": Reference(
        PredictiveController, "Tries some dozens of short plans on the exact model in each step, drawn at random."
    ),
    "nominal planner": Reference(
        lambda: PlannerController(knows_truth=False),
        "Plans on the nominal mechanism and load, and follows the plan on the true ones.",
    ),
    "planner": Reference(PlannerController, "Plans on the true mechanism and load: what can be reached at all."),
}


def new_reference(name: str) -> Controller:
    """Return a new controller of that name in `REFERENCES`."""
    return REFERENCES[one_of("name", name, tuple(REFERENCES))].make()
