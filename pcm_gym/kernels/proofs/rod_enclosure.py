"""Rigorous enclosures of one rod over boxes of its load, in the polar chart (rho, b) of `rod`.

Over the box rho = rho_c + s rho_h, b = b_c + t b_h every quantity is a Taylor model in (s, t), see `taylor_models`. The
elliptic functions at u = rho come from their power series at u / 2^n by n doublings, all in m = cos^2(b/2) and
m1 = sin^2(b/2), with positive sums wherever digits could be lost. So the enclosures hold and stay tight at b = 0
(k = 1, straight tension) and b = pi (k = 0), on either side of both, and at rho = 0. Doubling formulas: DLMF 22.6(ii)
and 22.16.27, rewritten. Symbols as in `rod`; C(u) is the integral of cn^2, C = (E - m1 u) / m.
"""

import math
from fractions import Fraction
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pcm_gym.kernels.numerics.compilation import kernel
from pcm_gym.kernels.proofs.taylor_models import (
    Model,
    add,
    along_s,
    along_t,
    constant,
    cosine_and_sine,
    exact,
    multiply,
    radius,
    reciprocal,
    scale,
    shift,
    subtract,
    widen,
)

# The power series are used up to this argument, with so many terms.
_SERIES_ARGUMENT = 0.05
_TERMS = 5
# Up to this sn^2 it is doubled itself, with all its digits.
_LARGEST_SQUARE = 0.5


def _maclaurin_coefficients(terms: int) -> NDArray[np.float64]:
    """Return the coefficients of cn, dn, sn / v and C / v, [function, power of v^2, power of m].

    They follow from sn' = cn dn, cn' = -sn dn, dn' = -m sn cn and C' = cn^2, with polynomials in m.
    """
    Polynomial = list[Fraction]

    def product(first: list[Polynomial], second: list[Polynomial], n: int) -> Polynomial:
        """Coefficient n of the product of two series."""
        total = [Fraction(0)] * (terms + 1)
        for k in range(n + 1):
            for i, a in enumerate(first[k]):
                for j, b in enumerate(second[n - k]):
                    if a and b:
                        total[i + j] += a * b
        return total

    zero = [Fraction(0)] * terms
    one = [Fraction(1), *zero]
    cn, sn, dn, integral = [one], [], [one], []
    for n in range(terms):
        sn.append([a / (2 * n + 1) for a in product(cn, dn, n)])
        integral.append([a / (2 * n + 1) for a in product(cn, cn, n)])
        cn.append([-a / (2 * n + 2) for a in product(sn, dn, n)])
        dn.append([Fraction(0), *(-a / (2 * n + 2) for a in product(sn, cn, n)[:-1])])
    return np.array([[[float(a) for a in row] for row in series[:terms]] for series in (cn, dn, sn, integral)])


_COEFFICIENTS = _maclaurin_coefficients(_TERMS)


class Elliptic(NamedTuple):
    """Models of what all that a rod does is made of."""

    rho: Model
    m: Model
    sin_b: Model
    cn: Model
    dn: Model
    sn_u: Model  # sn / u
    mean: Model  # C / u


class RodEnclosure(NamedTuple):
    """Tip and tip force in the clamp's frame."""

    tip_x: Model
    tip_y: Model
    force_x: Model
    force_y: Model


@kernel
def _series(function: int, w: Model, powers: tuple[Model, ...]) -> Model:
    """Return cn, dn, sn / v or C / v at a small v by its power series in w = v^2; `powers` are those of m.

    The coefficients are polynomials in m with terms of one sign, so they are at most those at m = 1, and these at most
    those of sec v: 2 (2 / pi)^(2 k + 1). That bounds the tail.
    """
    total = constant(0.0)
    for n in range(_TERMS - 1, -1, -1):
        coefficient = scale(_COEFFICIENTS[function, n, 0], constant(1.0))
        for j in range(1, n + 1):
            coefficient = add(coefficient, scale(_COEFFICIENTS[function, n, j], powers[j - 1]))
        total = add(multiply(total, w), coefficient)
    ratio = _SERIES_ARGUMENT * _SERIES_ARGUMENT * 0.4053  # 4 / pi^2 < 0.4053
    return widen(total, 1.28 * ratio**_TERMS / (1.0 - ratio))


