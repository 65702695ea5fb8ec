"""Newton's method: it converges quadratically, and each way of failing has its status."""

import math

import numpy as np
import pytest

from pcm_gym.kernels.statics import newton
from pcm_gym.kernels.statics.closure import make_workspace
from pcm_gym.kernels.statics.newton import NewtonRules, accept_correction, solve_forward_locally, solve_inverse_locally
from pcm_gym.solving import Equilibrium
from tests.reference.mechanisms import FAMILIES, home_by_construction, random_mechanism

LENIENT = NewtonRules(first_correction=math.inf, contraction=1e3, iterations=40)


class Problem:
    """A home equilibrium, and Newton from elsewhere."""

    def __init__(self, home: Equilibrium) -> None:
        mechanism = home.mechanism
        self.home = home
        self.legs = np.array(mechanism.leg_table)
        self.inputs = home.inputs / mechanism.units.inputs
        self.load = np.zeros(mechanism.dof)
        self.work = make_workspace(mechanism.leg_count, mechanism.state_size)

    def forward(self, x: np.ndarray, rules: NewtonRules) -> int:
        return solve_forward_locally(self.legs, self.inputs, self.load, x, rules, self.work)

    def inverse(self, x: np.ndarray, inputs: np.ndarray, rules: NewtonRules) -> int:
        return solve_inverse_locally(self.legs, inputs, self.load, x, rules, self.work)

    def shifted(self, size: float) -> np.ndarray:
        x = self.home.state.copy()
        return x + size * np.random.default_rng(4).uniform(-1.0, 1.0, len(x))


@pytest.fixture(params=FAMILIES)
def problem(request: pytest.FixtureRequest) -> Problem:
    return Problem(home_by_construction(request.param))


@pytest.mark.parametrize(
    ("size", "previous", "is_first", "verdict"),
    [
        (0.04, math.inf, True, newton.GOES_ON),
        (0.06, math.inf, True, newton.TOO_FAR),
        (0.06, math.inf, False, newton.GOES_ON),  # after a shortened correction there is none to compare with
        (0.01, 0.04, False, newton.DIVERGED),
        (0.008, 0.04, False, newton.GOES_ON),
        (9e-13, 1e-12, False, newton.GOES_ON),  # no contraction, but rounding
        (1e-6, 1e-2, False, newton.CONVERGED),
        (0.0, math.inf, True, newton.CONVERGED),
        (math.inf, math.inf, False, newton.DIVERGED),
        (math.nan, 0.04, False, newton.DIVERGED),
    ],
)
def test_a_correction_is_judged_by_size_and_contraction(
    size: float, previous: float, is_first: bool, verdict: int
) -> None:
    rules = NewtonRules(first_correction=0.05, contraction=0.2, iterations=8)
    assert accept_correction(size, previous, is_first, rules) == verdict


