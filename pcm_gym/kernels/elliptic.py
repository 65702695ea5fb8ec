"""Jacobi's elliptic functions and epsilon function, together, in one Landen recursion.

Sources: DLMF 22.7(i) (descending Landen transformation of sn, cn, dn) and 22.10(ii) (expansion at k = 1); the steps of
the epsilon function are the integrals of those of dn^2. Symbols: modulus k, complementary modulus k_c with
k^2 + k_c^2 = 1, quarter period K.
"""

import math

from pcm_gym.kernels.compilation import kernel

# Below this modulus the expansion in k^2 is exact to rounding for the arguments of a rod.
_SMALL_MODULUS = 1e-5
# Below this value of k_c exp(u) the expansion at k = 1, of relative error (k_c exp(u))^4 / 256, is exact to rounding.
_HYPERBOLIC_LIMIT = 3e-4
# Keeps the quarter period ln(4 / k_c) finite.
_LEAST_COMPLEMENT = 1e-300


@kernel
def _jacobi_small_modulus(u: float, k: float) -> tuple[float, float, float, float, float]:
    sine, cosine = math.sin(u), math.cos(u)
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
    k_next = (k / (1.0 + k_c)) ** 2
    k_c_next = 2.0 * math.sqrt(k_c) / (1.0 + k_c)
    v = u / (1.0 + k_next)
    sn, cn, dn, deficit, quarter_period = _jacobi(v, k_next, k_c_next)
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
    if k_c * math.exp(u) < _HYPERBOLIC_LIMIT:
        return _jacobi_near_one(u, k_c)
    return _jacobi(u, k, k_c)


@kernel
def quarter_period(k_c: float) -> float:
    """Return K by the arithmetic-geometric mean of 1 and the complementary modulus; at k = 1 a large number."""
    mean, geometric = 1.0, max(k_c, _LEAST_COMPLEMENT)
    while mean - geometric > 1e-15 * mean:
        mean, geometric = 0.5 * (mean + geometric), math.sqrt(mean * geometric)
    return 0.5 * math.pi / mean