@kernel
def enclose_elliptic(load: Model, b: Model) -> Elliptic:
    """Return models of the elliptic functions at the loads rho = `load` >= 0 and b."""
    kappa, kappa_c = cosine_and_sine(scale(0.5, b))
    m, m1, sin_b = multiply(kappa, kappa), multiply(kappa_c, kappa_c), scale(2.0, multiply(kappa, kappa_c))
    doublings, part = 0, 1.0
    while (load.center + radius(load)) * part > 0.999 * _SERIES_ARGUMENT:
        doublings += 1
        part *= 0.5
    v = scale(part, load)
    w = multiply(v, v)
    m_2 = multiply(m, m)
    powers = (m, m_2, multiply(m_2, m), multiply(m_2, m_2))
    cn, dn, sn_u, mean = _series(0, w, powers), _series(1, w, powers), _series(2, w, powers), _series(3, w, powers)
    for _ in range(doublings):
        argument_square = multiply(w, multiply(sn_u, sn_u))
        if argument_square.center + radius(argument_square) < _LARGEST_SQUARE:
            cn_above, dn_above, inverse = _double_small(m, argument_square)
        else:
            cn_above, dn_above, inverse = _double(m, m1, cn)
        sn_u = multiply(sn_u, multiply(cn, multiply(dn, inverse)))
        mean = subtract(mean, multiply(argument_square, sn_u))
        cn, dn, w = cn_above, dn_above, scale(4.0, w)
    return Elliptic(load, m, sin_b, cn, dn, sn_u, mean)


@kernel
def _double_small(m: Model, square: Model) -> tuple[Model, Model, Model]:
    """Return cn and dn at twice the argument, and 1 / (1 - m sn^4), from sn^2.

    What is not known of m counts for little where sn is small, and an error of sn^2 grows no faster than sn^2 itself.
    """
    m_square = multiply(m, square)
    m_quartic = multiply(m_square, square)
    inverse = reciprocal(shift(scale(-1.0, m_quartic), 1.0))
    rest = shift(m_quartic, 1.0)
    cn_above = multiply(subtract(rest, scale(2.0, square)), inverse)
    dn_above = multiply(subtract(rest, scale(2.0, m_square)), inverse)
    return cn_above, dn_above, inverse


@kernel
def _double(m: Model, m1: Model, cn: Model) -> tuple[Model, Model, Model]:
    """Return cn and dn at twice the argument, and 1 / (1 - m sn^4).

    With c = cn^2 and D = 1 - m sn^4, d cn(2u) / dc = 2 dn(2u) / D and d dn(2u) / dc = 2 m cn(2u) / D. These carry the
    remainder of c over; multiplied through the formulas, in which c comes more than once, it would grow much faster.
    """
    square = multiply(cn, cn)
    error = square.remainder
    c = exact(square)
    m_c = multiply(m, c)
    m_c_2 = multiply(m_c, c)
    # D = m1 + m c (2 - c), and so on: no difference that loses digits
    denominator = add(m1, subtract(scale(2.0, m_c), m_c_2))
    inverse = reciprocal(denominator)
    cn_above = multiply(add(m_c_2, multiply(m1, shift(scale(2.0, c), -1.0))), inverse)
    dn_above = multiply(add(m1, m_c_2), inverse)
    # c may be wrong by `error`, and D by 3 times that, being at most 1; then both derivatives are bounded together
    least = denominator.center - radius(denominator) - 3.0 * error
    largest_inverse = 1.0 / least if least > 0.0 else math.inf
    rate = 2.0 * largest_inverse * error
    growth = 1.0 / (1.0 - rate * rate) if rate < 0.9 else math.inf
    cn_size, dn_size = abs(cn_above.center) + radius(cn_above), abs(dn_above.center) + radius(dn_above)
    return (
        widen(cn_above, rate * (dn_size + rate * cn_size) * growth),
        widen(dn_above, rate * (cn_size + rate * dn_size) * growth),
        widen(inverse, 1.5 * rate * largest_inverse),
    )


@kernel
def enclose_rod(rho: float, rho_half_width: float, b: float, b_half_width: float) -> RodEnclosure:
    """Return tip and tip force of the unit rod over a box of loads, in the clamp's frame; about 3 microseconds."""
    return enclose_rod_at(along_s(rho, rho_half_width, 0.0), along_t(b, b_half_width, 0.0))


