"""The map from a rod's tip load to its tip, tabulated: every equilibrium of one rod whose tip is held at a point.

The table serves every rod by scaling and rotation. It is a grid over the half turns of the tip load, graded towards
tension (b = 0), where b lives on the scale exp(-rho), and over rho.
"""

import math

import numpy as np
from numpy.typing import NDArray

from pcm_gym.kernels.compilation import kernel
from pcm_gym.kernels.rod import rod

Array = NDArray[np.float64]

_NEWTON_STEPS = 12
_TIP_TOLERANCE = 1e-11
# Part of a cell's extent by which its box is widened for what the map bulges between the nodes.
_WIDENING = 0.3


@kernel
def make_rod_table(rho_max: float, rho_count: int, turn_count: int) -> Array:
    """Return the table (rho_count, turn_count, 4): g_x, g_y, tip_x, tip_y at each node."""
    table = np.zeros((rho_count, turn_count, 4))
    for i in range(rho_count):
        rho = rho_max * (i + 0.5 * (i == 0)) / (rho_count - 1)
        for j in range(turn_count):
            side = 2.0 * j / (turn_count - 1) - 1.0
            b = math.copysign(math.pi * math.expm1(rho * abs(side)) / math.expm1(rho), side)
            table[i, j, 0] = rho * rho * math.cos(b)
            table[i, j, 1] = -rho * rho * math.sin(b)
            point = rod(table[i, j, 0], table[i, j, 1])
            table[i, j, 2], table[i, j, 3] = point.tip_x, point.tip_y
    return table


@kernel
def rods_at_tip(table: Array, tip_x: float, tip_y: float, found: Array) -> int:
    """Put the loads g of the rods whose tip is at (tip_x, tip_y), clamp's frame, into `found` (m, 2); return how many.

    Every cell of the table whose widened box holds the point is polished by Newton's method from two corners; finds
    that coincide are merged.
    """
    count = 0
    for i in range(table.shape[0] - 1):
        for j in range(table.shape[1] - 1):
            if not _may_hold(table, i, j, 2, tip_x) or not _may_hold(table, i, j, 3, tip_y):
                continue
            for corner in range(2):
                g_x, g_y = table[i + corner, j + corner, 0], table[i + corner, j + corner, 1]
                converged, g_x, g_y = _polish(g_x, g_y, tip_x, tip_y)
                if converged and count < found.shape[0] and _is_new(found[:count], g_x, g_y):
                    found[count, 0], found[count, 1] = g_x, g_y
                    count += 1
    return count


@kernel
def _may_hold(table: Array, i: int, j: int, column: int, value: float) -> bool:
    first, second = table[i, j, column], table[i + 1, j, column]
    third, fourth = table[i, j + 1, column], table[i + 1, j + 1, column]
    low, high = min(first, second, third, fourth), max(first, second, third, fourth)
    margin = _WIDENING * (high - low)
    return bool(low - margin <= value <= high + margin)


@kernel
def _polish(g_x: float, g_y: float, tip_x: float, tip_y: float) -> tuple[bool, float, float]:
    for _ in range(_NEWTON_STEPS):
        point = rod(g_x, g_y)
        error_x, error_y = point.tip_x - tip_x, point.tip_y - tip_y
        if abs(error_x) + abs(error_y) < _TIP_TOLERANCE:
            return True, g_x, g_y
        inverse = 1.0 / (point.tip_x_gx * point.tip_y_gy - point.tip_x_gy * point.tip_y_gx)
        g_x -= (point.tip_y_gy * error_x - point.tip_x_gy * error_y) * inverse
        g_y -= (point.tip_x_gx * error_y - point.tip_y_gx * error_x) * inverse
        if not math.isfinite(g_x + g_y):
            break
    return False, g_x, g_y


@kernel
def _is_new(found: Array, g_x: float, g_y: float) -> bool:
    """Return whether the load differs from all found ones; g_y is compared on its own scale, small in taut rods."""
    for n in range(found.shape[0]):
        scale = 1.0 + abs(g_x)
        if abs(found[n, 0] - g_x) < 1e-6 * scale and abs(found[n, 1] - g_y) < 1e-6 * min(scale, abs(g_y) + 1e-12):
            return False
    return True
