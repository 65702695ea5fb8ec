"""Estimates with their 95 % intervals."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy import stats

LEVEL = 0.95
RESAMPLES = 2000


@dataclass(frozen=True)
class Interval:
    """An estimate between the ends of its 95 % interval."""

    estimate: float
    low: float
    high: float


def wilson_interval(successes: int, trials: int) -> Interval:
    """Rate of success with Wilson's score interval (E. B. Wilson, 1927, J. Am. Stat. Assoc. 22)."""
    interval = stats.binomtest(successes, trials).proportion_ci(LEVEL, method="wilson")
    return Interval(successes / trials, float(interval.low), float(interval.high))


def percentile_interval(sample: Sequence[float], percentile: float) -> Interval:
    """Percentile of the sample with its bootstrap interval; equal samples give equal intervals.

    A sample of one value, or of equal values, has an interval of no width.
    """
    values = np.asarray(sample, dtype=np.float64)
    statistic = partial(np.percentile, q=percentile)
    estimate = float(statistic(values))
    if np.ptp(values) == 0.0:
        return Interval(estimate, estimate, estimate)
    generator = np.random.default_rng(0)
    found = stats.bootstrap(
        (values,), statistic, n_resamples=RESAMPLES, confidence_level=LEVEL, method="percentile", rng=generator
    )
    return Interval(estimate, float(found.confidence_interval.low), float(found.confidence_interval.high))
