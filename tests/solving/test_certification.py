"""Proofs of completeness: against the solver's own sets, searches by others, and problems whose answer is known."""

import math
from dataclasses import replace

import numpy as np
import pytest

from pcm_gym.mechanism import Mechanism, Rod, get_mechanism
from pcm_gym.solving import BranchTracker, EquilibriumSet, Event, certification, solve_forward, solve_inverse
from pcm_gym.solving.certification import Certificate, certify_forward, certify_inverse
from pcm_gym.solving.search_frame import search_frame
from tests.reference.mechanisms import find_equilibria
from tests.solving.test_enumeration import Problem, largest_rho, two_motors, unmatched

RHO_MAX = 9.0
SEEDS = range(12)
FOUR_WIDE = two_motors(0.7)


def certified(case: Problem, rho_max: float = RHO_MAX) -> EquilibriumSet:
    return solve_forward(case.mechanism, case.inputs, case.load, rho_max, certify=True)


def certificate(found: EquilibriumSet) -> Certificate:
    assert found.certificate is not None
    return found.certificate


def certified_from(case: Problem, states: np.ndarray, rho_max: float = RHO_MAX) -> tuple[np.ndarray, Certificate]:
    """Prove what is complete when only these states are known."""
    units = case.mechanism.units
    return certify_forward(case.mechanism, case.inputs / units.inputs, case.load / units.load, rho_max, states)


def states_of(found: EquilibriumSet) -> np.ndarray:
    return np.array([e.state for e in found]).reshape(-1, 6)


def are_same(some: np.ndarray, others: np.ndarray) -> bool:
    return len(some) == len(others) and all(np.abs(others - state).max(axis=1).min() < 1e-7 for state in some)


class TestRandomProblems:
    """Motors and sliders at all angles, unequal rods, with and without loads."""

    @pytest.mark.parametrize("seed", SEEDS)
    def test_sets_are_proved_and_are_those_of_the_solver(self, seed: int) -> None:
        case = Problem(seed)
        found, plain = certified(case), case.forward()
        assert certificate(found).is_proved, certificate(found)
        assert certificate(found).proved_count == len(found) == len(plain)
        assert unmatched(found, plain) == []
        assert [e.energy for e in found] == sorted(e.energy for e in found)

    @pytest.mark.parametrize("rho_max", [0.3, 2.0, 5.0, 11.0])
    def test_in_other_ranges_of_loads(self, rho_max: float) -> None:
        for seed in range(2):
            case = Problem(seed)
            found = certified(case, rho_max)
            assert certificate(found).is_proved
            assert certificate(found).proved_count == len(found)
            assert unmatched(case.forward(rho_max), found) == []

    def test_sets_hold_what_a_search_from_random_starts_finds(self) -> None:
        for seed in SEEDS[:6]:
            case = Problem(seed)
            found = certified(case)
            searched = find_equilibria(case.mechanism, case.inputs, case.load, case.rng, rho_max=RHO_MAX)
            assert unmatched(searched, found) == []

    def test_equilibria_that_were_missed_are_found(self) -> None:
        for seed in SEEDS[:3]:
            states = states_of(case_set := certified(Problem(seed)))
            for known in (states[:0], states[1:], states[::2]):
                found, proof = certified_from(Problem(seed), known)
                assert proof.is_proved
                assert proof.proved_count == len(case_set)
                assert are_same(found, states)

    def test_what_is_no_equilibrium_or_one_twice_is_left_out(self) -> None:
        for seed in SEEDS[:3]:
            states = states_of(certified(Problem(seed)))
            false = states[:2] * 1.05
            found, proof = certified_from(Problem(seed), np.concatenate([states, false, states[:3] * (1.0 + 1e-13)]))
            assert proof.is_proved
            assert are_same(found, states)

    @pytest.mark.parametrize("seed", SEEDS)
    def test_states_that_are_wrong_on_purpose_never_come_back(self, seed: int) -> None:
        """One number of a state, a load or the pose, is wrong by 1e-7 to 1e-1 of 1 + its size."""
        rng = np.random.default_rng(seed)
        states = states_of(certified(Problem(seed)))
        for _ in range(10):
            wrong = states.copy()
            m, k = rng.integers(len(states)), rng.integers(6)
            wrong[m, k] += rng.choice([-1.0, 1.0]) * 10.0 ** rng.uniform(-7.0, -1.0) * (1.0 + abs(wrong[m, k]))
            found, proof = certified_from(Problem(seed), wrong)
            assert proof.is_proved
            assert proof.proved_count == len(states)
            assert not np.any(np.all(found == wrong[m], axis=1))
            assert are_same(found, states)

    @pytest.mark.parametrize("seed", SEEDS)
    def test_errors_of_states_are_bounded(self, seed: int) -> None:
        """States that are wrong by 1e-10 stay, and the bound holds their errors; those of the solver are better."""
        states = states_of(certified(Problem(seed)))
        errors = 1e-10 * np.random.default_rng(seed).choice([-1.0, 1.0], states.shape) * (1.0 + np.abs(states))
        found, proof = certified_from(Problem(seed), states + errors)
        assert all(np.any(np.all(found == state, axis=1)) for state in states + errors)
        assert 1e-10 * (1.0 - 1e-4) <= proof.error < 1e-5

    def test_equilibria_beyond_the_range_are_not_counted(self) -> None:
        for seed in SEEDS[:3]:
            found = certified(Problem(seed))
            inside, proof = certified_from(Problem(seed), states_of(found), rho_max=6.0)
            assert proof.is_proved
            assert proof.proved_count == len(inside) == sum(largest_rho(e) <= 6.0 for e in found)


