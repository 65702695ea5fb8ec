"""Equilibria that others have computed: the numbers of the design, in L = EI = 1."""

import math

import numpy as np
import pytest

from pcm_gym.kernels.statics.closure import make_workspace
from pcm_gym.kernels.statics.newton import CONVERGED, NewtonRules, solve_inverse_locally
from pcm_gym.mechanism import Leg, Mechanism, Prismatic, Revolute, Rod, get_mechanism
from pcm_gym.solving import BranchTracker, Equilibrium, home_equilibrium
from tests.reference.discrete_energy import DiscreteEnergy
from tests.reference.mechanisms import FAMILIES, HOME_POSES, find_equilibria, home_by_construction

TWO_RFR = Mechanism("2RFR", tuple(Leg(Revolute((x, 0.0)), Rod(1.0, 1.0)) for x in (-0.2, 0.2)))
INPUTS = np.radians([120.0, 60.0])

# tip, R, modes, index
EQUILIBRIA = [
    ((0.0, 0.927501479), 2.404959, (1, 1), 0),
    ((0.0, -0.443475547), 14.789673, (1, 1), 0),
    ((0.026272874, 0.330587837), 38.595346, (1, 2), 1),
    ((-0.026272874, 0.330587837), 38.595346, (2, 1), 1),
    ((0.385319524, -0.193384712), 50.532178, (1, 2), 1),
    ((-0.385319524, -0.193384712), 50.532178, (2, 1), 1),
    ((0.0, 0.228129427), 49.187433, (2, 2), 2),
]


@pytest.fixture(scope="module")
def found() -> list[Equilibrium]:
    """Equilibria from 4,000 random starts of Newton's method."""
    return find_equilibria(TWO_RFR, INPUTS, np.zeros(2), np.random.default_rng(1), starts=4000, rho_max=8.0)


class TestTwoRFR:
    @pytest.mark.parametrize(("tip", "force", "modes", "index"), EQUILIBRIA)
    def test_equilibrium(
        self, found: list[Equilibrium], tip: tuple[float, float], force: float, modes: tuple[int, int], index: int
    ) -> None:
        matching = [e for e in found if np.abs(e.pose - tip).max() < 1e-6]
        assert len(matching) == 1
        equilibrium = matching[0]
        # the numbers are given to nine digits, mirrored ones alike up to the naming of the legs
        np.testing.assert_allclose(equilibrium.pose, tip, rtol=0.0, atol=1e-9)
        assert [math.hypot(*rod.force) for rod in equilibrium.rods] == pytest.approx([force, force], abs=1e-6)
        assert sorted(equilibrium.modes) == sorted(modes)
        assert equilibrium.index == index

    def test_mirror_images_swap_their_modes(self, found: list[Equilibrium]) -> None:
        for tip, *_ in EQUILIBRIA[2:6:2]:
            one, other = (next(e for e in found if np.abs(e.pose - [s * tip[0], tip[1]]).max() < 1e-6) for s in (1, -1))
            assert one.modes == other.modes[::-1]
            assert one.energy == pytest.approx(other.energy, rel=1e-12)

    def test_unstable_with_positive_definite_stiffness(self, found: list[Equilibrium]) -> None:
        """Why the index exists: a test on the stiffness alone would call such an equilibrium stable."""
        deceiving = [e for e in found if e.index > 0 and np.linalg.eigvalsh(e.stiffness).min() > 0.0]
        assert deceiving
        for equilibrium in deceiving:
            assert not equilibrium.is_stable
            discrete = DiscreteEnergy(TWO_RFR)
            z = discrete.solve(discrete.start(equilibrium), INPUTS, np.zeros(2))
            assert (discrete.eigenvalues(z, INPUTS, np.zeros(2)) < 0.0).sum() == equilibrium.index

    def test_inverse(self) -> None:
        """Tip to (0.3, 0.7), modes (1, 1): motors at 131.59066 and -22.99029 degrees."""
        home = home_by_construction("2RFR")
        tracker = BranchTracker(home.mechanism, home)
        approximate = tracker.step(np.radians([131.0, -23.0])).equilibrium
        x, inputs = np.array(approximate.state), np.array(approximate.inputs)
        x[4:] = 0.3, 0.7
        rules = NewtonRules(first_correction=math.inf, contraction=10.0, iterations=20)
        legs = np.array(home.mechanism.leg_table)
        assert solve_inverse_locally(legs, inputs, np.zeros(2), x, rules, make_workspace(2, 6)) == CONVERGED
        np.testing.assert_allclose(np.degrees(inputs), [131.59066, -22.99029], rtol=0.0, atol=5e-6)
        equilibrium = Equilibrium(home.mechanism, x, inputs, np.zeros(2))
        assert equilibrium.modes == (1, 1)
        assert equilibrium.index == 0


