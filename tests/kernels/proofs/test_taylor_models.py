"""Taylor models: every operation encloses the true result, computed in multiple precision."""

import math

import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mpmath import mp, mpf

from pcm_gym.kernels.proofs import taylor_models as tm
from pcm_gym.kernels.proofs.taylor_models import Model

# Powers of s and t that belong to the fields of a model.
POWERS = [(0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2), (3, 0), (2, 1), (1, 2), (0, 3)]

coefficients = st.floats(-10.0, 10.0) | st.floats(-1e-12, 1e-12)
places = st.floats(-1.0, 1.0)
parts = st.floats(-1.0, 1.0)


@st.composite
def models(draw: st.DrawFn) -> Model:
    remainder = draw(st.sampled_from([0.0, 1e-16, 1e-6, 0.3]))
    return Model._make([*(draw(coefficients) for _ in POWERS), remainder])


def polynomial(a: Model, s: float, t: float) -> mpf:
    return mpmath.fsum(mpf(c) * mpf(s) ** i * mpf(t) ** j for c, (i, j) in zip(a[:10], POWERS, strict=True))


def check(result: Model, truth: mpf, s: float, t: float) -> None:
    assert abs(polynomial(result, s, t) - truth) <= result.remainder


@given(models(), models(), parts, parts, places, places)
def test_sums_and_products_enclose(a: Model, b: Model, part_a: float, part_b: float, s: float, t: float) -> None:
    with mp.workdps(60):
        # members of both models: what they do not know is anything within their remainders
        x = polynomial(a, s, t) + mpf(part_a) * mpf(a.remainder)
        y = polynomial(b, s, t) + mpf(part_b) * mpf(b.remainder)
        check(tm.add(a, b), x + y, s, t)
        check(tm.subtract(a, b), x - y, s, t)
        check(tm.multiply(a, b), x * y, s, t)
        check(tm.scale(0.1, a), mpf(0.1) * x, s, t)
        check(tm.shift(a, 0.1), x + mpf(0.1), s, t)
        for center, half_width in (tm.bounds(a), (a.center, tm.radius(a))):
            assert abs(x - mpf(center)) <= half_width
        center, along, across, remainder = tm.affine(a)
        assert abs(x - mpf(center) - mpf(along) * s - mpf(across) * t) <= remainder


@given(models(), st.floats(1.05, 100.0), parts, places, places)
def test_reciprocals_enclose(a: Model, ratio: float, part: float, s: float, t: float) -> None:
    """The function's values are from 1 - 1 / ratio to 1 + 1 / ratio times the centre."""
    a = a._replace(center=math.copysign(ratio * max(tm.radius(a), 1e-3), a.center))
    with mp.workdps(60):
        check(tm.reciprocal(a), 1 / (polynomial(a, s, t) + mpf(part) * mpf(a.remainder)), s, t)


def test_the_reciprocal_of_what_may_vanish_is_unknown() -> None:
    a = tm.constant(1.0)._replace(s=1.0)
    assert not tm.reciprocal(a).remainder < math.inf


@given(st.floats(-4.0, 4.0) | st.floats(-1e-9, 1e-9), st.floats(0.0, 2.0) | st.floats(0.0, 1e-9), places)
def test_cosine_and_sine_enclose(angle: float, half_width: float, t: float) -> None:
    with mp.workdps(60):
        true_angle = mpf(angle) + mpf(t) * mpf(half_width)
        cosine, sine = tm.cosine_and_sine(tm.along_t(angle, half_width, 0.0))
        check(cosine, mpmath.cos(true_angle), 0.0, t)
        check(sine, mpmath.sin(true_angle), 0.0, t)


@given(models(), parts, places, places)
def test_cosine_and_sine_of_models_enclose(a: Model, part: float, s: float, t: float) -> None:
    with mp.workdps(60):
        true_angle = polynomial(a, s, t) + mpf(part) * mpf(a.remainder)
        cosine, sine = tm.cosine_and_sine(a)
        check(cosine, mpmath.cos(true_angle), s, t)
        check(sine, mpmath.sin(true_angle), s, t)


@pytest.mark.parametrize("width", [0.2, 0.02])
def test_remainders_are_of_fourth_order(width: float) -> None:
    def remainder(width: float) -> float:
        cosine, sine = tm.cosine_and_sine(tm.along_s(0.7, width, 0.0))
        return tm.multiply(tm.reciprocal(cosine), sine).remainder

    assert math.log2(remainder(width) / remainder(width / 2.0)) == pytest.approx(4.0, abs=0.5)


def test_an_exact_result_has_a_remainder_of_rounding() -> None:
    third = tm.reciprocal(tm.constant(3.0))
    assert third.remainder < 1e-14
    np.testing.assert_allclose(third.center, 1.0 / 3.0, rtol=1e-15)
