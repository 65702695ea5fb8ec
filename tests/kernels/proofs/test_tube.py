"""Tubes: the equations and their derivatives along a piece hold those of the scalar code, at any place in the tube."""

import math

import numpy as np
import pytest

from pcm_gym.kernels.proofs.krawczyk import CARTESIAN, POLAR
from pcm_gym.kernels.proofs.tube import Tube, natural_size, new_tube, prove_tube, set_jacobian, set_values
from pcm_gym.kernels.statics.closure import new_workspace, place, set_matrix, set_residual
from pcm_gym.mechanism import Mechanism
from tests.reference.mechanisms import FAMILIES, random_inputs, random_load, random_mechanism, random_states

WIDTHS = (0.0, 1e-6, 1e-3)


def random_tube(mechanism: Mechanism, rng: np.random.Generator, width: float, *, is_slight: bool) -> Tube:
    """Return a tube with a curve through random states, equilibria or not; the first rod may be nearly unloaded."""
    leg_count, size = mechanism.leg_count, mechanism.state_size
    tube, length = new_tube(leg_count, size), 10.0 ** rng.uniform(-3.0, -1.5)
    x = random_states(mechanism, rng, 1)[0]
    for leg in range(leg_count):
        g = x[2 * leg : 2 * leg + 2]
        tube.curve[2 * leg : 2 * leg + 2, 0] = math.sqrt(math.hypot(*g)) + 0.4, math.atan2(-g[1], g[0])
    tube.curve[2 * leg_count :, 0] = x[2 * leg_count :]
    tube.charts[:] = POLAR
    natural = np.array([natural_size(tube, k) for k in range(size)])
    tube.radius[:] = width * natural * rng.uniform(0.1, 1.0, size)
    tube.curve[:, 1:] = length * natural[:, np.newaxis] * rng.uniform(-1.0, 1.0, (size, 3)) * [1.0, 0.3, 0.1]
    if is_slight:
        tube.charts[0] = CARTESIAN
        tube.curve[:2, 0] = rng.uniform(-0.2, 0.2, 2)
    inputs, load = random_inputs(mechanism, rng), random_load(mechanism, rng)
    tube.parameters[:, 0] = np.concatenate([inputs / mechanism.units.inputs, load / mechanism.units.load])
    tube.parameters[:, 1] = length * rng.uniform(-1.0, 1.0, len(tube.parameters))
    return tube


def at(rows: np.ndarray, s: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the polynomials' values and their remainders."""
    return rows[..., :4] @ [1.0, s, s**2, s**3], rows[..., 4]


def scalar_equations(mechanism: Mechanism, tube: Tube, z: np.ndarray, s: float) -> tuple[np.ndarray, np.ndarray]:
    """Return residual and Jacobian by the tube's unknowns from the scalar code."""
    x, chain, n = z.copy(), np.eye(len(z)), mechanism.leg_count
    for leg in np.flatnonzero(tube.charts == POLAR):
        k = slice(2 * leg, 2 * leg + 2)
        rho, b = z[k]
        x[k] = rho**2 * math.cos(b), -(rho**2) * math.sin(b)
        chain[k, k] = [
            [2.0 * rho * math.cos(b), -(rho**2) * math.sin(b)],
            [-2.0 * rho * math.sin(b), -(rho**2) * math.cos(b)],
        ]
    parameters, work = tube.parameters @ [1.0, s], new_workspace(n, len(z))
    place(mechanism.leg_table, x, parameters[:n], work)
    set_residual(mechanism.leg_table, x, parameters[n:], work)
    set_matrix(mechanism.leg_table, x, work)
    return work.residual.copy(), work.matrix[: len(z), : len(z)] @ chain


@pytest.mark.parametrize("is_slight", [False, True])
@pytest.mark.parametrize("width", WIDTHS)
@pytest.mark.parametrize("family", FAMILIES)
def test_equations_and_derivatives_hold_those_of_the_scalar_code(family: str, width: float, is_slight: bool) -> None:
    rng = np.random.default_rng(3)
    known = 0
    for _ in range(30):
        mechanism = random_mechanism(family, rng)
        tube = random_tube(mechanism, rng, width, is_slight=is_slight)
        set_values(mechanism.leg_table, tube)
        set_jacobian(mechanism.leg_table, tube)
        known += bool(tube.jacobian[..., 4].max() < 0.1 * np.abs(tube.jacobian[..., 0]).max())
        for s in (-1.0, 1.0, *rng.uniform(-1.0, 1.0, 3)):
            curve = tube.curve @ [1.0, s, s**2, s**3]
            residual, _ = scalar_equations(mechanism, tube, curve, s)
            values, rest = at(tube.values, s)
            assert not np.any(np.abs(residual - values) > rest + 1e-11 * (1.0 + np.abs(values).max()))
            side = rng.choice([-1.0, 0.0, 1.0], len(curve))
            _, jacobian = scalar_equations(mechanism, tube, curve + side * tube.radius, s)
            values, rest = at(tube.jacobian, s)
            assert not np.any(np.abs(jacobian - values) > rest + 1e-9 * (1.0 + np.abs(values).max()))
    assert known >= 20, "bounds that are only true prove nothing"


def test_a_curve_beside_the_branch_or_at_a_fold_is_not_proved() -> None:
    """Linear springs would be: here only what is far from an equilibrium is tried."""
    rng = np.random.default_rng(4)
    for family in FAMILIES:
        mechanism = random_mechanism(family, rng)
        for _ in range(20):
            tube = random_tube(mechanism, rng, 0.0, is_slight=False)
            assert not prove_tube(mechanism.leg_table, tube)[0]
