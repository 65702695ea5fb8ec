"""Jacobi's functions against mpmath in 50 digits, on a dense grid with both ends of the modulus included."""

import math

import mpmath
import numpy as np
import pytest
from mpmath import mp, mpf

from pcm_gym.kernels.rods.elliptic import jacobi
from tests.reference.precise_rod import jacobi as precise_jacobi

DIGITS = 50
# rho = 12 is the largest load in the project; a few beyond, and beyond many quarter periods.
ARGUMENTS = [0.0, 1e-9, 1e-3, 0.1, 0.5, 1.0, 1.5707, 2.0, 2.9, 3.7, 4.6, 5.5, 6.3, 7.4, 8.6, 9.9, 11.0, 12.0, 16.0]
SMALL_MODULI = [
    0.0,
    1e-300,
    1e-30,
    1e-9,
    0.999e-5,
    1e-5,
    1.001e-5,
    1e-4,
    1e-3,
    1e-2,
    0.05,
    0.1,
    0.2,
    0.3,
    0.45,
    0.6,
    0.7,
]
SMALL_COMPLEMENTS = [1e-300, 1e-150, 1e-40, 1e-20, 1e-14, 1e-11, 1e-9, 1e-8, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 0.05]
SMALL_COMPLEMENTS += [0.1, 0.2, 0.3, 0.45, 0.6, 0.7]
# The larger of k and k_c is rounded to a double, which alone moves sn, cn, dn at u <= 16 by some 1e-15.
TOLERANCE = 1e-14


def moduli_by(small: float, *, is_complement: bool) -> tuple[float, float]:
    """Return the doubles (k, k_c), one of them given."""
    other = math.sqrt((1.0 - small) * (1.0 + small))
    return (other, small) if is_complement else (small, other)


MODULI = [moduli_by(k, is_complement=False) for k in SMALL_MODULI]
MODULI += [moduli_by(k_c, is_complement=True) for k_c in SMALL_COMPLEMENTS]
# the switch to the expansion at k = 1: k_c exp(u) = 3e-4
SWITCHES = [
    (u, *moduli_by(factor * 3e-4 * math.exp(-u), is_complement=True))
    for u in (0.1, 1.0, 4.0, 12.0)
    for factor in (0.999, 1.001)
]
GRID = [(u, k, k_c) for k, k_c in MODULI for u in ARGUMENTS] + SWITCHES


def precise(u: float, k: float, k_c: float) -> list[float]:
    """Return sn, cn, dn, u - E, K, where the smaller of k and k_c is taken as exact."""
    with mp.workdps(DIGITS):
        if k < k_c:
            m, m1 = mpf(k) ** 2, 1 - mpf(k) ** 2
        else:
            m, m1 = 1 - mpf(k_c) ** 2, mpf(k_c) ** 2
        sn, cn, dn, epsilon, quarter_period = precise_jacobi(mpf(u), m, m1)
        if m == 0:
            epsilon = mpf(u)
        return [float(sn), float(cn), float(dn), float(u - epsilon), float(quarter_period)]


@pytest.fixture(scope="module")
def values() -> tuple[np.ndarray, np.ndarray]:
    return np.array([jacobi(*point) for point in GRID]), np.array([precise(*point) for point in GRID])


@pytest.mark.parametrize(("column", "name"), [(0, "sn"), (1, "cn"), (2, "dn")])
def test_functions_agree_with_mpmath(values: tuple[np.ndarray, np.ndarray], column: int, name: str) -> None:
    found, reference = values
    worst = int(np.argmax(np.abs(found - reference)[:, column]))
    assert abs(found - reference)[worst, column] <= TOLERANCE, f"{name} at u, k, k_c = {GRID[worst]}"


def test_dn_keeps_its_digits_where_it_is_small(values: tuple[np.ndarray, np.ndarray]) -> None:
    """Poses divide by dn, which falls to k_c: an absolute error would not do."""
    found, reference = values
    error = np.abs(found[:, 2] / reference[:, 2] - 1.0)
    worst = int(np.argmax(error))
    assert error[worst] <= 5e-14, f"dn at u, k, k_c = {GRID[worst]}"


def test_deficit_keeps_its_digits_as_the_modulus_vanishes(values: tuple[np.ndarray, np.ndarray]) -> None:
    """u - E(u) is of the order of k^2 u, and so is its error; the reference knows that down to k = 1e-9."""
    found, reference = values
    u, k, _ = np.array(GRID).T
    known = (k >= 1e-9) & (u > 0.0)
    # below k = 1e-5 the kernel stops at the first term: k^2 relative to it, 1e-20 in all
    truncation = np.where(k < 1e-5, k**2, 0.0)
    error = (np.abs(found - reference)[:, 3] / (k**2 * u + 1e-300) - truncation)[known]
    worst = int(np.argmax(error))
    assert error[worst] <= 5e-15, f"u - E at u, k, k_c = {np.array(GRID)[known][worst]}"
    assert np.all(np.abs(found[~known, 3]) <= 1e-58)


def test_quarter_period_agrees_with_mpmath(values: tuple[np.ndarray, np.ndarray]) -> None:
    found, reference = values
    error = np.abs(found[:, 4] / reference[:, 4] - 1.0)
    worst = int(np.argmax(error))
    assert error[worst] <= 1e-14, f"K at u, k, k_c = {GRID[worst]}"


@pytest.mark.parametrize("u", [0.0, 1e-3, 1.0, 5.0, 12.0, 30.0])
def test_modulus_one_gives_hyperbolic_functions(u: float) -> None:
    sn, cn, dn, deficit, quarter_period = jacobi(u, 1.0, 0.0)
    with mp.workdps(DIGITS):
        expected = [mpmath.tanh(u), mpmath.sech(u), mpmath.sech(u), u - mpmath.tanh(u)]
    np.testing.assert_allclose([sn, cn, dn, deficit], [float(value) for value in expected], rtol=1e-15, atol=1e-16)
    assert 600.0 < quarter_period < math.inf


def test_quarter_period_marks_the_zeros_of_cn() -> None:
    """An identity that no reference is needed for: cn(K) = 0, sn(K) = 1, dn(K) = k_c, at every modulus."""
    for k, k_c in MODULI:
        if k_c < 1e-7:  # K > 17, beyond the loads of a rod
            continue
        *_, quarter_period = jacobi(0.0, k, k_c)
        sn, cn, dn, _, _ = jacobi(quarter_period, k, k_c)
        # the derivative of cn at K is -k_c, that of K by rounding is K eps
        np.testing.assert_allclose([sn, cn, dn], [1.0, 0.0, k_c], atol=3e-15, rtol=0.0, err_msg=f"k, k_c = {k, k_c}")