class TestInverseProblems:
    """The same at a given pose: motors and sliders mixed, inputs unknown."""

    @staticmethod
    def proved_from(
        case: Problem, states: np.ndarray, inputs: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, Certificate]:
        units = case.mechanism.units
        pose, load = case.pose / units.pose, case.load / units.load
        return certify_inverse(case.mechanism, pose, load, RHO_MAX, states, inputs)

    @staticmethod
    def solved(case: Problem) -> tuple[EquilibriumSet, np.ndarray, np.ndarray]:
        found = solve_inverse(case.mechanism, case.pose, case.load, RHO_MAX, certify=True)
        inputs = np.array([e.inputs / case.mechanism.units.inputs for e in found]).reshape(-1, 2)
        return found, states_of(found), inputs

    def test_nearly_all_sets_are_proved_and_are_those_of_the_solver(self) -> None:
        proved = 0
        for seed in range(30):
            case = Problem(seed)
            found, plain = self.solved(case)[0], case.inverse()
            proved += certificate(found).is_proved
            assert unmatched(plain, found) == []
            if certificate(found).is_proved:
                assert certificate(found).proved_count == len(found) == len(plain)
                assert certificate(found).error < 1e-5
        assert proved >= 27

    def test_equilibria_that_were_missed_are_found(self) -> None:
        for seed in SEEDS[:6]:
            case = Problem(seed)
            whole, states, inputs = self.solved(case)
            for part in (slice(0, 0), slice(1, None), slice(0, None, 2)):
                found, own, proof = self.proved_from(case, states[part], inputs[part])
                assert proof.is_proved == certificate(whole).is_proved
                assert proof.proved_count == len(whole)
                assert are_same(found, states)
                for values in own:
                    turns = np.remainder(values - inputs + math.pi, 2.0 * math.pi) - math.pi
                    assert np.abs(turns).max(axis=1).min() < 1e-7

    @pytest.mark.parametrize("seed", SEEDS)
    def test_states_and_inputs_that_are_wrong_on_purpose_never_come_back(self, seed: int) -> None:
        """One number is wrong by 1e-7 to 1e-1 of 1 + its size: a load, the pose, or an input."""
        rng, case = np.random.default_rng(seed), Problem(seed)
        _, states, inputs = self.solved(case)
        for _ in range(5 if len(states) else 0):
            wrong = np.column_stack([states, inputs])
            m, k = rng.integers(len(states)), rng.integers(8)
            wrong[m, k] += rng.choice([-1.0, 1.0]) * 10.0 ** rng.uniform(-7.0, -1.0) * (1.0 + abs(wrong[m, k]))
            found, own, proof = self.proved_from(case, wrong[:, :6], wrong[:, 6:])
            assert not np.any(np.all(np.column_stack([found, own]) == wrong[m], axis=1))
            assert are_same(found, states)
            assert proof.error < 1e-5

    def test_a_pose_out_of_reach_has_proved_none(self) -> None:
        found = solve_inverse(FOUR_WIDE, (0.0, 1.5), certify=True)
        assert len(found) == certificate(found).proved_count == 0
        assert certificate(found).is_proved
        assert found.reason != ""

    def test_a_hinge_on_its_motor_is_never_proved(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """The rod then turns freely: a continuum."""
        monkeypatch.setattr(certification, "_MOST_EXAMINED", 5000)
        assert not certificate(solve_inverse(FOUR_WIDE, (0.35, 0.0), certify=True)).is_proved


class TestForeignUnits:
    """Mechanisms far from the origin, or with a reference rod unlike their own, are searched in a frame of its own."""

    @staticmethod
    def foreign(case: Problem, length: float, origin: np.ndarray) -> Mechanism:
        """The mechanism of a case moved, with a reference rod of this length."""
        legs = tuple(
            replace(leg, actuator=replace(leg.actuator, base=tuple(origin + leg.actuator.base)))
            for leg in case.mechanism.legs
        )
        return replace(case.mechanism, legs=legs, home_pose=None, reference=Rod(length, 1.0))

    @pytest.mark.parametrize(("length", "away"), [(0.01, 0.0), (50.0, 0.0), (1.0, 1000.0), (0.01, 1000.0)])
    def test_the_proof_is_that_of_the_mechanism_as_it_was(self, length: float, away: float) -> None:
        case, origin = Problem(1), np.array([away, -0.5 * away])
        foreign = self.foreign(case, length, origin)
        for plain, found in (
            (certified(case), solve_forward(foreign, case.inputs, case.load, RHO_MAX, certify=True)),
            (
                solve_inverse(case.mechanism, case.pose, case.load, RHO_MAX, certify=True),
                solve_inverse(foreign, case.pose + origin, case.load, RHO_MAX, certify=True),
            ),
        ):
            assert certificate(found).is_proved
            assert certificate(found).proved_count == certificate(plain).proved_count == len(found) > 0
            energies = np.array([e.energy for e in found]) + case.load @ origin  # the load's potential moves along
            np.testing.assert_allclose(energies, [e.energy for e in plain], rtol=1e-6)

    @pytest.mark.parametrize(("length", "away"), [(0.01, 0.0), (50.0, 0.0), (1.0, 1000.0), (0.01, 1000.0)])
    def test_errors_are_bounded_in_the_units_of_the_mechanism(self, length: float, away: float) -> None:
        """States of the search are moved by a known error, and then told as the mechanism's."""
        rng, error = np.random.default_rng(0), 1e-6
        frame = search_frame(self.foreign(Problem(1), length, np.array([away, -0.5 * away])))
        assert not frame.is_own
        searched = rng.normal(size=(500, 6)) * 10.0 ** rng.uniform(-3.0, 1.0, (500, 6))
        moved = searched + rng.choice([-1.0, 1.0], searched.shape) * error * (1.0 + np.abs(searched))
        states, others = frame.states(searched), frame.states(moved)
        largest = np.max(np.abs(states - others) / (1.0 + np.abs(states)))
        assert error * (1.0 - 1e-9) <= largest <= frame.state_error(error) * (1.0 + 1e-9)


class TestKnownProblems:
    def test_outside_counts(self) -> None:
        found = solve_forward(FOUR_WIDE, np.radians([45.0, 135.0]), rho_max=9.5, certify=True)
        assert certificate(found).proved_count == len(found) == 15
        found = solve_forward(two_motors(0.4), np.radians([120.0, 60.0]), rho_max=math.sqrt(51.0), certify=True)
        assert certificate(found).proved_count == len(found) == 7
        assert certificate(found).is_proved

    @pytest.mark.parametrize("away", [0.0, 1e-12, 1e-6, 1e-3, -1e-2])
    @pytest.mark.parametrize("force", [0.0, 3.0])
    def test_straight_rods(self, away: float, force: float) -> None:
        """Both rods unloaded, or in pure tension, and near that: exact solutions at the chart's borders."""
        angle = math.acos(0.35) + away
        found = solve_forward(FOUR_WIDE, [angle, math.pi - angle], (0.0, force), certify=True)
        assert certificate(found).is_proved, certificate(found)
        straight = [e for e in found if math.hypot(*(e.pose - [0.0, math.sin(math.acos(0.35))])) < 0.05]
        assert len(straight) >= 1
        assert away != 0.0 or any(abs(e.state[1]) < 1e-9 and abs(e.state[3]) < 1e-9 for e in straight)

    def test_clamps_too_far_apart_have_proved_none(self) -> None:
        found = solve_forward(two_motors(2.1), [0.0, math.pi], certify=True)
        assert len(found) == certificate(found).proved_count == 0
        assert certificate(found).is_proved
        assert found.reason != ""

    def test_an_equilibrium_at_the_border_of_the_range_is_undecided(self) -> None:
        inputs = np.radians([60.0, 120.0])
        whole = solve_forward(FOUR_WIDE, inputs, certify=True)
        outermost = max(whole, key=largest_rho)
        rho_max = largest_rho(outermost)
        twins = [e for e in whole if abs(largest_rho(e) - rho_max) < 1e-9]
        proof = certificate(solve_forward(FOUR_WIDE, inputs, rho_max=rho_max, certify=True))
        assert {region.reason for region in proof.undecided} == {"rho_max"}
        assert len(proof.undecided) == len(twins)
        assert proof.proved_count == len(whole) - len(twins)
        assert any(region.contains(outermost) for region in proof.undecided)
        for factor, count in ((1.0 + 1e-7, len(whole)), (1.0 - 1e-7, len(whole) - len(twins))):
            found = solve_forward(FOUR_WIDE, inputs, rho_max=factor * rho_max, certify=True)
            assert certificate(found).is_proved
            assert len(found) == count

    def test_a_continuum_is_never_proved(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """Opposite motors as far apart as both rods are long: straight, in any tension."""
        monkeypatch.setattr(certification, "_MOST_EXAMINED", 5000)
        proof = certificate(solve_forward(two_motors(2.0), [0.0, math.pi], certify=True))
        assert not proof.is_proved
        assert "limit" in {region.reason for region in proof.undecided}
        assert "limit" in repr(proof)


class TestFolds:
    """At folds that continuation finds, two equilibria are one."""

    START = np.radians([60.0, 120.0])
    DIRECTIONS = (np.array([1.0, -1.0]), np.array([1.0, 1.0]))

    @staticmethod
    def fold(start: tuple[float, float], direction: np.ndarray) -> np.ndarray:
        """Return the inputs at the fold that the equilibrium nearest to a pose comes to."""
        found = solve_forward(FOUR_WIDE, TestFolds.START)
        equilibrium = min(found, key=lambda e: float(np.linalg.norm(e.pose - start)))
        step = BranchTracker(FOUR_WIDE, equilibrium).step(TestFolds.START + 3.0 * direction)
        assert step.event == Event.FOLD
        return np.array(step.equilibrium.inputs)

    @pytest.mark.parametrize(("start", "direction"), [((0.0, -0.49), DIRECTIONS[0]), ((0.29, 0.18), DIRECTIONS[1])])
    def test_undecided_at_the_fold_and_proved_elsewhere(
        self, start: tuple[float, float], direction: np.ndarray
    ) -> None:
        inputs = self.fold(start, direction) + 1e-11 * direction  # tracking ends so little before it
        found = solve_forward(FOUR_WIDE, inputs, certify=True)
        proof = certificate(found)
        assert proof.status == "undecided"
        assert {region.reason for region in proof.undecided} == {"fold"}
        for region in proof.undecided:
            assert np.all(np.diff(region.rho) < 1e-3)
            assert np.all(np.diff(region.tip_angle) < 1e-3)
        open_ones = [e for e in found if any(region.contains(e) for region in proof.undecided)]
        assert len(open_ones) == len(found) - proof.proved_count
        assert all(e.singularity_margin < 1e-6 for e in open_ones)
        assert len(open_ones) <= 2  # whether the two that are one are found at all, rounding decides

    @pytest.mark.parametrize(("start", "direction"), [((0.0, -0.49), DIRECTIONS[0]), ((0.29, 0.18), DIRECTIONS[1])])
    @pytest.mark.parametrize("away", [1e-6, 1e-3])
    def test_proved_on_either_side(self, start: tuple[float, float], direction: np.ndarray, away: float) -> None:
        inputs = self.fold(start, direction)
        before = solve_forward(FOUR_WIDE, inputs - away * direction, certify=True)
        after = solve_forward(FOUR_WIDE, inputs + away * direction, certify=True)
        assert certificate(before).is_proved
        assert certificate(after).is_proved
        assert len(before) == len(after) + 2


class TestInterface:
    def test_no_certificate_unless_asked_for(self) -> None:
        assert solve_forward(FOUR_WIDE, [1.0, 2.0]).certificate is None

    def test_certificates_are_about_all_modes(self) -> None:
        whole = solve_forward(FOUR_WIDE, [1.0, 2.0], certify=True)
        some = solve_forward(FOUR_WIDE, [1.0, 2.0], modes=[1, 1], certify=True)
        assert certificate(some).proved_count == certificate(whole).proved_count == len(whole) > len(some) > 0

    def test_certificates_say_what_they_say(self) -> None:
        found = solve_forward(FOUR_WIDE, [1.0, 2.0], certify=True)
        assert repr(certificate(found)) == f"Certificate: proved, exactly {len(found)} equilibria with rho <= 9"

    def test_only_two_legs(self) -> None:
        platform = get_mechanism("3PFR-paper")
        assert platform.home_inputs is not None
        with pytest.raises(ValueError, match="certify is available for two legs, got 3"):
            solve_forward(platform, platform.home_inputs, certify=True)
        with pytest.raises(ValueError, match="certify is available for two legs, got 3"):
            solve_inverse(platform, (0.0, 0.0, 0.1), certify=True)