class TestForward:
    def test_finds_the_equilibrium_nearby(self, problem: Problem) -> None:
        x = problem.shifted(0.02)
        assert problem.forward(x, LENIENT) == newton.CONVERGED
        np.testing.assert_allclose(x, problem.home.state, rtol=0.0, atol=1e-9)

    def test_converges_quadratically(self, problem: Problem) -> None:
        """Each iteration doubles the digits: the error after the next is at most a constant times its square."""
        errors = []
        for iterations in (1, 2, 3):
            x = problem.shifted(0.02)
            problem.forward(x, LENIENT._replace(iterations=iterations))
            errors.append(np.abs(x - problem.home.state).max())
        assert errors[1] < 0.2 * errors[0]
        assert errors[2] < 1e3 * errors[1] ** 2 + 1e-10

    def test_too_far(self, problem: Problem) -> None:
        x = problem.shifted(0.5)
        before = x.copy()
        assert problem.forward(x, LENIENT._replace(first_correction=1e-3)) == newton.TOO_FAR
        np.testing.assert_array_equal(x, before)

    def test_diverged(self, problem: Problem) -> None:
        assert problem.forward(problem.shifted(0.3), LENIENT._replace(contraction=1e-9)) == newton.DIVERGED

    def test_iteration_limit(self, problem: Problem) -> None:
        assert problem.forward(problem.shifted(0.3), LENIENT._replace(iterations=1)) == newton.ITERATION_LIMIT

    def test_nan_is_never_called_converged(self, problem: Problem) -> None:
        for entry in range(len(problem.home.state)):
            for value in (math.nan, math.inf):
                x = problem.home.state.copy()
                x[entry] = value
                assert problem.forward(x, LENIENT) != newton.CONVERGED, (entry, value)

    def test_nan_in_load_or_inputs_is_never_called_converged(self, problem: Problem) -> None:
        for load, inputs in ((problem.load + math.nan, problem.inputs), (problem.load, problem.inputs + math.nan)):
            x = problem.home.state.copy()
            status = solve_forward_locally(problem.legs, inputs, load, x, LENIENT, problem.work)
            assert status != newton.CONVERGED

    def test_singular(self) -> None:
        """Two straight rods in one line: the tension between them is open."""
        legs = np.array(random_mechanism("2PFR", np.random.default_rng(0), is_unequal=False).leg_table)
        legs[:, 4] = 0.0
        x, work = np.zeros(6), make_workspace(2, 6)
        assert solve_forward_locally(legs, np.zeros(2), np.zeros(2), x, LENIENT, work) == newton.SINGULAR


class TestInverse:
    def test_finds_the_inputs_nearby(self, problem: Problem) -> None:
        x, inputs = problem.shifted(0.01), problem.inputs + 0.01
        pose = 2 * problem.home.mechanism.leg_count
        x[pose:] = problem.home.state[pose:]
        assert problem.inverse(x, inputs, LENIENT) == newton.CONVERGED
        np.testing.assert_allclose(inputs, problem.inputs, rtol=0.0, atol=1e-9)
        np.testing.assert_allclose(x, problem.home.state, rtol=0.0, atol=1e-8)

    def test_undoes_the_forward_solution(self, problem: Problem) -> None:
        x = problem.home.state.copy()
        pose = 2 * problem.home.mechanism.leg_count
        x[pose] += 0.003
        inputs = problem.inputs.copy()
        assert problem.inverse(x, inputs, LENIENT) == newton.CONVERGED
        again = x + 1e-3
        status = solve_forward_locally(problem.legs, inputs, problem.load, again, LENIENT, problem.work)
        assert status == newton.CONVERGED
        np.testing.assert_allclose(again, x, rtol=0.0, atol=1e-8)

    def test_each_failure_has_its_status(self, problem: Problem) -> None:
        cases = [
            (LENIENT._replace(first_correction=1e-3), newton.TOO_FAR),
            (LENIENT._replace(contraction=1e-9), newton.DIVERGED),
            (LENIENT._replace(iterations=1), newton.ITERATION_LIMIT),
        ]
        for rules, status in cases:
            assert problem.inverse(problem.shifted(0.1), problem.inputs + 0.1, rules) == status

    def test_singular(self) -> None:
        """Sliders along one line and unloaded straight rods along it: moving one slider strains nothing sideways."""
        legs = np.array(random_mechanism("2PFR", np.random.default_rng(0), is_unequal=False).leg_table)
        legs[:, 2:5] = [1.0, 0.0, 0.0]
        work, x = make_workspace(2, 6), np.zeros(6)
        assert solve_inverse_locally(legs, np.zeros(2), np.zeros(2), x, LENIENT, work) == newton.SINGULAR

    def test_nan_is_never_called_converged(self, problem: Problem) -> None:
        for entry in range(len(problem.home.state)):
            x, inputs = problem.home.state.copy(), problem.inputs.copy()
            x[entry] = math.nan
            assert problem.inverse(x, inputs, LENIENT) != newton.CONVERGED
