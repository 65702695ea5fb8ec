"""One elastic rod, clamped at its base and hinged at its tip: every equilibrium in closed form.

The state of a rod is the force at its tip as the tip's own frame sees it, g = rho^2 (cos b, -sin b), in units of
EI/L^2. Each equilibrium, in every buckling mode, belongs to exactly one g, and all that a rod does is smooth in g,
the unloaded straight rod (g = 0) included. Lengths are in units of L.

Symbols (Altuzarra et al. 2019, Eqs. 13-25, in a chart without branch choices): beta = angle from the force to the
tangent, b at the tip, beta0 at the base; u = arc length back from the tip times omega = rho / L; kappa = cos(b/2),
kappa_c = sin(b/2), m = kappa^2; X, Y = the tip from the base, along and across the force; eta = d beta0 / d b.
"""

import math
from typing import NamedTuple

import numpy as np

from pcm_gym.arrays import Array
from pcm_gym.kernels.numerics.compilation import formula, kernel
from pcm_gym.kernels.rods.elliptic import LEAST_LANE_COMPLEMENT, jacobi, jacobi_in_lanes, quarter_period

# Below this load |g| the power series is used: the closed form divides rounding errors by |g|.
SERIES_LOAD = 0.05
_SERIES_TERMS = 7
# Beyond this load (rho = 500) exp(rho) nears the end of the floating-point range.
LARGEST_LOAD = 2.5e5
# Jacobi's sn, cn, dn, u - E(u) and the quarter period.
Functions = tuple[float, float, float, float, float]
# A number and two of its derivatives, see `series_from_tip`.
Jet = tuple[float, float, float]


class RodPoint(NamedTuple):
    """What one rod does at one g, in the clamp's frame: tip, tip force, their derivatives by g, index and mode."""

    tip_x: float
    tip_y: float
    force_x: float
    force_y: float
    tip_x_gx: float
    tip_x_gy: float
    tip_y_gx: float
    tip_y_gy: float
    force_x_gx: float
    force_x_gy: float
    force_y_gx: float
    force_y_gy: float
    dead_load_index: float
    half_periods: float  # rho / (2 K): the buckling mode is 1 + its integer part


@formula
def tip_half_angle(g_x: float, g_y: float, load: float) -> tuple[float, float]:
    """Return kappa = cos(b/2) >= 0 and kappa_c = sin(b/2), each with all its digits, for load = |g| > 0."""
    sin_b = -g_y / load
    greater = math.sqrt(0.5 * (1.0 + abs(g_x) / load))
    lesser = 0.5 * sin_b / greater
    if g_x >= 0.0:
        return greater, lesser
    return abs(lesser), math.copysign(greater, sin_b)


@kernel
def rod(g_x: float, g_y: float) -> RodPoint:
    """Return tip, force, derivatives and dead-load index of the rod at g = (g_x, g_y).

    The tip and the force are in the clamp's frame, in units of L and EI/L^2. `dead_load_index` counts the unstable
    directions of the rod when its tip is free under the constant force: the zeros of eta in (0, rho). Relative
    error about 1e-14; about 0.1 microseconds. All is nan where |g| exceeds 2.5e5 or is not a number.
    """
    load = math.hypot(g_x, g_y)
    if not load <= LARGEST_LOAD:
        nan = math.nan
        return RodPoint(nan, nan, nan, nan, nan, nan, nan, nan, nan, nan, nan, nan, nan, nan)
    if load < SERIES_LOAD:
        return _rod_series(g_x, g_y)
    return _rod_elliptic(g_x, g_y, load)


@kernel
def _rod_elliptic(g_x: float, g_y: float, load: float) -> RodPoint:
    rho = math.sqrt(load)
    kappa, kappa_c = tip_half_angle(g_x, g_y, load)
    return _rod_from_functions(g_x, g_y, load, rho, kappa, kappa_c, jacobi(rho, kappa, abs(kappa_c)))


