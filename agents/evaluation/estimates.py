"""Estimates with their 95 % intervals."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from scipy import stats

from pcm_gym.arrays import Array

LEVEL = 0.95
RESAMPLES = 2000
# Of the values, when their middle half is taken.
_CUT_AT_EACH_END = 0.25


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
    return _resampled(estimate, [values], statistic)


def interquartile_mean(strata: Sequence[Sequence[float]]) -> Interval:
    """Mean of the middle half of all values, with its stratified bootstrap interval.

    As R. Agarwal et al. propose (*Deep reinforcement learning at the edge of the statistical precipice*, NeurIPS 2021):
    values are those of runs, a stratum has those of one task, and each stratum is resampled by itself. Equal values
    give equal intervals. The interval is nan where a stratum has one value only: nothing tells how far it varies.
    """
    estimate = float(stats.trim_mean(np.concatenate(strata), _CUT_AT_EACH_END))
    if min(map(len, strata)) < 2:
        return Interval(estimate, np.nan, np.nan)
    if all(np.ptp(values) == 0.0 for values in strata):
        return Interval(estimate, estimate, estimate)

    def statistic(*samples: Array, axis: int) -> Array:
        return np.asarray(stats.trim_mean(np.concatenate(samples, axis=axis), _CUT_AT_EACH_END, axis=axis))

    return _resampled(estimate, [np.asarray(values, dtype=np.float64) for values in strata], statistic)


def _resampled(estimate: float, samples: Sequence[Array], statistic: Callable[..., Any]) -> Interval:
    """An estimate with its bootstrap interval, the same each time; every sample is resampled by itself."""
    found = stats.bootstrap(
        samples,
        statistic,
        n_resamples=RESAMPLES,
        confidence_level=LEVEL,
        method="percentile",
        rng=np.random.default_rng(0),
    )
    return Interval(estimate, float(found.confidence_interval.low), float(found.confidence_interval.high))
