"""The margin is on the safe side, as `nearest_fold` judges; and the judgement counts what it says."""

import numpy as np
import pytest

import pcm_gym
from benchmarks.margins import Judged, judge_margins


@pytest.mark.parametrize("name", pcm_gym.mechanism_names())
def test_states_near_a_fold_are_not_called_safe(name: str) -> None:
    """At most one in a hundred at the environments' threshold, and at most a fifth of those outside is called so."""
    judged = judge_margins(name, 400, seed=1)
    own = judged.calls(judged.threshold)
    assert own.within + own.outside == 400
    assert own.within > 70
    assert own.missed_part <= 0.01
    assert own.false_part <= 0.2
    # what is said of other thresholds, from a third to three times that one: it gets safer, and more often wrong
    assert judged.calls(0.3 * judged.threshold).missed_part <= 0.03
    assert judged.calls(3.0 * judged.threshold).missed_part <= 0.01


def test_calls_are_counted() -> None:
    judged = Judged("any", 0.1, np.array([0.05, 0.2, 0.05, 0.3]), np.array([0.08, 0.09, 0.3, np.inf]))
    calls = judged.calls(0.1)
    assert (calls.within, calls.missed, calls.outside, calls.false_alarms) == (2, 1, 2, 1)
    assert (calls.missed_part, calls.false_part, calls.false_part_of_alarms) == (0.5, 0.5, 0.5)
    np.testing.assert_allclose(judged.ratios()[1], 0.625)
