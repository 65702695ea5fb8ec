"""Residual and analytic Jacobians of the three families: against integrated rods, differences, and each other."""

import math

import numpy as np
import pytest

from pcm_gym.kernels.statics.closure import (
    Workspace,
    evaluate_rods,
    make_workspace,
    set_inputs,
    set_inverse_matrix,
    set_matrix,
    set_path_derivative,
    set_residual,
    solve_equilibrium_system,
)
from pcm_gym.mechanism import Mechanism, Revolute
from tests.reference.mechanisms import (
    FAMILIES,
    find_equilibria,
    random_inputs,
    random_load,
    random_mechanism,
    random_states,
)
from tests.reference.orders import central_difference_order
from tests.reference.rod_ode import integrate_rod


class Sample:
    """A random mechanism at a random state, which is no equilibrium: derivatives must hold everywhere."""

    def __init__(self, family: str, seed: int) -> None:
        rng = np.random.default_rng(seed)
        self.mechanism = random_mechanism(family, rng)
        units = self.mechanism.units
        self.legs = np.array(self.mechanism.leg_table)
        self.x = random_states(self.mechanism, rng, 1, rho_max=4.0)[0]
        self.inputs = random_inputs(self.mechanism, rng) / units.inputs
        self.load = random_load(self.mechanism, rng) / units.load
        self.input_rate = rng.normal(size=self.mechanism.leg_count)
        self.load_rate = rng.normal(size=self.mechanism.dof)
        self.size = len(self.x)
        self.pose = 2 * self.mechanism.leg_count

    def residual(self, x: np.ndarray, inputs: np.ndarray, load: np.ndarray) -> np.ndarray:
        work = self.prepared(x, inputs)
        set_residual(self.legs, x, load, work)
        return work.residual.copy()

    def prepared(self, x: np.ndarray, inputs: np.ndarray) -> Workspace:
        work = make_workspace(len(self.legs), self.size)
        set_inputs(self.legs, inputs, work)
        evaluate_rods(self.legs, x, work)
        return work


@pytest.fixture(params=[(family, seed) for family in FAMILIES for seed in range(4)], ids=lambda p: f"{p[0]}-{p[1]}")
def sample(request: pytest.FixtureRequest) -> Sample:
    return Sample(*request.param)


# Between truncation, which must show for an order to be fitted, and rounding, some 1e-14 / step.
STEPS = np.geomspace(1e-3, 1e-2, 5)


def check_order(order: float, least: float) -> None:
    assert order == pytest.approx(2.0, abs=0.1)
    assert least < 1e-4


class TestResidual:
    @pytest.mark.parametrize("family", FAMILIES)
    def test_is_zero_at_equilibria_of_integrated_rods(self, family: str) -> None:
        """The equations written out anew in SI units, with rods from the differential equation."""
        rng = np.random.default_rng(3)
        checked = 0
        for _ in range(6):
            mechanism = random_mechanism(family, rng)
            inputs, load = random_inputs(mechanism, rng), random_load(mechanism, rng)
            starts = 1500 if family == "3PFR" else 60
            for equilibrium in find_equilibria(mechanism, inputs, load, rng, starts, 6.0)[:3]:
                checked += 1
                closure, balance = written_out(mechanism, inputs, load, equilibrium.state, equilibrium.pose)
                # Newton stops at corrections of 1e-11; integration errs by some 1e-12
                assert np.abs(closure).max() < 1e-10
                forces = max(np.abs(rod.force).max() for rod in equilibrium.rods)
                assert np.abs(balance).max() < 1e-10 * (mechanism.units.force + forces)
                assert equilibrium.residual < 1e-10
        assert checked >= 6

    def test_agrees_with_integrated_rods_anywhere(self, sample: Sample) -> None:
        mechanism, units = sample.mechanism, sample.mechanism.units
        closure, balance = written_out(
            mechanism,
            sample.inputs * units.inputs,
            sample.load * units.load,
            sample.x,
            sample.x[sample.pose :] * units.pose,
        )
        expected = np.concatenate([closure.ravel() / units.length, balance / units.load])
        found = sample.residual(sample.x, sample.inputs, sample.load)
        np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-10)

    def test_reports_its_largest_errors(self, sample: Sample) -> None:
        work = sample.prepared(sample.x, sample.inputs)
        closure_error, force_error = set_residual(sample.legs, sample.x, sample.load, work)
        assert closure_error == np.abs(work.residual[: sample.pose]).max()
        largest = np.abs(work.rods[:, 2:4]).max()
        assert force_error == pytest.approx(np.abs(work.residual[sample.pose :]).max() / (1.0 + largest), rel=1e-15)


