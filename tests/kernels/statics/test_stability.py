"""Index and stiffness against a discretised energy, which knows neither elliptic functions nor how rods balance."""

import math
from collections import Counter
from typing import NamedTuple

import numpy as np
import pytest

from pcm_gym.kernels.statics.closure import evaluate_rods, make_workspace, set_inputs
from pcm_gym.kernels.statics.stability import assess_stability
from pcm_gym.mechanism import Leg, Mechanism, Revolute
from pcm_gym.solving import Equilibrium
from tests.reference import discrete_energy
from tests.reference.discrete_energy import DiscreteEnergy
from tests.reference.mechanisms import FAMILIES, find_equilibria, random_inputs, random_load, random_mechanism

# geometries per family, Newton starts per geometry, equilibria kept per geometry
SAMPLES = {"2RFR": (24, 150, 4), "2PFR": (24, 200, 4), "3PFR": (30, 3000, 3)}
# An eigenvalue below this (1 is a straight unloaded rod's) has no safe sign in a discretisation of 56 polynomials.
AMBIGUOUS = 1e-6
# Observed: 1e-10, in nearly straight rods with a stiffness of 1e7; the polynomials are good to 1e-12.
STIFFNESS_TOL = 1e-8


class Case(NamedTuple):
    family: str
    is_loaded: bool
    is_unequal: bool
    equilibrium: Equilibrium
    eigenvalues: np.ndarray  # of the discretised energy
    discrete_stiffness: np.ndarray
    pose_error: float


def judge(equilibrium: Equilibrium) -> tuple[np.ndarray, np.ndarray, float]:
    """Return eigenvalues, stiffness and distance of the pose from the discretised mechanism's own equilibrium."""
    discrete, inputs, load = DiscreteEnergy(equilibrium.mechanism), equilibrium.inputs, equilibrium.load
    z = discrete.solve(discrete.start(equilibrium), inputs, load)
    pose_error = float(np.abs(z[discrete.rods : discrete.free] - equilibrium.pose).max())
    return discrete.eigenvalues(z, inputs, load), discrete.stiffness(z, inputs, load), pose_error


@pytest.fixture(scope="module")
def cases() -> list[Case]:
    found = []
    for family in FAMILIES:
        rng = np.random.default_rng(2019)
        geometries, starts, kept = SAMPLES[family]
        for n in range(geometries):
            is_loaded, is_unequal = n % 2 == 0, n % 3 > 0
            mechanism = random_mechanism(family, rng, is_unequal=is_unequal)
            load = random_load(mechanism, rng) if is_loaded else np.zeros(mechanism.dof)
            equilibria = find_equilibria(mechanism, random_inputs(mechanism, rng), load, rng, starts)
            chosen = rng.permutation(len(equilibria))[:kept]
            found += [Case(family, is_loaded, is_unequal, equilibria[i], *judge(equilibria[i])) for i in chosen]
    return found


def describe(case: Case) -> str:
    return f"{case.equilibrium!r}, mechanism {case.equilibrium.mechanism!r}, inputs {case.equilibrium.inputs.tolist()}"


def test_sample_covers_what_it_should(cases: list[Case]) -> None:
    clear = [case for case in cases if np.abs(case.eigenvalues).min() > AMBIGUOUS]
    assert len(clear) >= 200
    assert len(clear) >= 0.98 * len(cases)
    kinds = Counter((case.family, case.is_loaded, case.is_unequal) for case in clear)
    assert len(kinds) == 12
    assert min(kinds.values()) >= 5
    assert {case.equilibrium.index for case in clear} >= {0, 1, 2, 3}
    unstable = [case for case in clear if case.equilibrium.index > 0]
    assert sum(np.linalg.eigvalsh(case.discrete_stiffness).min() > 0.0 for case in unstable) >= 10


def test_index_is_the_number_of_negative_eigenvalues(cases: list[Case]) -> None:
    """Including equilibria whose stiffness is positive definite though they are unstable."""
    wrong = [
        f"{int((case.eigenvalues < 0.0).sum())} negative: {describe(case)}"
        for case in cases
        if np.abs(case.eigenvalues).min() > AMBIGUOUS and (case.eigenvalues < 0.0).sum() != case.equilibrium.index
    ]
    assert wrong == []


def test_discretised_mechanism_rests_at_the_same_pose(cases: list[Case]) -> None:
    """So the states are equilibria by a second, independent set of equations. Newton stops at 1e-11."""
    for case in cases:
        assert case.pose_error < 1e-10, describe(case)


def test_stiffness_is_the_second_derivative_of_the_energy(cases: list[Case]) -> None:
    for case in cases:
        scale = np.abs(case.discrete_stiffness).max()
        error = np.abs(case.equilibrium.stiffness - case.discrete_stiffness).max()
        assert error < STIFFNESS_TOL * scale, describe(case)


def test_margin_is_the_least_eigenvalue_of_the_stiffness(cases: list[Case]) -> None:
    for case in cases:
        eigenvalues = np.linalg.eigvalsh(case.discrete_stiffness / case.equilibrium.mechanism.units.stiffness)
        tolerance = STIFFNESS_TOL * np.abs(eigenvalues).max()
        assert case.equilibrium.stability_margin == pytest.approx(eigenvalues.min(), abs=tolerance)


