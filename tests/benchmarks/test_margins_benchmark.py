"""The judgement of margins counts what it says."""

import numpy as np

from benchmarks.margins import Judged


def test_calls_are_counted() -> None:
    judged = Judged("any", 0.1, np.array([0.05, 0.2, 0.05, 0.3]), np.array([0.08, 0.09, 0.3, np.inf]))
    calls = judged.calls(0.1)
    assert (calls.within, calls.missed, calls.outside, calls.false_alarms) == (2, 1, 2, 1)
    assert (calls.missed_part, calls.false_part, calls.false_part_of_alarms) == (0.5, 0.5, 0.5)
    np.testing.assert_allclose(judged.ratios()[1], 0.625)