class TestHome:
    @pytest.mark.parametrize("name", FAMILIES)
    def test_is_the_one_that_the_design_names(self, name: str) -> None:
        home, expected = home_equilibrium(get_mechanism(f"{name}-paper")), home_by_construction(name)
        np.testing.assert_allclose(home.state, expected.state, rtol=0.0, atol=1e-8)
        assert home.is_stable
        np.testing.assert_array_equal(home.inputs, home.mechanism.home_inputs)
        assert home.residual < 1e-10

    @pytest.mark.parametrize("name", FAMILIES)
    def test_does_not_depend_on_the_units(self, name: str) -> None:
        home = home_equilibrium(get_mechanism(f"{name}-paper"))
        assert home.pose == pytest.approx(HOME_POSES[name], abs=4e-4)

    def test_is_the_same_every_time(self) -> None:
        one, other = home_equilibrium(get_mechanism("3PFR-paper")), home_equilibrium(get_mechanism("3PFR-paper"))
        np.testing.assert_array_equal(one.state, other.state)

    def test_of_the_3pfr(self) -> None:
        """Pose (0, 0, 0.161919), all rho 6.3588, least eigenvalue of K 56.94 at EI = L = 1."""
        home = home_equilibrium(get_mechanism("3PFR-paper"))
        np.testing.assert_allclose(home.pose, [0.0, 0.0, 0.161919], rtol=0.0, atol=5e-7)
        assert [rod.rho for rod in home.rods] == pytest.approx([6.3588] * 3, abs=5e-5)
        assert home.stability_margin == pytest.approx(56.94, abs=5e-3)
        assert home.index == 0

    def test_of_the_2pfr(self) -> None:
        home = home_equilibrium(get_mechanism("2PFR-paper"))
        np.testing.assert_allclose(home.pose, [0.0, 0.976], rtol=0.0, atol=5e-4)

    def test_without_a_named_pose_is_the_stable_one_of_least_energy(self) -> None:
        mechanism = Mechanism("mine", TWO_RFR.legs, home_inputs=tuple(INPUTS))
        np.testing.assert_allclose(home_equilibrium(mechanism).pose, [0.0, 0.927501479], rtol=0.0, atol=1e-9)

    def test_under_load_is_in_balance(self) -> None:
        mechanism = get_mechanism("2PFR-paper")
        load = np.array([0.1, -0.2])
        home = home_equilibrium(mechanism, load)
        np.testing.assert_array_equal(home.load, load)
        np.testing.assert_allclose(sum(rod.force for rod in home.rods), load, atol=1e-10)
        assert home.is_stable

    def test_that_cannot_exist_is_an_error(self) -> None:
        """Bases farther apart than the rods reach."""
        legs = tuple(Leg(Prismatic((x, 0.0), 0.0, 0.0), Rod(1.0, 1.0)) for x in (-3.0, 3.0))
        with pytest.raises(ValueError, match="'apart' has no stable equilibrium"):
            home_equilibrium(Mechanism("apart", legs))
