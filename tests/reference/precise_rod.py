"""One rod in multiple precision, two ways that share nothing: mpmath's elliptic functions, and Taylor series.

Both take the load seen from the tip, g = rho^2 (cos b, -sin b), at its exact double value, and return tip, tip force
(clamp's frame) and bending energy, in units of L, EI/L^2 and EI/L.
"""

from typing import NamedTuple

import mpmath
from mpmath import mp, mpf

DIGITS = 60


class PreciseRod(NamedTuple):
    tip_x: mpf
    tip_y: mpf
    force_x: mpf
    force_y: mpf
    energy: mpf


def _extra_digits(m1: mpf) -> int:
    """Digits that m = 1 - m1 needs beyond `DIGITS` to know m1."""
    return 0 if m1 == 0 else max(0, int(-mpmath.log10(m1)) + 1)


def jacobi(u: mpf, m: mpf, m1: mpf) -> tuple[mpf, mpf, mpf, mpf, mpf]:
    """Return sn, cn, dn, E(u) and K of the parameter m = 1 - m1, from mpmath's theta functions and integrals."""
    if m1 == 0:
        return mpmath.tanh(u), mpmath.sech(u), mpmath.sech(u), mpmath.tanh(u), mpf("inf")
    with mp.workdps(mp.dps + _extra_digits(m1)):
        m = 1 - m1 if m1 < 0.5 else m
        quarter_period = mpmath.ellipk(m)
        sn, cn, dn = (mpmath.re(mpmath.ellipfun(kind, u, m=m)) for kind in ("sn", "cn", "dn"))
        turns = mpmath.floor((u + quarter_period) / (2 * quarter_period))
        amplitude = mpmath.asin(sn) if abs(sn) < 0.7 else mpmath.sign(sn) * mpmath.acos(abs(cn))
        epsilon = 2 * turns * mpmath.ellipe(m) + (-1) ** int(turns) * mpmath.re(mpmath.ellipe(amplitude, m))
        return +sn, +cn, +dn, +epsilon, +quarter_period


def rod_by_elliptic_functions(g_x: mpf, g_y: mpf) -> PreciseRod:
    """Return the rod by the closed form (Altuzarra et al. 2019, Eqs. 13-25, without branch choices)."""
    load = mpmath.sqrt(g_x**2 + g_y**2)
    if load == 0:
        return PreciseRod(mpf(1), mpf(0), mpf(0), mpf(0), mpf(0))
    rho, cos_b, sin_b = mpmath.sqrt(load), g_x / load, -g_y / load
    # sin^2(b) / (1 + |cos b|) is 1 - |cos b| with all digits
    small = sin_b**2 / (1 + abs(cos_b)) / 2
    m, m1 = (1 - small, small) if cos_b >= 0 else (small, 1 - small)
    if m == 0:  # straight, compressed: sn, cn, dn are circular
        return PreciseRod(mpf(1), mpf(0), g_x, mpf(0), mpf(0))
    sn, cn, dn, epsilon, _ = jacobi(rho, m, m1)
    cd, nd, sd = cn / dn, 1 / dn, sn / dn
    cos_0, sin_0 = 2 * m * cd**2 - 1, sin_b * cd * nd
    along = (rho - 2 * epsilon + 2 * m * sn * cd) / rho
    across = sin_b * sd / rho
    tip_x, tip_y = along * cos_0 + across * sin_0, across * cos_0 - along * sin_0
    # curvature^2 / 2 = load (cos b - cos beta), and the integral of cos beta is `along`
    return PreciseRod(tip_x, tip_y, load * cos_0, -load * sin_0, load * (cos_b - along))


def rod_by_taylor_series(g_x: mpf, g_y: mpf) -> PreciseRod:
    """Return the rod by stepping tau'' = g_x sin tau - g_y cos tau from the tip, where tau = tau' = 0, to the base.

    tau is the tangent's angle seen from the tip's tangent; the steps are short against the distance (pi / 2) / rho of
    the solution's poles from the real axis.
    """
    rho = mpmath.sqrt(mpmath.sqrt(g_x**2 + g_y**2))
    steps = 1 + int(4 * rho)
    h = mpf(1) / steps
    order = int(1.6 * mp.dps)
    angle, slope, x, y, energy = mpf(0), mpf(0), mpf(0), mpf(0), mpf(0)
    for _ in range(steps):
        tau, cosine, sine = [angle, slope * h], [mpmath.cos(angle)], [mpmath.sin(angle)]
        for n in range(order):
            if n > 0:
                tau.append(h * h * (g_x * sine[n - 1] - g_y * cosine[n - 1]) / (n * (n + 1)))
            weighted = [(j + 1) * tau[j + 1] for j in range(n + 1)]
            cosine.append(-mpmath.fdot(weighted, reversed(sine)) / (n + 1))
            sine.append(mpmath.fdot(weighted, reversed(cosine[: n + 1])) / (n + 1))
        rate = [(j + 1) * tau[j + 1] / h for j in range(order)]
        energy += h * sum(mpmath.fdot(rate[: n + 1], reversed(rate[: n + 1])) / (n + 1) for n in range(order)) / 2
        x += h * sum(c / (n + 1) for n, c in enumerate(cosine))
        y += h * sum(s / (n + 1) for n, s in enumerate(sine))
        angle, slope = sum(tau), sum(rate)
    # (x, y) is the vector from base to tip in the tip's frame; the base's tangent has the angle `angle` there
    c, s = mpmath.cos(angle), mpmath.sin(angle)
    return PreciseRod(c * x + s * y, c * y - s * x, c * g_x + s * g_y, c * g_y - s * g_x, energy)
