"""Whether a policy comes to what its card says."""

from collections.abc import Mapping
from typing import Any

from agents.controllers.table import TRAINED
from agents.evaluation.comparison import Evaluation
from agents.evaluation.estimates import Interval
from agents.evaluation.tables import percent
from agents.learners.settings import ModelError


def reproduction(evaluation: Evaluation, card: Mapping[str, Any]) -> tuple[bool, str]:
    """Whether the safe success is within the interval that the card gives it, and a sentence that says so.

    Raises
    ------
    ModelError
        If the card has no results of the policy.
    """
    try:
        published = next(own for own in card["evaluation"]["summaries"] if own["policy"] == TRAINED)
        interval = Interval(**published["safe_success_rate"])
        found = next(own for own in evaluation.summaries if own.policy == TRAINED).safe_success_rate.estimate
        is_reproduced = interval.low <= found <= interval.high
    except (KeyError, StopIteration, TypeError) as error:
        raise ModelError(
            "the card has no results of the policy to compare with: evaluate it before its export"
        ) from error
    outcome = "is" if is_reproduced else "is not"
    return is_reproduced, f"Safe success of {100.0 * found:.1f} % {outcome} what the card says: {percent(interval)}."
