"""Second derivatives of a rod's tip and force by the load at its tip, in closed form.

Symbols: those of `rod`. Along a path through g, parametrised by t, rho and b change at the rates rho_t and b_t; what a
rod does changes at second order by a quadratic form in these rates, and by the second derivatives of rho and b, which
are those of g's own path. Where force and tip depend on each other, as they do in a mechanism, the latter cancel out.
"""

import math

from pcm_gym.kernels.numerics.compilation import formula, kernel
from pcm_gym.kernels.rods.elliptic import HYPERBOLIC_LIMIT, jacobi
from pcm_gym.kernels.rods.rod import LARGEST_LOAD, SERIES_LOAD, Functions, base_end, series_from_tip, tip_half_angle

# Keeps the ratio of two vanishing numbers finite.
_LEAST_PARAMETER = 1e-300

# Four quadratic forms in the rates of rho and b, by their coefficients of rho rho, rho b and b b; and their values.
Form = tuple[float, float, float]
Curvature = tuple[Form, Form, Form, Form]
Bend = tuple[float, float, float, float]


@kernel
def rod_bend(g_x: float, g_y: float, step_x: float, step_y: float) -> Bend:
    """Return second derivatives of tip (x, y) and force (x, y), clamp's frame, along a path through g.

    The path leaves g with the velocity (step_x, step_y). How it bends itself, so that it is easy to compute on, is no
    promise: use the result only where that cancels out. All is nan where |g| exceeds 2.5e5 or is not a number.
    """
    load = math.hypot(g_x, g_y)
    if not load <= LARGEST_LOAD:
        return math.nan, math.nan, math.nan, math.nan
    if load < SERIES_LOAD:
        return _bend_of_series(g_x, g_y, step_x, step_y)
    rho = math.sqrt(load)
    kappa, kappa_c = tip_half_angle(g_x, g_y, load)
    functions = jacobi(rho, kappa, abs(kappa_c))
    if abs(kappa_c) * math.exp(rho) < HYPERBOLIC_LIMIT:
        lag = 0.25 * (math.sinh(rho) * math.cosh(rho) - rho)  # at m = 1; what it counts for vanishes with kappa_c
    else:
        lag = _amplitude_lag(rho, kappa, kappa_c, functions)
    return bend(g_x, g_y, rod_curvature(g_x, g_y, functions, lag), step_x, step_y)


@kernel
def _bend_of_series(g_x: float, g_y: float, step_x: float, step_y: float) -> Bend:
    """Return the second derivatives along a straight line of g."""
    base = series_from_tip((g_x, step_x, 0.0), (g_y, step_y, 0.0), 1.0)
    c, s = math.cos(base[0, 0]), math.sin(base[0, 0])
    turn, turn_t = base[0, 1], 2.0 * base[0, 2]
    tip = _turned_bend((base[1, 0], base[2, 0]), (base[1, 1], base[2, 1]), turn, turn_t)
    force = _turned_bend((g_x, g_y), (step_x, step_y), turn, turn_t)
    tip_x, tip_y = tip[0] + 2.0 * base[1, 2], tip[1] + 2.0 * base[2, 2]
    return c * tip_x + s * tip_y, c * tip_y - s * tip_x, c * force[0] + s * force[1], c * force[1] - s * force[0]


@formula
def _turned_bend(
    vector: tuple[float, float], rate: tuple[float, float], turn: float, turn_t: float
) -> tuple[float, float]:
    """Return what turning the frame adds to the second derivative of a vector, seen from it: at the rate `turn`."""
    return (
        2.0 * turn * rate[1] + turn_t * vector[1] - turn * turn * vector[0],
        -2.0 * turn * rate[0] - turn_t * vector[0] - turn * turn * vector[1],
    )


@formula
def lag_in_lanes(g_x: float, g_y: float, functions: Functions) -> float:
    """Return the lag that `rod_curvature` asks for, where `rod_in_lanes` holds and from its functions."""
    load = math.sqrt(g_x * g_x + g_y * g_y)
    kappa, kappa_c = tip_half_angle(g_x, g_y, load)
    return _amplitude_lag(math.sqrt(load), kappa, kappa_c, functions)


@formula
def _amplitude_lag(rho: float, kappa: float, kappa_c: float, functions: Functions) -> float:
    """Return -(d am / dm) / dn, half the integral of sd^2, from Jacobi's functions (DLMF 22.13(iii), 22.16(ii)).

    Its error is one of rounding over kappa_c^2.
    """
    sn, cn, dn, deficit, _ = functions
    share = deficit / max(kappa * kappa, _LEAST_PARAMETER)
    return 0.5 * (rho - share - sn * (cn * (1.0 / dn))) / (kappa_c * kappa_c)


