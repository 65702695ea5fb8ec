"""What both ends of a step tell of the determinant in between, for determinants that are known all along it."""

import numpy as np
import pytest
from numpy.polynomial import Polynomial

from pcm_gym.kernels.branches.smoothness import End, growth, is_clear

# A determinant over a step, from 0 to 1: how it begins and ends, with a zero in between or with none.
VANISHING = {
    "between like ends": Polynomial([0.25 + 1e-3, -1.0, 1.0]) - 2e-3,
    "a dip that just does not vanish": Polynomial([0.25 + 1e-3, -1.0, 1.0]),
    "beside the start": Polynomial([-3e-6, 1e-3, 2e-2]) * -1.0,
    "just after the start": Polynomial([1e-4, -1e-2, 5e-1]),
    "just before the end": Polynomial([0.5, -1.0, 0.5 + 1e-5]),
}
CLEAR = {
    "constant": Polynomial([0.3]),
    "growing threefold": Polynomial([0.1, 0.1, 0.1]),
    "falling to a quarter": Polynomial([0.4, -0.5, 0.2]),
    "negative": Polynomial([-0.1, -0.1]),
    "leaving a singular state": Polynomial([1e-12, 0.1, 0.1]),
    "leaving it on the other side, for rounding": Polynomial([-1e-12, 0.1, 0.1]),
}


def ends(determinant: Polynomial) -> tuple[End, End]:
    rate = determinant.deriv()
    here, there = (End(float(determinant(at)), float(rate(at))) for at in (0.0, 1.0))
    return here, there


@pytest.mark.parametrize("determinant", VANISHING.values(), ids=VANISHING)
def test_a_step_in_which_the_determinant_vanishes_is_refused(determinant: Polynomial) -> None:
    """Forwards and backwards, and whichever sign it has."""
    for way in (determinant, determinant(Polynomial([1.0, -1.0]))):
        for sign in (1.0, -1.0):
            assert not is_clear(*ends(sign * way), 1.0)


@pytest.mark.parametrize("determinant", CLEAR.values(), ids=CLEAR)
def test_a_step_in_which_it_stays_is_taken(determinant: Polynomial) -> None:
    assert is_clear(*ends(determinant), 1.0)


def test_what_lies_beyond_the_part_of_a_step_that_is_gone_does_not_count() -> None:
    here, there = ends(2.0 * Polynomial([-0.7, 1.0]) ** 2 + 0.02)
    assert is_clear(here, there, 0.25)
    assert not is_clear(here, there, 1.0)


def test_the_next_step_has_the_defect_that_is_wanted_where_it_grows_with_the_square() -> None:
    step, curvature = 1.0, 3.0
    for _ in range(5):
        step *= growth(curvature * step**2)
    np.testing.assert_allclose(curvature * step**2, 0.7, rtol=1e-12)
    assert growth(np.nan) < 1.0
    assert growth(np.inf) < 1.0