@formula
def rod_in_lanes(g_x: float, g_y: float) -> tuple[RodPoint, Functions, bool]:
    """Return what `rod` returns, without branches, the elliptic functions in it, and whether they hold for this g.

    Not for loads below 0.05 or above 2.5e5, nor for taut rods with |sin(b/2)| < 1e-6.
    """
    load = math.sqrt(g_x * g_x + g_y * g_y)
    rho = math.sqrt(load)
    kappa, kappa_c = tip_half_angle(g_x, g_y, load)
    functions = jacobi_in_lanes(rho, kappa, abs(kappa_c))
    holds = (load >= SERIES_LOAD) & (load <= LARGEST_LOAD) & (abs(kappa_c) >= LEAST_LANE_COMPLEMENT)
    return _rod_from_functions(g_x, g_y, load, rho, kappa, kappa_c, functions), functions, holds


@formula
def _rod_from_functions(
    g_x: float,
    g_y: float,
    load: float,
    rho: float,
    kappa: float,
    kappa_c: float,
    functions: Functions,
) -> RodPoint:
    """Return the rod at g by Jacobi's functions at (rho | m)."""
    cos_b, sin_b = g_x / load, -g_y / load
    half_periods = 0.5 * rho / functions[4]
    cos_0, sin_0, beta_u, along, across, eta, eta_u = base_end(rho, kappa, kappa_c, functions)

    tip_x = along * cos_0 + across * sin_0
    tip_y = across * cos_0 - along * sin_0
    # by rho at fixed b, then by b at fixed rho; beta0 changes by beta_u and by eta
    along_rho, across_rho = (cos_0 - along) / rho, (sin_0 - across) / rho
    along_b, across_b = -0.5 * (beta_u * eta + rho * sin_b) / rho, eta_u / rho
    tip_x_rho = along_rho * cos_0 + across_rho * sin_0 + tip_y * beta_u
    tip_y_rho = across_rho * cos_0 - along_rho * sin_0 - tip_x * beta_u
    tip_x_b = along_b * cos_0 + across_b * sin_0 + tip_y * eta
    tip_y_b = across_b * cos_0 - along_b * sin_0 - tip_x * eta
    force_x_rho = 2.0 * rho * cos_0 - load * sin_0 * beta_u
    force_y_rho = -2.0 * rho * sin_0 - load * cos_0 * beta_u
    force_x_b, force_y_b = -load * sin_0 * eta, -load * cos_0 * eta

    rho_gx, rho_gy = 0.5 * cos_b / rho, -0.5 * sin_b / rho
    b_gx, b_gy = -sin_b / load, -cos_b / load
    return RodPoint(
        tip_x,
        tip_y,
        load * cos_0,
        -load * sin_0,
        tip_x_rho * rho_gx + tip_x_b * b_gx,
        tip_x_rho * rho_gy + tip_x_b * b_gy,
        tip_y_rho * rho_gx + tip_y_b * b_gx,
        tip_y_rho * rho_gy + tip_y_b * b_gy,
        force_x_rho * rho_gx + force_x_b * b_gx,
        force_x_rho * rho_gy + force_x_b * b_gy,
        force_y_rho * rho_gx + force_y_b * b_gx,
        force_y_rho * rho_gy + force_y_b * b_gy,
        _eta_zeros(half_periods, eta),
        half_periods,
    )


@formula
def base_end(
    rho: float, kappa: float, kappa_c: float, functions: Functions
) -> tuple[float, float, float, float, float, float, float]:
    """Return cosine and sine of beta0, d beta / du there, X and Y, eta and d eta / du."""
    sn, cn, dn, deficit, _ = functions
    m = kappa * kappa
    nd = 1.0 / dn
    cd, sd = cn * nd, sn * nd
    beta_u = 2.0 * kappa * kappa_c * sd
    excess = m * rho - deficit  # E - (1 - m) rho
    return (
        2.0 * m * cd * cd - 1.0,
        2.0 * kappa * kappa_c * cd * nd,
        beta_u,
        (2.0 * deficit - rho + 2.0 * m * sn * cd) / rho,
        beta_u / rho,
        cn + sd * excess,
        -sn * dn + excess * cd * nd + m * sd * cn * cn,
    )


