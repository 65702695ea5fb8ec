"""Where a rod crosses itself, in closed form.

Along the rod the lever arm of the force, and so sd(u|m), takes the same value at two places either a whole period 4 K
apart, where the curve has moved on along the force, or symmetric about a place where the curvature is largest,
u = (2 j + 1) K. About that place the curve is its own mirror image, so both places coincide exactly where it comes
back to the force's normal through it: at the distances v with

    f(v) = 2 E(v|m) - v = 0,   f' = 2 dn^2 - 1

for every j the same v. f turns where dn^2 = 1/2: at v_1, 2 K - v_1, 2 K + v_1, ... (m > 1/2). Its least value up to
u = 4 K is at 2 K - v_1 and negative if m is above that of the elastica that touches itself; the first zero then comes
before. Only at the elastica in the shape of an eight, 2 E = K, do places a period apart coincide, and with them whole
pieces of the rod: that is one of touching, and not counted.
"""

import math

import numpy as np

from pcm_gym.arrays import Array
from pcm_gym.kernels.numerics.compilation import formula, kernel
from pcm_gym.kernels.rods.elliptic import jacobi, quarter_period
from pcm_gym.kernels.rods.rod import tip_half_angle

# cos b = 2 m - 1 of the elastica that touches itself: f(2 K - v_1) = 0, at m = 0.7311830257410411868.
TOUCHING_COSINE = 0.46236605148208237
_HALVINGS = 200
# Columns of the crossings that are found: arc lengths over L, from the base, the lesser first.
_FIRST, _SECOND = range(2)


@formula
def may_cross_itself(g_x: float, g_y: float, half_periods: float) -> bool:
    """Return False where a rod surely does not cross itself, at hardly any cost."""
    return (half_periods > 0.5) & (g_x * abs(g_x) > TOUCHING_COSINE * TOUCHING_COSINE * (g_x * g_x + g_y * g_y))


@kernel
def crosses_itself(g_x: float, g_y: float, half_periods: float) -> bool:
    """Return whether the rod at g crosses itself; `half_periods` is rho / (2 K)."""
    if not may_cross_itself(g_x, g_y, half_periods):
        return False
    load = math.hypot(g_x, g_y)
    kappa, kappa_c = tip_half_angle(g_x, g_y, load)
    quarter = 0.5 * math.sqrt(load) / half_periods
    # the longest way to both sides of a largest curvature: of the one nearest to the middle
    middle = 2.0 * np.floor(0.5 * half_periods) + 1.0
    way = quarter * (half_periods - abs(middle - half_periods))
    if way >= 2.0 * quarter:
        return True
    _, _, dn, deficit, _ = jacobi(way, kappa, abs(kappa_c))
    is_past_least = way > quarter and dn * dn > 0.5
    return bool(is_past_least or way < 2.0 * deficit)


@kernel
def find_loops(g_x: float, g_y: float, found: Array) -> int:
    """Put arc lengths over L, (k, 2), of where the rod at g crosses itself into `found`; return how many there are.

    More than k if there is no room for all.
    """
    load = math.hypot(g_x, g_y)
    if load == 0.0 or not g_x > TOUCHING_COSINE * load:
        return 0
    rho = math.sqrt(load)
    kappa, kappa_c = tip_half_angle(g_x, g_y, load)
    quarter = quarter_period(abs(kappa_c))
    turning = _bisect(0.0, quarter, True, kappa, abs(kappa_c))
    count, middle = 0, quarter
    while middle < rho:
        reach = min(middle, rho - middle)
        low, number = 0.0, 0
        while low < reach:
            # f rises on pieces of even number and falls on others
            next_turning = 2.0 * quarter * ((number + 1) // 2) + (turning if number % 2 == 0 else -turning)
            high = min(next_turning, reach)
            if low > 0.0 and (_excess(low, kappa, kappa_c) > 0.0) != (_excess(high, kappa, kappa_c) > 0.0):
                way = _bisect(low, high, False, kappa, abs(kappa_c))
                if count < found.shape[0]:
                    found[count, _FIRST], found[count, _SECOND] = 1.0 - (middle + way) / rho, 1.0 - (middle - way) / rho
                count += 1
            low = high
            number += 1
        middle += 2.0 * quarter
    return count


@kernel
def _excess(way: float, kappa: float, kappa_c: float) -> float:
    """Return f."""
    return way - 2.0 * jacobi(way, kappa, abs(kappa_c))[3]


@kernel
def _bisect(low: float, high: float, is_of_slope: bool, kappa: float, kappa_c: float) -> float:
    """Return the zero of f, or of its slope, between two places with different signs, by safeguarded Newton steps."""
    rises = not is_of_slope and _excess(high, kappa, kappa_c) > 0.0
    way = 0.5 * (low + high)
    for _ in range(_HALVINGS):
        sn, cn, dn, deficit, _ = jacobi(way, kappa, kappa_c)
        value = 2.0 * dn * dn - 1.0 if is_of_slope else way - 2.0 * deficit
        slope = -4.0 * kappa * kappa * sn * cn * dn if is_of_slope else 2.0 * dn * dn - 1.0
        if (value > 0.0) == rises:
            high = way
        else:
            low = way
        trial = way - value / slope if slope != 0.0 else low
        if abs(trial - way) <= 1e-15 * way:
            return trial
        way = trial if low < trial < high else 0.5 * (low + high)
        if high - low <= 1e-15 * high:
            break
    return way
