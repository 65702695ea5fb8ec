"""Jacobi's elliptic functions and epsilon function, together, in one Landen recursion.

Sources: DLMF 22.7(i) (descending Landen transformation of sn, cn, dn) and 22.10(ii) (expansion at k = 1); the steps of
the epsilon function are the integrals of those of dn^2. Symbols: modulus k, complementary modulus k_c with
k^2 + k_c^2 = 1, quarter period K.
"""

import math

import numpy as np

from pcm_gym.kernels.numerics.compilation import formula, kernel

# Below this modulus the expansion in k^2 is exact to rounding for the arguments of a rod.
_SMALL_MODULUS = 1e-5
# Below this value of k_c exp(u) the expansion at k = 1, of relative error (k_c exp(u))^4 / 256, is exact to rounding.
HYPERBOLIC_LIMIT = 3e-4
# Keeps the quarter period ln(4 / k_c) finite.
_LEAST_COMPLEMENT = 1e-300


# From this complementary modulus on the six Landen steps of `jacobi_in_lanes` lead to a modulus below 1.3e-4, whose
# fourth power, the error of the expansion, is below rounding.
LEAST_LANE_COMPLEMENT = 1e-6

# pi / 2 in three parts, the first two with trailing zeros, so that small multiples of them are exact.
_HALF_PI = (1.5707963267341256, 6.077100506303966e-11, 2.0222662487959506e-21)
# Beyond this argument `sine_and_cosine` loses digits.
LARGEST_ANGLE = 1e5


@formula
def sine_and_cosine(angle: float) -> tuple[float, float]:
    """Return sine and cosine for |angle| <= 1e5 without branches, to about 1e-16 (Cody and Waite's reduction)."""
    quadrant = np.floor(angle * (2.0 / math.pi) + 0.5)
    part = ((angle - quadrant * _HALF_PI[0]) - quadrant * _HALF_PI[1]) - quadrant * _HALF_PI[2]
    z = part * part
    odd = -2.50507602534068634195e-8 + z * 1.58969099521155010221e-10
    odd = -1.98412698298579493134e-4 + z * (2.75573137070700676789e-6 + z * odd)
    sine = part + part * z * (-1.66666666666666324348e-1 + z * (8.33333333332248946124e-3 + z * odd))
    even = 2.08757232129817482790e-9 + z * -1.13596475577881948265e-11
    even = 2.48015872894767294178e-5 + z * (-2.75573143513906633035e-7 + z * even)
    cosine = 1.0 - 0.5 * z + z * z * (4.16666666666666019037e-2 + z * (-1.38888888888741095749e-3 + z * even))
    half = np.floor(0.5 * quadrant)
    is_odd = quadrant != 2.0 * half
    sign = 1.0 if half == 2.0 * np.floor(0.5 * half) else -1.0
    return sign * (cosine if is_odd else sine), sign * (-sine if is_odd else cosine)


@kernel
def _jacobi_small_modulus(u: float, k: float) -> tuple[float, float, float, float, float]:
    return _from_sine(u, k, math.sin(u), math.cos(u))


@formula
def _from_sine(u: float, k: float, sine: float, cosine: float) -> tuple[float, float, float, float, float]:
    quarter = 0.25 * k * k
    lag = quarter * (u - sine * cosine)
    dn = 1.0 - 2.0 * quarter * sine * sine
    return sine - lag * cosine, cosine + lag * sine, dn, 2.0 * lag, 0.5 * math.pi * (1.0 + quarter)


@kernel
def _jacobi_near_one(u: float, k_c: float) -> tuple[float, float, float, float, float]:
    sech, tanh = 1.0 / math.cosh(u), math.tanh(u)
    quarter = 0.25 * k_c * k_c
    product = tanh / (sech * sech)  # sinh cosh
    lag = quarter * (product - u)
    sn = tanh + lag * sech * sech
    cn = sech - lag * tanh * sech
    dn = sech + quarter * (product + u) * tanh * sech
    deficit = u - tanh - quarter * (2.0 * u - tanh - u * sech * sech)
    quarter_period = math.log(4.0 / max(k_c, _LEAST_COMPLEMENT))
    return sn, cn, dn, deficit, quarter_period + quarter * (quarter_period - 1.0)


