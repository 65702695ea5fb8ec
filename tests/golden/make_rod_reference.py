"""Remake `rod_reference.csv`: one rod at many tip loads in 90 digits, rounded to doubles. From the repository's root:

    python -m tests.golden.make_rod_reference

Values: the closed form with mpmath's elliptic functions, at the exact doubles g_x, g_y of each row. Derivatives: its
central differences with a step of 1e-22, whose own error is below 1e-30. On every seventh row the script asserts that
the values agree to 1e-30 with a Taylor integration of the rod's differential equation.
"""

import math
from pathlib import Path

import numpy as np
from mpmath import mp, mpf

from tests.reference.precise_rod import rod_by_elliptic_functions, rod_by_taylor_series

PATH = Path(__file__).with_name("rod_reference.csv")
COLUMNS = ["g_x", "g_y", "tip_x", "tip_y", "force_x", "force_y", "energy"] + [
    f"{value}_{by}" for value in ("tip_x", "tip_y", "force_x", "force_y") for by in ("gx", "gy")
]
DIGITS = 90
STEP = mpf(10) ** -22

# |g|: unloaded limit, around the switch between series and closed form at 0.05, moderate; then rho up to 12.
SMALL_LOADS = [1e-12, 1e-9, 1e-6, 1e-4, 1e-3, 1e-2, 0.03, 0.0499999999, 0.0500000001, 0.051, 0.07, 0.1, 0.2, 0.4, 0.7]
RHOS = [1.0, 1.3, math.pi / 2.0, 1.8, 2.2, 2.7, 3.141592653589793, 3.6, 4.1, 4.493409457909064, 4.7123889803846897]
RHOS += [5.2, 5.8, 6.4, 7.0, 7.725251836937707, 8.3, 9.0, 9.7, 10.4, 11.2, 12.0]
# b away from its hard ends
ANGLES = [1e-4, 1e-2, 0.1, 0.3, 0.6, 0.9, 1.2, 1.5, 1.8, 2.1, 2.4, 2.7, 2.9, 3.05, 3.13]
ENDS = [1e-300, 1e-100, 1e-30, 1e-16, 1e-12, 1e-9, 1e-6]  # distance from b = 0 and, where representable, from b = pi


def loads() -> list[tuple[float, float]]:
    """Return the grid of (g_x, g_y)."""
    grid = [(0.0, 0.0)]
    for load in SMALL_LOADS + [rho**2 for rho in RHOS]:
        rho = math.sqrt(load)
        taut = [math.exp(-factor * rho) for factor in (0.8, 1.0, 1.2)]
        for n, b in enumerate(ANGLES + ENDS + taut):
            side = -1.0 if n % 2 else 1.0
            grid.append((load * math.cos(b), -side * load * math.sin(b)))
        for n, distance in enumerate(ENDS):
            grid.append((-load, (-1.0 if n % 2 else 1.0) * load * distance))
        grid += [(load, 0.0), (-load, 0.0), (0.0, load), (0.0, -load)]
    return grid


def reference_row(g_x: float, g_y: float) -> list[float]:
    """Return one row of the table."""
    x, y = mpf(g_x), mpf(g_y)
    value = rod_by_elliptic_functions(x, y)
    ahead_x, behind_x = rod_by_elliptic_functions(x + STEP, y), rod_by_elliptic_functions(x - STEP, y)
    ahead_y, behind_y = rod_by_elliptic_functions(x, y + STEP), rod_by_elliptic_functions(x, y - STEP)
    row = [g_x, g_y, *map(float, value)]
    for i in range(4):
        row += [float((ahead_x[i] - behind_x[i]) / (2 * STEP)), float((ahead_y[i] - behind_y[i]) / (2 * STEP))]
    return row


def check_by_taylor_series(g_x: float, g_y: float) -> None:
    """Assert that the two references agree."""
    closed_form = rod_by_elliptic_functions(mpf(g_x), mpf(g_y))
    with mp.workdps(45):
        series = rod_by_taylor_series(mpf(g_x), mpf(g_y))
        scale = 1 + mpf(math.hypot(g_x, g_y))
        assert max(abs(a - b) for a, b in zip(closed_form, series, strict=True)) < mpf(10) ** -30 * scale, (g_x, g_y)


def main() -> None:
    mp.dps = DIGITS
    grid = loads()
    for g_x, g_y in grid[::7]:
        check_by_taylor_series(g_x, g_y)
    table = np.array([reference_row(g_x, g_y) for g_x, g_y in grid])
    np.savetxt(PATH, table, fmt="%.17g", delimiter=",", header=",".join(COLUMNS), comments="")
    print(f"{len(grid)} rows in {PATH}")


if __name__ == "__main__":
    main()
