"""Intervals agree with published values and behave at the edges."""

import numpy as np
import pytest

from agents.evaluation.estimates import percentile_interval, wilson_interval


@pytest.mark.parametrize(
    ("successes", "trials", "low", "high"),
    [
        # R. G. Newcombe, 1998, Stat. Med. 17, Table I, method 3.
        (81, 263, 0.2553, 0.3662),
        (15, 148, 0.0624, 0.1605),
        (0, 20, 0.0000, 0.1611),
        (1, 29, 0.0061, 0.1718),
    ],
)
def test_wilson_interval_is_the_published_one(successes: int, trials: int, low: float, high: float) -> None:
    interval = wilson_interval(successes, trials)
    assert interval.estimate == successes / trials
    assert (interval.low, interval.high) == pytest.approx((low, high), abs=5e-5)


def test_wilson_interval_stays_within_zero_and_one() -> None:
    assert wilson_interval(0, 5).low == 0.0
    assert wilson_interval(5, 5).high == 1.0


def test_bootstrap_interval_of_a_median_covers_it_and_narrows() -> None:
    generator = np.random.default_rng(3)
    few, many = generator.normal(size=50), generator.normal(size=5000)
    widths = []
    for sample in (few, many):
        interval = percentile_interval(sample.tolist(), 50)
        assert interval.low <= interval.estimate <= interval.high
        widths.append(interval.high - interval.low)
    assert widths[0] / widths[1] == pytest.approx(10.0, rel=0.5), "the width falls with the root of the sample's size"


def test_bootstrap_interval_is_reproducible() -> None:
    sample = [1.0, 2.0, 5.0, 9.0]
    assert percentile_interval(sample, 95) == percentile_interval(sample, 95)


@pytest.mark.parametrize("sample", [[2.5], [2.5, 2.5, 2.5]])
def test_equal_values_have_no_width(sample: list[float]) -> None:
    interval = percentile_interval(sample, 50)
    assert (interval.low, interval.estimate, interval.high) == (2.5, 2.5, 2.5)
