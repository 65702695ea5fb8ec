"""The tree of cells with rigorous models: it covers all loads, and every node's model holds the rod."""

import math

import numpy as np
import pytest

from pcm_gym.kernels.enumeration.cells import node_offset
from pcm_gym.kernels.proofs.rod_cells import PLACED, UnitCells, make_frames, make_unit_cells, set_contribution
from pcm_gym.kernels.rods.rod import rod

RHO_MAX, LEVELS = 9.0, 6


@pytest.fixture(scope="module")
def cells() -> UnitCells:
    return make_unit_cells(LEVELS, RHO_MAX, PLACED)


def some_loads(count: int) -> np.ndarray:
    """Return (n, 2): rho and b, a third of them taut, and the borders."""
    rng = np.random.default_rng(5)
    rho = rng.uniform(0.0, RHO_MAX, count)
    b = rng.uniform(-math.pi, math.pi, count)
    taut = rng.uniform(size=count) < 0.4
    b[taut] = np.sign(b[taut]) * np.exp(-rho[taut] * rng.uniform(0.2, 1.3, taut.sum()))
    borders = [(r, b) for r in (0.0, RHO_MAX / 16.0, RHO_MAX) for b in (-math.pi, 0.0, 1e-300, math.pi)]
    return np.vstack([np.stack([rho, b], axis=1), borders])


def test_every_load_is_in_a_leaf_and_the_models_above_it_hold_the_rod(cells: UnitCells) -> None:
    centers, widths = cells.boxes[:, 0::2], cells.boxes[:, 1::2]
    start = node_offset(LEVELS)
    for load in some_loads(2000):
        rho, b = load
        point = rod(rho**2 * math.cos(b), -(rho**2) * math.sin(b))
        truth = np.array([point.force_x, point.force_y, point.tip_x, point.tip_y])
        leaves = np.flatnonzero(np.all(np.abs(load - centers[start:]) <= widths[start:], axis=1))
        assert len(leaves) >= 1, load
        for leaf in leaves:
            for level in range(LEVELS, -1, -1):
                node = node_offset(level) + leaf // 4 ** (LEVELS - level)
                local = (load - centers[node]) / widths[node]
                assert np.all(np.abs(local) <= 1.0 + 1e-12)
                model = cells.models[node]
                value = model[:, 0] + model[:, 1] * local[0] + model[:, 2] * local[1]
                assert np.all(np.abs(value - truth) <= model[:, 3] + 1e-12 * (1.0 + rho * rho)), (level, load)


def test_most_leaves_are_known_well(cells: UnitCells) -> None:
    """A bound that is only true would prove nothing; these are for coarse cells."""
    tips = cells.models[node_offset(LEVELS) :, 2:, 3]
    assert np.median(tips) < 0.02
    assert np.quantile(tips, 0.8) < 0.2


def test_contributions_hold_what_the_legs_add() -> None:
    """Force of both legs less the load, and the first tip less the second, with a motor and a slider."""
    rng = np.random.default_rng(6)
    legs = np.zeros((2, 12))
    legs[0, :8] = [-0.4, 0.1, 0.0, 0.0, 0.3, 1.0, 1.1, 0.8]
    legs[1, :8] = [0.5, -0.2, math.cos(2.0), math.sin(2.0), 1.2, 0.0, 0.9, 1.3]
    inputs, load = np.array([0.7, -0.3]), np.array([2.0, -5.0])
    frames = make_frames(legs, inputs, load)
    angles = [0.3 + 0.7, 1.2]
    bases = [np.array([-0.4, 0.1]), np.array([0.5, -0.2]) - 0.3 * np.array([math.cos(2.0), math.sin(2.0)])]
    for _ in range(100):
        total, reach = np.zeros(4), np.zeros(4)
        expected = np.concatenate([-load, np.zeros(2)])
        for leg, sign in ((0, 1.0), (1, -1.0)):
            unit = rng.normal(size=(4, 4))
            unit[:, 3] = np.abs(unit[:, 3])
            s, t = rng.uniform(-1.0, 1.0, 2)
            value = unit[:, 0] + s * unit[:, 1] + t * unit[:, 2] + rng.uniform(-1.0, 1.0, 4) * unit[:, 3]
            out = np.zeros((4, 5))
            set_contribution(frames, leg, unit, out)
            total += out[:, 0] + s * out[:, 1] + t * out[:, 2]
            reach += out[:, 3]
            assert np.all(np.abs(out[:, 1]) + np.abs(out[:, 2]) + out[:, 3] <= out[:, 4])
            c, d = math.cos(angles[leg]), math.sin(angles[leg])
            turn = np.array([[c, -d], [d, c]])
            length, stiffness = legs[leg, 6], legs[leg, 7]
            expected[:2] += stiffness / length**2 * turn @ value[:2]
            expected[2:] += sign * (bases[leg] + length * turn @ value[2:])
        assert np.all(np.abs(total - expected) <= reach + 1e-12)
