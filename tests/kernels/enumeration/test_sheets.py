"""The table of a rod's sheets leaves out no equilibrium: the truth is the rod itself at random loads."""

import math

import numpy as np
import pytest

from pcm_gym.kernels.enumeration import sheets as columns
from pcm_gym.kernels.enumeration.cells import grid_load
from pcm_gym.kernels.enumeration.sheets import Sheets, make_sheets
from pcm_gym.kernels.rods.rod import rod

RHO_MAX = 7.0


@pytest.fixture(scope="module")
def table() -> Sheets:
    return make_sheets(RHO_MAX, 0)


def random_load(rng: np.random.Generator) -> np.ndarray:
    """Return a load up to RHO_MAX, half of them even in the plane, half on the grid's scale of taut rods."""
    if rng.uniform() < 0.5:
        rho, b = RHO_MAX * math.sqrt(rng.uniform()), rng.uniform(-math.pi, math.pi)
        return rho**2 * np.array([math.cos(b), -math.sin(b)])
    return np.array(grid_load(RHO_MAX * rng.uniform(), rng.uniform(), int(rng.integers(2))))


def patches_around(table: Sheets, tip: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return, for each node whose square holds the tip, the tip from the node and the node's patches."""
    low = np.ceil((tip - table.half_width) / table.spacing).astype(int)
    high = np.floor((tip + table.half_width) / table.spacing).astype(int)
    found = []
    for column in range(low[0], high[0] + 1):
        for row in range(low[1], high[1] + 1):
            square = (column + table.extent) * (2 * table.extent + 1) + row + table.extent
            own = table.patches[table.offsets[square] : table.offsets[square + 1]]
            found.append((tip - table.spacing * np.array([column, row]), own))
    return found


def excess(away: np.ndarray, force: np.ndarray, patches: np.ndarray) -> np.ndarray:
    """Return how far the force is out of what each patch allows at a tip: infinite where it does not cover the tip."""
    covers = (patches[:, columns.X_LOW] <= away[0]) & (away[0] <= patches[:, columns.X_HIGH])
    covers &= (patches[:, columns.Y_LOW] <= away[1]) & (away[1] <= patches[:, columns.Y_HIGH])
    affine = np.array([1.0, *away])
    error = np.stack(
        [
            force[k] - patches[:, first : first + 3] @ affine
            for k, first in enumerate((columns.FORCE_X, columns.FORCE_Y))
        ]
    )
    segment = patches[:, [columns.ERROR_X, columns.ERROR_Y]].T
    length = np.maximum(np.hypot(*segment), 1e-300)
    along = np.abs(np.sum(segment * error, axis=0)) / length
    across = np.abs(segment[0] * error[1] - segment[1] * error[0]) / length
    out = np.maximum(along - length, across - patches[:, columns.ERROR_RADIUS])
    return np.where(covers, out, np.inf)


def test_every_rod_is_in_a_patch_of_every_square_that_holds_its_tip(table: Sheets) -> None:
    rng = np.random.default_rng(5)
    checked = 0
    for _ in range(3000):
        point = rod(*random_load(rng))
        tip, force = np.array([point.tip_x, point.tip_y]), np.array([point.force_x, point.force_y])
        for away, patches in patches_around(table, tip):
            checked += 1
            # between the nodes of its grid a patch may err a little: errors of the force near 40 by a tenth
            assert excess(away, force, patches).min() < 0.1, (tip, force, away)
    assert checked > 20_000


def test_a_patch_leads_back_to_its_rod(table: Sheets) -> None:
    """The place on the grid that a patch gives for a tip is near the rod's own, farther only at folds."""
    rng = np.random.default_rng(6)
    distances = []
    for _ in range(500):
        i, j, side = rng.uniform(0.05, 1.0), rng.uniform(0.05, 0.95), int(rng.integers(2))
        point = rod(*grid_load(RHO_MAX * i, j, side))
        tip, force = np.array([point.tip_x, point.tip_y]), np.array([point.force_x, point.force_y])
        away, patches = min(patches_around(table, tip), key=lambda pair: float(np.abs(pair[0]).max()))
        own = patches[(excess(away, force, patches) < 0.1) & (patches[:, columns.SIDE] == side)]
        affine = np.array([1.0, *away])
        place = np.stack([own[:, f : f + 3] @ affine for f in (columns.RHO_CELL, columns.GRADE_CELL)]) / table.size
        distances.append(np.hypot(place[0] - i, place[1] - j).min())
    half, most, all_of_them = np.quantile(distances, [0.5, 0.9, 1.0])
    assert half < 0.02
    assert most < 0.15
    assert all_of_them < 0.4