@formula
def _eta_zeros(half_periods: float, eta: float) -> float:
    """Return the number of zeros of eta in (0, rho): exactly one lies between neighbouring multiples of 2 K."""
    passed = np.floor(half_periods)
    is_even = passed == 2.0 * np.floor(0.5 * passed)
    has_next = eta < 0.0 if is_even else eta > 0.0
    return float(passed + (1.0 if has_next else 0.0))


@kernel
def _rod_series(g_x: float, g_y: float) -> RodPoint:
    return _in_clamp_frame(g_x, g_y, series_from_tip((g_x, 1.0, 0.0), (g_y, 0.0, 1.0), 0.0))


@kernel
def series_from_tip(g_x: Jet, g_y: Jet, mixed: float) -> Array:
    """Return the tangent's angle at the base, and the tip from the base in the tip's frame, as jets (3, 3).

    Taylor series in the squared distance from the tip of the tangent's angle tau, seen in the tip's frame:
    tau'' = g_x sin(tau) - g_y cos(tau). Column 0 of a jet holds a value. With `mixed` = 0 columns 1 and 2 hold its
    first derivatives along two directions of g; with `mixed` = 1 its first and half its second one along a path.
    """
    angle = np.zeros((_SERIES_TERMS, 3))
    cosine = np.zeros((_SERIES_TERMS, 3))
    sine = np.zeros((_SERIES_TERMS, 3))
    cosine[0, 0] = 1.0
    for n in range(1, _SERIES_TERMS):
        scale = 1.0 / (2 * n * (2 * n - 1))
        for d in range(3):
            angle[n, d] = scale * (g_x[0] * sine[n - 1, d] - g_y[0] * cosine[n - 1, d])
        for d in range(1, 3):
            angle[n, d] += scale * (g_x[d] * sine[n - 1, 0] - g_y[d] * cosine[n - 1, 0])
        angle[n, 2] += mixed * scale * (g_x[1] * sine[n - 1, 1] - g_y[1] * cosine[n - 1, 1])
        for j in range(1, n + 1):
            weight = j / n
            cosine[n, 0] -= weight * angle[j, 0] * sine[n - j, 0]
            sine[n, 0] += weight * angle[j, 0] * cosine[n - j, 0]
            for d in range(1, 3):
                cosine[n, d] -= weight * (angle[j, d] * sine[n - j, 0] + angle[j, 0] * sine[n - j, d])
                sine[n, d] += weight * (angle[j, d] * cosine[n - j, 0] + angle[j, 0] * cosine[n - j, d])
            cosine[n, 2] -= mixed * weight * angle[j, 1] * sine[n - j, 1]
            sine[n, 2] += mixed * weight * angle[j, 1] * cosine[n - j, 1]
    base = np.zeros((3, 3))
    for n in range(_SERIES_TERMS):
        for d in range(3):
            base[0, d] += angle[n, d]
            base[1, d] += cosine[n, d] / (2 * n + 1)
            base[2, d] += sine[n, d] / (2 * n + 1)
    return base