@kernel
def _jacobi(u: float, k: float, k_c: float) -> tuple[float, float, float, float, float]:
    if k < _SMALL_MODULUS:
        return _jacobi_small_modulus(u, k)
    u_next, k_next, k_c_next = _descend(u, k, k_c)
    return _ascend(_jacobi(u_next, k_next, k_c_next), u_next, k_next, k_c)


@formula
def _descend(u: float, k: float, k_c: float) -> tuple[float, float, float]:
    """Return argument, modulus and complementary modulus one Landen step below."""
    inverse = 1.0 / (1.0 + k_c)
    root = k * inverse
    k_next = root * root
    return u / (1.0 + k_next), k_next, 2.0 * math.sqrt(k_c) * inverse


@formula
def _ascend(
    below: tuple[float, float, float, float, float], v: float, k_next: float, k_c: float
) -> tuple[float, float, float, float, float]:
    """Return the functions for k_c from those one Landen step below, at the argument v and the modulus k_next."""
    sn, cn, dn, deficit, quarter_period = below
    square = sn * sn
    scale = 1.0 / (1.0 + k_next * square)
    deficit = (1.0 + k_c) * (deficit + k_next * (v - sn * cn * dn * scale))
    # 1 - k sn^2 written without the cancellation that would spoil dn near k = 1
    dn_above = cn * cn + (2.0 * k_c / (1.0 + k_c)) * square
    return (1.0 + k_next) * sn * scale, cn * dn * scale, dn_above * scale, deficit, (1.0 + k_next) * quarter_period


@kernel
def jacobi(u: float, k: float, k_c: float) -> tuple[float, float, float, float, float]:
    """Return sn, cn, dn, u - E(u) and the quarter period K for the modulus k.

    Parameters
    ----------
    u : float
        Argument, u >= 0.
    k, k_c : float
        Modulus and complementary modulus, both in [0, 1], k^2 + k_c^2 = 1. Both are asked for because neither can be
        had from the other without loss near the two ends.

    Returns
    -------
    sn, cn, dn, deficit, quarter_period : float
        `deficit` is u - E(u), with E Jacobi's epsilon function; it keeps its digits as k -> 0. At k = 1 the quarter
        period, infinite, is replaced by a large number.
    """
    if k_c * math.exp(u) < HYPERBOLIC_LIMIT:
        return _jacobi_near_one(u, k_c)
    return _jacobi(u, k, k_c)


@formula
def jacobi_in_lanes(u: float, k: float, k_c: float) -> tuple[float, float, float, float, float]:
    """Return what `jacobi` returns, for k_c >= 1e-6, by a fixed number of Landen steps without branches."""
    u_1, k_1, k_c_1 = _descend(u, k, k_c)
    u_2, k_2, k_c_2 = _descend(u_1, k_1, k_c_1)
    u_3, k_3, k_c_3 = _descend(u_2, k_2, k_c_2)
    u_4, k_4, k_c_4 = _descend(u_3, k_3, k_c_3)
    u_5, k_5, k_c_5 = _descend(u_4, k_4, k_c_4)
    u_6, k_6, _ = _descend(u_5, k_5, k_c_5)
    sine, cosine = sine_and_cosine(u_6)
    found = _from_sine(u_6, k_6, sine, cosine)
    found = _ascend(found, u_6, k_6, k_c_5)
    found = _ascend(found, u_5, k_5, k_c_4)
    found = _ascend(found, u_4, k_4, k_c_3)
    found = _ascend(found, u_3, k_3, k_c_2)
    found = _ascend(found, u_2, k_2, k_c_1)
    return _ascend(found, u_1, k_1, k_c)


@kernel
def quarter_period(k_c: float) -> float:
    """Return K by the arithmetic-geometric mean of 1 and the complementary modulus; at k = 1 a large number."""
    mean, geometric = 1.0, max(k_c, _LEAST_COMPLEMENT)
    while mean - geometric > 1e-15 * mean:
        mean, geometric = 0.5 * (mean + geometric), math.sqrt(mean * geometric)
    return 0.5 * math.pi / mean