@kernel
def enclose_rod_at(rho: Model, b: Model) -> RodEnclosure:
    """Return tip and tip force of the unit rod at the loads of two models, in the clamp's frame."""
    return _enclose_rod(enclose_elliptic(rho, b))[0]


@kernel
def _enclose_rod(e: Elliptic) -> tuple[RodEnclosure, Model, Model, Model, Model, Model]:
    """Return tip and force, and of what they are made: cos and sin of beta0, X, Y over the length, and nd."""
    nd = reciprocal(e.dn)
    cd = multiply(e.cn, nd)
    cos_0 = shift(scale(2.0, multiply(e.m, multiply(cd, cd))), -1.0)
    sin_0 = multiply(e.sin_b, multiply(cd, nd))
    across = multiply(e.sin_b, multiply(e.sn_u, nd))
    along = shift(scale(2.0, multiply(e.m, shift(subtract(multiply(e.sn_u, cd), e.mean), 1.0))), -1.0)
    load = multiply(e.rho, e.rho)
    enclosure = RodEnclosure(
        add(multiply(along, cos_0), multiply(across, sin_0)),
        subtract(multiply(across, cos_0), multiply(along, sin_0)),
        multiply(load, cos_0),
        scale(-1.0, multiply(load, sin_0)),
    )
    return enclosure, cos_0, sin_0, along, across, nd


class _Rates(NamedTuple):
    """Derivatives of X and Y over the length, and of beta0."""

    along_rho: Model
    across_rho: Model
    along_b: Model
    across_b: Model
    beta_u: Model
    eta: Model


@kernel
def _enclose_rates(e: Elliptic, cos_0: Model, sin_0: Model, along: Model, across: Model, nd: Model) -> _Rates:
    inverse, sn = reciprocal(e.rho), multiply(e.rho, e.sn_u)
    cd, m_c = multiply(e.cn, nd), multiply(e.m, e.mean)
    eta = add(e.cn, multiply(multiply(multiply(sn, nd), e.rho), m_c))
    # d Y / d b, as d eta / d u over rho
    bend = multiply(multiply(m_c, cd), nd)
    across_b = add(
        subtract(bend, multiply(e.sn_u, e.dn)), multiply(multiply(e.m, e.sn_u), multiply(nd, multiply(e.cn, e.cn)))
    )
    return _Rates(
        multiply(subtract(cos_0, along), inverse),
        multiply(subtract(sin_0, across), inverse),
        scale(-0.5, add(multiply(across, eta), e.sin_b)),
        across_b,
        multiply(e.rho, across),
        eta,
    )


@kernel
def enclose_rod_derivatives(load: Model, b: Model) -> tuple[RodEnclosure, RodEnclosure, RodEnclosure]:
    """Return tip and tip force of the unit rod at the loads rho = `load` > 0 and b, and their derivatives by these."""
    e = enclose_elliptic(load, b)
    rod, cos_0, sin_0, along, across, nd = _enclose_rod(e)
    rates = _enclose_rates(e, cos_0, sin_0, along, across, nd)
    beta_u, eta = rates.beta_u, rates.eta
    by_rho = _turn(rates.along_rho, rates.across_rho, cos_0, sin_0, rod, beta_u)
    by_b = _turn(rates.along_b, rates.across_b, cos_0, sin_0, rod, eta)
    double = scale(2.0, e.rho)
    return (
        rod,
        RodEnclosure(
            by_rho[0],
            by_rho[1],
            add(multiply(double, cos_0), multiply(rod.force_y, beta_u)),
            subtract(scale(-1.0, multiply(double, sin_0)), multiply(rod.force_x, beta_u)),
        ),
        RodEnclosure(by_b[0], by_b[1], multiply(rod.force_y, eta), scale(-1.0, multiply(rod.force_x, eta))),
    )


class Turnable(NamedTuple):
    """What a rod does whatever the direction of its clamp: p the tip from the clamp, f the tip force."""

    dot: Model  # p . f
    cross: Model  # p x f
    square: Model  # |p|^2


@kernel
def enclose_turnable(load: Model, b: Model) -> Turnable:
    """Return p . f, p x f and |p|^2 of the unit rod at the loads of two models."""
    e = enclose_elliptic(load, b)
    _, _, _, along, across, _ = _enclose_rod(e)
    square = multiply(e.rho, e.rho)
    return Turnable(
        multiply(square, along),
        scale(-1.0, multiply(square, across)),
        add(multiply(along, along), multiply(across, across)),
    )