def written_out(
    mechanism: Mechanism, inputs: np.ndarray, load: np.ndarray, state: np.ndarray, pose: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return closure errors (legs, 2) in m and the balance (d,) in N and N m."""
    closure, balance = [], np.zeros(3)
    phi = pose[2] if mechanism.dof == 3 else 0.0
    for i, leg in enumerate(mechanism.legs):
        actuator, value = leg.actuator, inputs[i]
        base, angle = np.array(actuator.base), actuator.clamp_angle
        if isinstance(actuator, Revolute):
            angle += value
        else:
            base = base + value * np.array([math.cos(actuator.axis_angle), math.sin(actuator.axis_angle)])
        rod = integrate_rod(*state[2 * i : 2 * i + 2])
        tip = base + leg.rod.length * rotation(angle) @ rod.tip
        force = leg.rod.bending_stiffness / leg.rod.length**2 * rotation(angle) @ rod.force
        arm = rotation(phi) @ np.array(leg.attachment)
        closure.append(tip - pose[:2] - arm)
        balance += [*force, arm[0] * force[1] - arm[1] * force[0]]
    return np.array(closure), balance[: mechanism.dof] - load


def rotation(angle: float) -> np.ndarray:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s], [s, c]])


class TestJacobians:
    def test_by_state(self, sample: Sample) -> None:
        work = sample.prepared(sample.x, sample.inputs)
        set_matrix(sample.legs, sample.x, work)
        jacobian = work.matrix[: sample.size, : sample.size].copy()
        rng = np.random.default_rng(0)

        def residual(x: np.ndarray) -> np.ndarray:
            return sample.residual(x, sample.inputs, sample.load)

        for _ in range(3):
            direction = rng.normal(size=sample.size)
            order, least = central_difference_order(
                lambda x: sample.residual(x, sample.inputs, sample.load),
                sample.x,
                direction,
                jacobian @ direction,
                STEPS,
            )
            check_order(order, least)

    def test_by_each_unknown(self, sample: Sample) -> None:
        """Column by column, lest a wrong small entry hide behind large ones."""
        work = sample.prepared(sample.x, sample.inputs)
        set_matrix(sample.legs, sample.x, work)
        jacobian = work.matrix[: sample.size, : sample.size].copy()
        step = 1e-4
        for column, direction in enumerate(np.eye(sample.size)):
            ahead = sample.residual(sample.x + step * direction, sample.inputs, sample.load)
            behind = sample.residual(sample.x - step * direction, sample.inputs, sample.load)
            scale = 1.0 + np.abs(jacobian[:, column]).max()
            np.testing.assert_allclose((ahead - behind) / (2 * step), jacobian[:, column], rtol=0.0, atol=1e-6 * scale)

    def test_by_rods_and_inputs(self, sample: Sample) -> None:
        work = sample.prepared(sample.x, sample.inputs)
        set_inverse_matrix(sample.legs, sample.x, work)
        jacobian = work.matrix[: sample.size, : sample.size].copy()

        def residual(unknowns: np.ndarray) -> np.ndarray:
            x = np.concatenate([unknowns[: sample.pose], sample.x[sample.pose :]])
            return sample.residual(x, unknowns[sample.pose :], sample.load)

        at = np.concatenate([sample.x[: sample.pose], sample.inputs])
        direction = np.random.default_rng(1).normal(size=sample.size)
        check_order(*central_difference_order(residual, at, direction, jacobian @ direction, STEPS))

    def test_along_a_path_of_inputs_and_load(self, sample: Sample) -> None:
        work = sample.prepared(sample.x, sample.inputs)
        derivative = np.full(sample.size, np.nan)
        set_path_derivative(sample.legs, sample.x, sample.input_rate, sample.load_rate, work, derivative)

        def residual(s: np.ndarray) -> np.ndarray:
            return sample.residual(
                sample.x, sample.inputs + s[0] * sample.input_rate, sample.load + s[0] * sample.load_rate
            )

        if sample.mechanism.name != "2RFR":  # sliders enter linearly: differences are exact
            difference = residual(np.array([0.5])) - residual(np.array([-0.5]))
            np.testing.assert_allclose(difference, derivative, atol=1e-12)
            return
        check_order(*central_difference_order(residual, np.zeros(1), np.ones(1), derivative, STEPS))


class TestCondensedSolution:
    """Rods eliminated one by one must give what one dense system gives."""

    def test_equals_the_dense_solution(self, sample: Sample) -> None:
        work = sample.prepared(sample.x, sample.inputs)
        set_matrix(sample.legs, sample.x, work)
        dense = work.matrix[: sample.size, : sample.size].copy()
        right = np.random.default_rng(2).normal(size=sample.size)
        assert solve_equilibrium_system(sample.legs, sample.x, right, work)
        expected = np.linalg.solve(dense, -right)
        tolerance = 1e-15 * np.linalg.cond(dense) + 1e-12
        np.testing.assert_allclose(work.step, expected, rtol=0.0, atol=tolerance * np.abs(expected).max())

    @pytest.mark.parametrize("family", FAMILIES)
    @pytest.mark.parametrize("bend", [0.0, 1e-16, 1e-12, 1e-9, 1e-7, 1e-6, 1e-5, 1e-3])
    def test_holds_through_a_straight_rod(self, family: str, bend: float) -> None:
        """The rod's own stiffness has a pole there: condensation must give way to the dense system."""
        for seed in range(8):
            sample = Sample(family, seed)
            sample.x[0], sample.x[1] = 4.0, bend
            work = sample.prepared(sample.x, sample.inputs)
            set_matrix(sample.legs, sample.x, work)
            dense = work.matrix[: sample.size, : sample.size].copy()
            right = np.random.default_rng(seed).normal(size=sample.size)
            assert solve_equilibrium_system(sample.legs, sample.x, right, work)
            expected = np.linalg.solve(dense, -right)
            error = np.abs(work.step - expected).max() / np.abs(expected).max()
            # the pole's 1 / bend costs digits on the way to the dense system's side of the switch
            assert error < 1e-6, f"seed {seed}: {error:.1e}"

    def test_unloaded_parallel_rods_are_singular(self) -> None:
        """Two straight rods in one line leave the tension between them open."""
        legs = np.array(random_mechanism("2PFR", np.random.default_rng(0), is_unequal=False).leg_table)
        legs[:, 4] = 0.0  # both clamps along x
        work, x = make_workspace(2, 6), np.zeros(6)
        set_inputs(legs, np.zeros(2), work)
        evaluate_rods(legs, x, work)
        assert not solve_equilibrium_system(legs, x, np.ones(6), work)