@kernel
def _in_clamp_frame(g_x: float, g_y: float, base: Array) -> RodPoint:
    """Turn tip and force from the tip's frame by -base[0], the way to the clamp's frame, derivatives included."""
    c, s = math.cos(base[0, 0]), math.sin(base[0, 0])
    tip_x = c * base[1, 0] + s * base[2, 0]
    tip_y = c * base[2, 0] - s * base[1, 0]
    force_x = c * g_x + s * g_y
    force_y = c * g_y - s * g_x
    return RodPoint(
        tip_x,
        tip_y,
        force_x,
        force_y,
        c * base[1, 1] + s * base[2, 1] + tip_y * base[0, 1],
        c * base[1, 2] + s * base[2, 2] + tip_y * base[0, 2],
        c * base[2, 1] - s * base[1, 1] - tip_x * base[0, 1],
        c * base[2, 2] - s * base[1, 2] - tip_x * base[0, 2],
        c + force_y * base[0, 1],
        s + force_y * base[0, 2],
        -s - force_x * base[0, 1],
        c - force_x * base[0, 2],
        0.0,
        _series_half_periods(g_x, g_y),
    )


@kernel
def _series_half_periods(g_x: float, g_y: float) -> float:
    load = math.hypot(g_x, g_y)
    if load == 0.0:
        return 0.0
    _, kappa_c = tip_half_angle(g_x, g_y, load)
    return 0.5 * math.sqrt(load) / quarter_period(abs(kappa_c))


@kernel
def rod_parameters(g_x: float, g_y: float) -> tuple[float, float, int, float]:
    """Return the paper's parameters of the rod at g: modulus k (signed), psi in [0, 2 pi), buckling mode q, and rho.

    psi is the direction of the tip force in the clamp's frame; k sin(phi_2) = kappa with phi_2 = (2 q - 1) pi / 2.
    An unloaded rod (g = 0) has no force direction; it is given as k = 1, psi = 0, q = 1.
    """
    load = math.hypot(g_x, g_y)
    if load == 0.0:
        return 1.0, 0.0, 1, 0.0
    kappa, kappa_c = tip_half_angle(g_x, g_y, load)
    point = rod(g_x, g_y)
    mode = 1 + int(math.floor(point.half_periods))
    psi = math.atan2(point.force_y, point.force_x)
    if psi < 0.0:
        psi += 2.0 * math.pi
    if psi >= 2.0 * math.pi:  # a negative angle too small to survive the addition
        psi = 0.0
    return (kappa if (mode % 2 == 1) == (kappa_c <= 0.0) else -kappa), psi, mode, math.sqrt(load)


@kernel
def rod_energy(g_x: float, g_y: float) -> float:
    """Return the bending energy of the rod at g, in units of EI/L: (g_x - rho^2 X), the integral of curvature^2 / 2."""
    point = rod(g_x, g_y)
    return max(0.0, g_x - (point.force_x * point.tip_x + point.force_y * point.tip_y))


@kernel
def rod_shape(g_x: float, g_y: float, shape: Array) -> None:
    """Fill `shape` (points, 2) with the rod's centre line in the clamp's frame, base to tip, equal steps of arc.

    Seen from its tip, the part of the rod beyond a cut at distance t is itself a clamped rod of length t with load
    t^2 g: each point is one evaluation, exact to rounding.
    """
    points = shape.shape[0]
    whole = rod(g_x, g_y)
    for i in range(points):
        part = 1.0 - i / (points - 1)
        cut = rod(part * part * g_x, part * part * g_y)
        c, s = _turn(whole, cut, part * part)
        shape[i, 0] = whole.tip_x - part * (c * cut.tip_x - s * cut.tip_y)
        shape[i, 1] = whole.tip_y - part * (s * cut.tip_x + c * cut.tip_y)


@kernel
def _turn(whole: RodPoint, cut: RodPoint, scale: float) -> tuple[float, float]:
    """Return cosine and sine of the tangent's angle at the cut: it turns the part's force into the whole rod's."""
    square = scale * (whole.force_x**2 + whole.force_y**2)
    if square < 1e-290:  # straight to rounding, and its square may have lost its digits
        return 1.0, 0.0
    cosine = (whole.force_x * cut.force_x + whole.force_y * cut.force_y) / square
    sine = (whole.force_y * cut.force_x - whole.force_x * cut.force_y) / square
    return cosine, sine