@kernel
def enclose_turnable_derivatives(load: Model, b: Model) -> tuple[Turnable, Turnable]:
    """Return the derivatives of p . f, p x f and |p|^2 of the unit rod by rho = `load` > 0 and by b."""
    e = enclose_elliptic(load, b)
    _, cos_0, sin_0, along, across, nd = _enclose_rod(e)
    rates = _enclose_rates(e, cos_0, sin_0, along, across, nd)
    square = multiply(e.rho, e.rho)
    return (
        Turnable(
            multiply(e.rho, add(along, cos_0)),
            scale(-1.0, multiply(e.rho, add(across, sin_0))),
            scale(2.0, add(multiply(along, rates.along_rho), multiply(across, rates.across_rho))),
        ),
        Turnable(
            multiply(square, rates.along_b),
            scale(-1.0, multiply(square, rates.across_b)),
            scale(2.0, add(multiply(along, rates.along_b), multiply(across, rates.across_b))),
        ),
    )


@kernel
def _turn(
    along: Model, across: Model, cos_0: Model, sin_0: Model, rod: RodEnclosure, beta: Model
) -> tuple[Model, Model]:
    """Return the derivative of the tip in the clamp's frame from that along and across the force and that of beta0."""
    return (
        add(add(multiply(along, cos_0), multiply(across, sin_0)), multiply(rod.tip_y, beta)),
        subtract(subtract(multiply(across, cos_0), multiply(along, sin_0)), multiply(rod.tip_x, beta)),
    )


class SlightlyLoaded(NamedTuple):
    """Derivatives of a rod by its load g, for all |g| <= G: those of the unloaded rod are 0, 1 and 1/3 alone."""

    force_x_gx: float  # within this of 1
    force_y_gx: float  # of 0
    force_x_gy: float  # of 0
    force_y_gy: float  # of 1
    tip_x_gx: float  # of 0
    tip_y_gx: float  # of 0
    tip_x_gy: float  # of 0
    tip_y_gy: float  # of 1/3


@kernel
def enclose_slightly_loaded(G: float) -> SlightlyLoaded:
    """Return how far a rod's derivatives by g can be from those of the unloaded rod, for all |g| <= G < 1.

    The tangent's angle tau from the tip's, at the distance t from the tip, obeys tau'' = g_x sin tau - g_y cos tau, so
    |tau| <= G t^2 / 2; its derivatives A by g_x and B by g_y obey A'' = sin tau + k A, B'' = -cos tau + k B, |k| <= G.
    Comparison gives |A| <= q t^4 G / 24, q = 1 / (1 - G / 12), and |B| <= p t^2 / 2, p = 1 / (1 - G / 2); then
    |B + t^2 / 2| <= G^2 t^6 / 240 + p G t^4 / 24. What follows are integrals over t, then the turn by -tau(1).
    """
    q, p, turn = 1.0 / (1.0 - G / 12.0), 1.0 / (1.0 - 0.5 * G), 0.5 * G
    a = q * G / 24.0  # |A(1)|
    d = G * G / 240.0 + p * G / 24.0  # |B(1) + 1 / 2|
    b = 0.5 + d  # |B(1)|
    unturned = G * G / 8.0  # 1 - cos tau(1)
    # in the tip's frame: by g_x along and across, by g_y along and (less 1/3) across
    along_gx, across_gx = q * G * G / 336.0 + a * G / 6.0, q * G / 120.0 + a
    along_gy = p * G / 20.0 + b * G / 6.0
    across_gy = G * G / 1680.0 + p * G / 120.0 + p * G * G / 112.0 + d + b * G * G / 40.0
    outward = 1.0 + 1e-13
    return SlightlyLoaded(
        (unturned + G * a) * outward,
        (turn + G * a) * outward,
        (turn + G * b) * outward,
        (unturned + G * b) * outward,
        (along_gx + turn * across_gx) * outward,
        (across_gx + turn * along_gx) * outward,
        (along_gy + turn * (across_gy + 1.0 / 3.0)) * outward,
        (across_gy + unturned / 3.0 + turn * along_gy) * outward,
    )