def test_discretisation_has_converged(cases: list[Case], monkeypatch: pytest.MonkeyPatch) -> None:
    """The judge judged: with half as many polynomials again, its eigenvalues nearest to zero stay the same."""
    hardest = max(cases, key=lambda case: max(rod.rho for rod in case.equilibrium.rods))
    try:
        monkeypatch.setattr(discrete_energy, "POLYNOMIALS", 84)
        monkeypatch.setattr(discrete_energy, "_NODES", 140)
        discrete_energy._basis.cache_clear()
        discrete_energy._curvatures.cache_clear()
        finer, _, _ = judge(hardest.equilibrium)
    finally:
        monkeypatch.undo()
        discrete_energy._basis.cache_clear()
        discrete_energy._curvatures.cache_clear()
    least = np.sort(np.abs(hardest.eigenvalues))[:3]
    np.testing.assert_allclose(np.sort(np.abs(finer))[:3], least, rtol=0.0, atol=0.1 * AMBIGUOUS)


class TestTruss:
    """Two straight rods that meet at an angle carry a load along themselves: textbook buckling decides."""

    CLAMPED_PINNED = (20.190728556426629, 59.679515944109014)

    @staticmethod
    def truss(compression: tuple[float, float]) -> Equilibrium:
        """Return the mechanism with both rods straight, with these compressive forces, in EI / L^2."""
        base_x, height = 0.6, 0.8
        mechanism = Mechanism("truss", tuple(Leg(Revolute((x, 0.0))) for x in (-base_x, base_x)))
        angle = math.atan2(height, base_x)
        directions = np.array([[base_x, height], [-base_x, height]])
        load = -compression[0] * directions[0] - compression[1] * directions[1]
        state = np.array([-compression[0], 0.0, -compression[1], 0.0, 0.0, height])
        return Equilibrium(mechanism, state, np.array([angle, math.pi - angle]), load)

    @pytest.mark.parametrize(
        ("compression", "index"),
        [
            ((0.0, 0.0), 0),
            ((-50.0, -3.0), 0),
            ((20.19, 20.19), 0),
            ((20.19, 20.2), 1),
            ((20.2, 20.2), 2),
            ((-100.0, 20.2), 1),
            ((59.67, 0.0), 1),
            ((59.69, 30.0), 3),
            ((59.69, 59.69), 4),
        ],
    )
    def test_index_counts_the_critical_loads_passed(self, compression: tuple[float, float], index: int) -> None:
        equilibrium = self.truss(compression)
        assert equilibrium.residual < 1e-14
        assert equilibrium.index == index
        discrete, inputs, load = DiscreteEnergy(equilibrium.mechanism), equilibrium.inputs, equilibrium.load
        z = discrete.start(equilibrium)
        assert np.abs(discrete.derivatives(z, inputs, load).gradient).max() < 1e-12
        assert (discrete.eigenvalues(z, inputs, load) < 0.0).sum() == index

    def test_index_changes_at_the_critical_load(self) -> None:
        """A straight rod is judged 1e-5 beside its pole, so its critical load is known to about that."""
        for critical in self.CLAMPED_PINNED:
            below, above = self.truss((critical * (1 - 3e-5), 0.0)), self.truss((critical * (1 + 3e-5), 0.0))
            assert above.index == below.index + 1

    @pytest.mark.parametrize("compression", [(0.0, 0.0), (-50.0, 3.0), (59.67, 0.0)])
    def test_everything_reported_of_straight_rods_is_a_number(self, compression: tuple[float, float]) -> None:
        """Their stiffness is infinite; what is reported must still be usable, and the motion's Jacobian exact."""
        equilibrium = self.truss(compression)
        assert np.isfinite(equilibrium.stiffness).all()
        assert np.isfinite([equilibrium.stability_margin, equilibrium.singularity_margin, equilibrium.energy]).all()
        assert equilibrium.energy == pytest.approx(float(-equilibrium.load @ equilibrium.pose), abs=1e-12)
        # two rigid links: turning one motor moves the tip not at all to first order unless the rod bends, so it stays
        jacobian = equilibrium.forward_jacobian
        assert np.isfinite(jacobian).all()
        np.testing.assert_allclose(jacobian, np.zeros((2, 2)), atol=1e-12)


@pytest.mark.parametrize(
    "state", [[0.0, 0.0, 0.0, 0.0, 0.0, 0.8], [-30.0, 0.0, 4.0, 0.0, 0.0, 0.8], [5.0, 1.0, -3.0, 0.0, 0.0, 0.8]]
)
def test_verdict_leaves_the_rod_table_as_it_was(state: list[float]) -> None:
    """At a pole rods are judged beside where they are; what is computed next must not see that."""
    mechanism = Mechanism("truss", tuple(Leg(Revolute((x, 0.0))) for x in (-0.6, 0.6)))
    angle, legs, x = math.atan2(0.8, 0.6), np.array(mechanism.leg_table), np.array(state)
    work = make_workspace(2, len(x))
    set_inputs(legs, np.array([angle, math.pi - angle]), work)
    evaluate_rods(legs, x, work)
    table = work.rods.copy()
    first = assess_stability(legs, x, work)
    np.testing.assert_array_equal(work.rods, table)
    np.testing.assert_array_equal(x, state)
    assert assess_stability(legs, x, work) == first
    assert math.isfinite(first.stability_margin)


def test_nan_is_neither_in_balance_nor_stable() -> None:
    """max() drops a nan and nan < 0 is false: neither may turn a broken state into a stable equilibrium."""
    mechanism = Mechanism("2RFR", tuple(Leg(Revolute((x, 0.0))) for x in (-0.2, 0.2)))
    for entry in range(mechanism.state_size):
        state = np.array([1.0, 2.0, 1.0, -2.0, 0.0, 0.9])
        state[entry] = math.nan
        broken = Equilibrium.unchecked(mechanism, state, np.array([2.0, 1.0]), np.zeros(2))
        assert not broken.residual < 1.0
        if entry < 4:  # the stiffness of a point end-effector does not depend on where it is
            assert not broken.is_stable