@formula
def rod_curvature(g_x: float, g_y: float, functions: Functions, lag: float) -> Curvature:
    """Return the second derivatives of tip (x, y) and force (x, y), clamp's frame, by rho and b, see `bend`.

    `functions` are Jacobi's at (rho | m), and `lag` is -(d am / dm) / dn there. Not for |g| < 0.05.
    """
    load = math.sqrt(g_x * g_x + g_y * g_y)
    rho = math.sqrt(load)
    kappa, kappa_c = tip_half_angle(g_x, g_y, load)
    cos_b, sin_b = g_x / load, -g_y / load
    cos_0, sin_0, beta_u, along, across, eta, eta_u = base_end(rho, kappa, kappa_c, functions)
    eta_b, eta_ub = _eta_by_b(rho, kappa, kappa_c, functions, lag)

    # by rho and by b; then the forms in their rates: by rho twice, by rho and b, by b twice
    per_rho = 1.0 / rho
    x_b, x_bb = -0.5 * (beta_u * eta + rho * sin_b), -0.5 * (eta_u * eta + beta_u * eta_b + rho * cos_b)
    along_1, along_2 = (cos_0 - along) * per_rho, x_b * per_rho
    across_1, across_2 = (sin_0 - across) * per_rho, eta_u * per_rho
    along_11, across_11 = -(sin_0 * beta_u + 2.0 * along_1) * per_rho, (cos_0 * beta_u - 2.0 * across_1) * per_rho
    along_12, across_12 = -2.0 * (sin_0 * eta + along_2) * per_rho, 2.0 * (cos_0 * eta - across_2) * per_rho
    turn_11, turn_12, turn_22 = beta_u * beta_u, 2.0 * beta_u * eta, eta * eta
    # tip and force are turned by -beta0 into the clamp's frame
    tip_x = (
        along_11 + 2.0 * beta_u * across_1 + sin_0 * across - turn_11 * along,
        along_12 + 2.0 * (beta_u * across_2 + eta * across_1 + eta_u * across) - turn_12 * along,
        x_bb * per_rho + 2.0 * eta * across_2 + eta_b * across - turn_22 * along,
    )
    tip_y = (
        across_11 - 2.0 * beta_u * along_1 - sin_0 * along - turn_11 * across,
        across_12 - 2.0 * (beta_u * along_2 + eta * along_1 + eta_u * along) - turn_12 * across,
        eta_ub * per_rho - 2.0 * eta * along_2 - eta_b * along - turn_22 * across,
    )
    force_x = (2.0 - turn_11 * load, -turn_12 * load, -turn_22 * load)
    force_y = (-4.0 * beta_u * rho - sin_0 * load, -4.0 * eta * rho - 2.0 * eta_u * load, -eta_b * load)

    return (
        _turned_form(tip_x, tip_y, cos_0, sin_0),
        _turned_form(tip_y, tip_x, cos_0, -sin_0),
        _turned_form(force_x, force_y, cos_0, sin_0),
        _turned_form(force_y, force_x, cos_0, -sin_0),
    )


@formula
def _turned_form(own: Form, other: Form, c: float, s: float) -> Form:
    return c * own[0] + s * other[0], c * own[1] + s * other[1], c * own[2] + s * other[2]


@formula
def bend(g_x: float, g_y: float, curvature: Curvature, step_x: float, step_y: float) -> Bend:
    """Return the second derivatives of tip (x, y) and force (x, y), clamp's frame, along a path through g.

    The path leaves g with the velocity (step_x, step_y), and rho and b change along it at constant rates.
    """
    square = g_x * g_x + g_y * g_y
    load = math.sqrt(square)
    rho_t, b_t = 0.5 * (g_x * step_x + g_y * step_y) / (load * math.sqrt(load)), (g_y * step_x - g_x * step_y) / square
    first, mixed, second = rho_t * rho_t, rho_t * b_t, b_t * b_t
    return (
        curvature[0][0] * first + curvature[0][1] * mixed + curvature[0][2] * second,
        curvature[1][0] * first + curvature[1][1] * mixed + curvature[1][2] * second,
        curvature[2][0] * first + curvature[2][1] * mixed + curvature[2][2] * second,
        curvature[3][0] * first + curvature[3][1] * mixed + curvature[3][2] * second,
    )


@formula
def _eta_by_b(rho: float, kappa: float, kappa_c: float, functions: Functions, lag: float) -> tuple[float, float]:
    """Return the derivatives by b of eta and of d eta / du, from those of Jacobi's functions by m (DLMF 22.13(iii))."""
    sn, cn, dn, deficit, _ = functions
    m = kappa * kappa
    nd = 1.0 / dn
    cd, sd = cn * nd, sn * nd
    excess, share = m * rho - deficit, deficit / max(m, _LEAST_PARAMETER)
    excess_m = rho - 0.5 * share - dn * dn * lag
    eta_m = 0.5 * excess * sd * sd * sd + sd * (rho - 0.5 * share) - lag * excess * cn * nd * nd
    sn_dn_m = lag * cn * (m * sn * sn - dn * dn) - 0.5 * sn * sn * sd
    cd_nd_m = lag * sn * nd * (1.0 - 2.0 * m * cd * cd) + cn * sn * sn * nd * nd * nd * nd
    sd_cn_m = lag * cn * (2.0 * sn * sn - cd * cd) + 0.5 * cn * cn * sd * sd * sd
    eta_um = excess_m * cd * nd + excess * cd_nd_m - sn_dn_m + sd * cn * cn + m * sd_cn_m
    m_b = -kappa * kappa_c
    return m_b * eta_m, m_b * eta_um
