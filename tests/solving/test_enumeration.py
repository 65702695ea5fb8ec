"""All equilibria: against outside numbers, other searches, continuation, and themselves."""

import itertools
import math
from collections.abc import Sequence
from typing import Any, ClassVar

import numpy as np
import pytest

from pcm_gym.mechanism import Leg, Mechanism, Prismatic, Revolute, Rod, get_mechanism
from pcm_gym.solving import (
    BranchTracker,
    Equilibrium,
    EquilibriumSet,
    Event,
    home_equilibrium,
    solve_forward,
    solve_inverse,
)
from tests.reference.mechanisms import find_equilibria, find_inverse_equilibria

RHO_MAX = 9.0


def two_motors(distance: float) -> Mechanism:
    return Mechanism("2RFR", tuple(Leg(Revolute((x, 0.0)), Rod(1.0, 1.0)) for x in (-0.5 * distance, 0.5 * distance)))


class Problem:
    """A random two-legged mechanism, motors and sliders mixed, with inputs, a load and a pose to ask for."""

    def __init__(self, seed: int) -> None:
        rng = np.random.default_rng([2024, seed])
        self.seed = seed
        sides = -rng.uniform(0.1, 0.5), rng.uniform(0.1, 0.5)
        self.mechanism = Mechanism(f"random {seed}", tuple(self._leg(side, rng) for side in sides))
        self.inputs = np.array(
            [
                rng.uniform(-math.pi, math.pi) if isinstance(leg.actuator, Revolute) else rng.uniform(-0.4, 0.4)
                for leg in self.mechanism.legs
            ]
        )
        strength = (0.0, 3.0, 10.0)[seed % 3]
        self.load = strength * rng.normal(size=2) * self.mechanism.units.load
        self.pose = rng.uniform([-0.5, -0.5], [0.5, 1.0])
        self.rng = rng

    @staticmethod
    def _leg(x: float, rng: np.random.Generator) -> Leg:
        base = (x, rng.uniform(-0.2, 0.2))
        rod = Rod(float(rng.uniform(0.7, 1.4)), float(3.0 ** rng.uniform(-0.5, 0.5)))
        if rng.uniform() < 0.5:
            return Leg(Revolute(base, clamp_angle=rng.uniform(-1.0, 1.0)), rod)
        return Leg(Prismatic(base, rng.uniform(0.0, math.pi), rng.uniform(0.0, math.pi)), rod)

    def forward(self, rho_max: float = RHO_MAX, refinement: int = 0) -> Sequence[Equilibrium]:
        return solve_forward(self.mechanism, self.inputs, self.load, rho_max, refinement=refinement)

    def inverse(self, rho_max: float = RHO_MAX, refinement: int = 0) -> Sequence[Equilibrium]:
        return solve_inverse(self.mechanism, self.pose, self.load, rho_max, refinement=refinement)

    def __repr__(self) -> str:
        return f"Problem({self.seed}): {self.mechanism.legs}, {self.inputs=}, {self.load=}, {self.pose=}"


def gap(one: Equilibrium, other: Equilibrium) -> float:
    """Return how far two equilibria of a mechanism are apart: tips, forces relative to 1 + force, and inputs."""
    units = one.mechanism.units
    turns = np.array([isinstance(leg.actuator, Revolute) for leg in one.mechanism.legs])
    inputs = (one.inputs - other.inputs) / units.inputs
    inputs = np.where(turns, np.remainder(inputs + math.pi, 2.0 * math.pi) - math.pi, inputs)
    pose = (one.pose - other.pose) / units.pose
    if len(pose) == 3:
        pose[2] = math.remainder(pose[2], 2.0 * math.pi)
    forces = np.array([rod.force for rod in one.rods]) / units.force
    change = np.array([rod.force for rod in other.rods]) / units.force - forces
    return float(max(np.abs(pose).max(), np.abs(inputs).max(), np.abs(change).max() / (1.0 + np.abs(forces).max())))


def members(equilibrium: Equilibrium, found: Sequence[Equilibrium], tolerance: float = 1e-6) -> list[Equilibrium]:
    return [other for other in found if gap(equilibrium, other) < tolerance]


def both(case: Problem) -> list[Equilibrium]:
    return [*case.forward(), *case.inverse()]


def unmatched(some: Sequence[Equilibrium], others: Sequence[Equilibrium]) -> list[Equilibrium]:
    return [equilibrium for equilibrium in some if not members(equilibrium, others)]


def largest_rho(equilibrium: Equilibrium) -> float:
    return max(rod.rho for rod in equilibrium.rods)


def mirrored(found: Sequence[Equilibrium]) -> list[tuple[float, float, tuple[int, ...]]]:
    """Return tips and modes of the mirror images, left for right."""
    return [(-e.pose[0], e.pose[1], e.modes[::-1]) for e in found]


class TestOutsideNumbers:
    INPUTS = np.radians([120.0, 60.0])

    # tip, R, modes (of this or the mirrored naming of the legs), index
    FORWARD: ClassVar = [
        ((0.0, 0.927501479), 2.404959, (1, 1), 0),
        ((0.0, -0.443475547), 14.789673, (1, 1), 0),
        ((0.026272874, 0.330587837), 38.595346, (1, 2), 1),
        ((-0.026272874, 0.330587837), 38.595346, (1, 2), 1),
        ((0.385319524, -0.193384712), 50.532178, (1, 2), 1),
        ((-0.385319524, -0.193384712), 50.532178, (1, 2), 1),
        ((0.0, 0.228129427), 49.187433, (2, 2), 2),
    ]

    @pytest.mark.parametrize(("tip", "force", "modes", "index"), FORWARD)
    def test_forward(self, tip: tuple[float, float], force: float, modes: tuple[int, int], index: int) -> None:
        matching = [e for e in solve_forward(two_motors(0.4), self.INPUTS) if np.abs(e.pose - tip).max() < 1e-6]
        assert len(matching) == 1
        equilibrium = matching[0]
        np.testing.assert_allclose(equilibrium.pose, tip, rtol=0.0, atol=1e-9)
        assert [math.hypot(*rod.force) for rod in equilibrium.rods] == pytest.approx([force, force], abs=1e-6)
        assert sorted(equilibrium.modes) == sorted(modes)
        assert equilibrium.index == index

    def test_forward_has_no_others_up_to_rho_8(self) -> None:
        assert len(solve_forward(two_motors(0.4), self.INPUTS, rho_max=math.sqrt(51.0))) == len(self.FORWARD)

    def test_a_symmetric_mechanism_has_a_symmetric_set(self) -> None:
        for distance, angle in itertools.product((0.3, 0.7), (0.3, 1.2, 2.5)):
            found = solve_forward(two_motors(distance), [math.pi - angle, angle])
            for x, y, modes in mirrored(found):
                assert any(math.hypot(x - e.pose[0], y - e.pose[1]) < 1e-9 and e.modes == modes for e in found)

    def test_inverse(self) -> None:
        found = solve_inverse(two_motors(0.4), (0.3, 0.7))
        matching = [e for e in found if np.abs(np.degrees(e.inputs) - [131.59066, -22.99029]).max() < 1e-3]
        assert len(matching) == 1
        equilibrium = matching[0]
        np.testing.assert_allclose(np.degrees(equilibrium.inputs), [131.59066, -22.99029], rtol=0.0, atol=5e-6)
        np.testing.assert_allclose(equilibrium.pose, [0.3, 0.7], rtol=0.0, atol=1e-15)
        assert equilibrium.modes == (1, 1)
        assert equilibrium.index == 0

    def test_count_of_the_2rfr(self) -> None:
        found = solve_forward(two_motors(0.7), np.radians([45.0, 135.0]), rho_max=9.5)
        assert len(found) == 15
        assert sum(e.modes == (1, 1) for e in found) == 3
        assert sum(e.is_stable for e in found) == 3

    @pytest.mark.slow
    def test_count_of_the_3pfr(self) -> None:
        mechanism = get_mechanism("3PFR-paper")
        assert mechanism.home_inputs is not None
        found = solve_forward(mechanism, mechanism.home_inputs, rho_max=6.5)
        assert len(found) == 32
        assert sum(e.is_stable for e in found) == 6
        assert max(e.residual for e in found) < 1e-10
        assert max(largest_rho(e) for e in found) <= 6.5
        assert min(gap(one, other) for one, other in itertools.combinations(found, 2)) > 1e-6
        assert members(home_equilibrium(mechanism), found)
        assert [e.energy for e in found] == sorted(e.energy for e in found)
        # three equal legs: a third of a turn makes the set itself
        turn = np.array([[-0.5, -math.sqrt(0.75)], [math.sqrt(0.75), -0.5]])
        poses = np.array([e.pose for e in found])
        for x, y, phi in poses:
            differences = poses - [*(turn @ [x, y]), phi]
            differences[:, 2] = np.remainder(differences[:, 2] + math.pi, 2.0 * math.pi) - math.pi
            assert np.abs(differences).max(axis=1).min() < 1e-9


class TestSets:
    SEEDS = range(40)

    @pytest.mark.parametrize("problem", ["forward", "inverse"])
    def test_members(self, problem: str) -> None:
        count = 0
        for seed in self.SEEDS:
            case = Problem(seed)
            found = getattr(case, problem)()
            count += len(found)
            for equilibrium in found:
                assert equilibrium.residual < 1e-10, case
                assert largest_rho(equilibrium) <= RHO_MAX * (1.0 + 1e-12), case
                np.testing.assert_array_equal(equilibrium.load, case.load)
                if problem == "forward":
                    np.testing.assert_array_equal(equilibrium.inputs, case.inputs)
                else:
                    np.testing.assert_allclose(equilibrium.pose, case.pose, rtol=1e-14)
                    for leg, value in zip(case.mechanism.legs, equilibrium.inputs, strict=True):
                        assert isinstance(leg.actuator, Prismatic) or -math.pi < value <= math.pi
            assert [e.energy for e in found] == sorted(e.energy for e in found)
            for one, other in itertools.combinations(found, 2):
                assert gap(one, other) > 1e-7, case
        assert count > 5 * len(self.SEEDS)

    @pytest.mark.parametrize("problem", ["forward", "inverse"])
    def test_do_not_change_with_the_resolution(self, problem: str) -> None:
        for seed in self.SEEDS:
            case = Problem(seed)
            coarse, fine = (getattr(case, problem)(refinement=refinement) for refinement in (0, 1))
            assert unmatched(fine, coarse) == [], case
            assert unmatched(coarse, fine) == [], case
            assert len(coarse) == len(fine), case

    @pytest.mark.parametrize("problem", ["forward", "inverse"])
    def test_grow_with_the_range_of_loads(self, problem: str) -> None:
        for seed in self.SEEDS[:20]:
            case = Problem(seed)
            wide = getattr(case, problem)(rho_max=12.0)
            for rho_max in (3.0, 6.0, 9.0):
                narrow = getattr(case, problem)(rho_max=rho_max)
                expected = [e for e in wide if largest_rho(e) <= rho_max]
                assert unmatched(narrow, expected) == [], case
                assert unmatched(expected, narrow) == [], case

    def test_are_the_same_every_time(self) -> None:
        for seed in self.SEEDS[:5]:
            case = Problem(seed)
            for one, other in zip(both(case), both(case), strict=True):
                np.testing.assert_array_equal(one.state, other.state)
                np.testing.assert_array_equal(one.inputs, other.inputs)

    def test_of_some_modes_are_those_of_all_that_have_them(self) -> None:
        for seed in self.SEEDS[:10]:
            case = Problem(seed)
            found, back = case.forward(), case.inverse()
            choices: list[Any] = [[1, 1], [1, {1, 2, 3}], [{2}, [1, 2]], (np.int64(2), (2, 3)), [{4}, {1}]]
            for modes in choices:
                allowed = [
                    {int(mode)} if np.ndim(mode) == 0 and not isinstance(mode, set) else set(mode) for mode in modes
                ]
                for everything, some in (
                    (found, solve_forward(case.mechanism, case.inputs, case.load, RHO_MAX, modes)),
                    (back, solve_inverse(case.mechanism, case.pose, case.load, RHO_MAX, modes)),
                ):
                    expected = [e for e in everything if e.modes[0] in allowed[0] and e.modes[1] in allowed[1]]
                    assert [e.state.tolist() for e in some] == [e.state.tolist() for e in expected]

    def test_scale_with_the_units(self) -> None:
        """The same mechanism in other units of length and force."""
        length, stiffness = 0.037, 512.0
        force = stiffness / length**2
        for seed in self.SEEDS[:10]:
            case = Problem(seed)
            legs = []
            for leg in case.mechanism.legs:
                actuator, base = leg.actuator, tuple(length * np.array(leg.actuator.base))
                rod = Rod(length * leg.rod.length, stiffness * leg.rod.bending_stiffness)
                if isinstance(actuator, Revolute):
                    legs.append(Leg(Revolute(base, clamp_angle=actuator.clamp_angle), rod))
                else:
                    legs.append(Leg(Prismatic(base, actuator.axis_angle, actuator.clamp_angle), rod))
            scaled = Mechanism("scaled", tuple(legs))
            turns = np.array([isinstance(leg.actuator, Revolute) for leg in legs])
            scale = np.where(turns, 1.0, length)
            for before, after in (
                (case.forward(), solve_forward(scaled, scale * case.inputs, force * case.load, RHO_MAX)),
                (case.inverse(), solve_inverse(scaled, length * case.pose, force * case.load, RHO_MAX)),
            ):
                assert len(before) == len(after)
                for one, other in zip(before, after, strict=True):
                    np.testing.assert_allclose(other.pose, length * one.pose, rtol=0.0, atol=1e-9 * length)
                    np.testing.assert_allclose(other.inputs, scale * one.inputs, rtol=0.0, atol=1e-8)
                    assert other.energy == pytest.approx(one.energy * stiffness / length, rel=1e-8)
                    assert (other.index, other.modes) == (one.index, one.modes)

    def test_turn_with_the_mechanism(self) -> None:
        """The same mechanism seen from elsewhere: the cells lie differently, the set does not."""
        angle, shift = 0.83, np.array([0.3, -1.7])
        turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
        for seed in self.SEEDS[:20]:
            case = Problem(seed)
            legs = []
            for leg in case.mechanism.legs:
                actuator, base = leg.actuator, tuple(turn @ leg.actuator.base + shift)
                if isinstance(actuator, Revolute):
                    legs.append(Leg(Revolute(base, clamp_angle=actuator.clamp_angle + angle), leg.rod))
                else:
                    axis, clamp = actuator.axis_angle + angle, actuator.clamp_angle + angle
                    legs.append(Leg(Prismatic(base, axis, clamp), leg.rod))
            moved = Mechanism("moved", tuple(legs))
            for before, after in (
                (case.forward(), solve_forward(moved, case.inputs, turn @ case.load, RHO_MAX)),
                (case.inverse(), solve_inverse(moved, turn @ case.pose + shift, turn @ case.load, RHO_MAX)),
            ):
                assert len(before) == len(after), case
                for one in before:
                    pose = turn @ one.pose + shift
                    matching = [e for e in after if np.abs(e.pose - pose).max() < 1e-7 and e.modes == one.modes]
                    assert [e for e in matching if np.abs(e.inputs - one.inputs).max() < 1e-6], case

    def test_at_poses_near_a_motor(self) -> None:
        """There a small shift of the tip turns the motor far."""
        for seed in range(10):
            rng = np.random.default_rng([7, seed])
            mechanism = two_motors(0.4)
            away, angle = 10.0 ** rng.uniform(-3.0, -1.0), rng.uniform(-math.pi, math.pi)
            pose = np.array([-0.2 + away * math.cos(angle), away * math.sin(angle)])
            coarse, fine = (solve_inverse(mechanism, pose, refinement=refinement) for refinement in (0, 1))
            assert unmatched(fine, coarse) == [], pose
            assert unmatched(coarse, fine) == [], pose


class TestForwardAndInverse:
    """Two problems, solved by different equations, with one set of states."""

    SEEDS = range(100, 112)

    def test_inverse_finds_what_forward_found(self) -> None:
        for seed in self.SEEDS:
            case = Problem(seed)
            for equilibrium in case.forward():
                back = solve_inverse(case.mechanism, equilibrium.pose, case.load, RHO_MAX + 1e-6)
                assert len(members(equilibrium, back)) == 1, (case, equilibrium)
                (same,) = members(equilibrium, back)
                assert (same.index, same.modes) == (equilibrium.index, equilibrium.modes)

    def test_forward_finds_what_inverse_found(self) -> None:
        for seed in self.SEEDS:
            case = Problem(seed)
            for equilibrium in case.inverse():
                back = solve_forward(case.mechanism, equilibrium.inputs, case.load, RHO_MAX + 1e-6)
                assert len(members(equilibrium, back)) == 1, (case, equilibrium)
                (same,) = members(equilibrium, back)
                assert (same.index, same.modes) == (equilibrium.index, equilibrium.modes)

    def test_inverse_of_the_3pfr_knows_its_home(self) -> None:
        home = home_equilibrium(get_mechanism("3PFR-paper"))
        found = solve_inverse(home.mechanism, home.pose, rho_max=7.0)
        assert len(members(home, found)) == 1
        assert max(e.residual for e in found) < 1e-10
        assert min(gap(one, other) for one, other in itertools.combinations(found, 2)) > 1e-6
        finer = solve_inverse(home.mechanism, home.pose, rho_max=7.0, refinement=1)
        assert unmatched(finer, found) == []
        assert unmatched(found, finer) == []


class TestOtherSearches:
    """Newton's method from random states, which knows nothing of cells."""

    def test_forward(self) -> None:
        count = 0
        for seed in range(200, 220):
            case = Problem(seed)
            others = find_equilibria(case.mechanism, case.inputs, case.load, case.rng, 30000, RHO_MAX - 1e-6)
            found = case.forward()
            count += len(found)
            assert unmatched(others, found) == [], case
            assert len(others) >= 0.3 * len(found), case
        assert count >= 100

    def test_inverse(self) -> None:
        count = 0
        for seed in range(200, 220):
            case = Problem(seed)
            others = find_inverse_equilibria(case.mechanism, case.pose, case.load, case.rng, 30000, RHO_MAX - 1e-6)
            found = case.inverse()
            count += len(found)
            assert unmatched(others, found) == [], case
            assert len(others) >= 0.3 * len(found), case
        assert count >= 60


class TestContinuation:
    def test_around_closed_loops(self) -> None:
        """Wherever a branch goes, what it meets is in the set, also where it does not come back to its start."""
        corners_met = 0
        for seed in range(300, 312):
            case = Problem(seed)
            size = 0.5 * np.where([isinstance(leg.actuator, Revolute) for leg in case.mechanism.legs], 1.0, 0.4)
            corners = [case.inputs + size * np.array(c) for c in ((1.0, 0.2), (0.8, 1.0), (-0.3, 0.7), (0.0, 0.0))]
            sets = [solve_forward(case.mechanism, corner, case.load, RHO_MAX) for corner in corners]
            wide = unlimited(case.mechanism)
            for start in sets[-1]:
                tracker = BranchTracker(wide, of(wide, start), follow_index_changes=True)
                for corner, found in zip(corners, sets, strict=True):
                    step = tracker.step(corner)
                    assert step.event in (Event.NONE, Event.FOLD), (case, start)
                    if step.event == Event.FOLD:
                        break
                    if largest_rho(step.equilibrium) > RHO_MAX - 1e-6:
                        continue
                    corners_met += 1
                    assert len(members(step.equilibrium, found)) == 1, (case, start, corner)
        assert corners_met >= 200

    def test_sweeps(self) -> None:
        """What becomes of every member when an input moves: it is in the set at the other end, or it has folded.

        Across each fold the set changes by two, whose indices differ by one.
        """
        folds = moved = 0
        for seed in range(400, 424):
            case = Problem(seed)
            leg = seed % 2
            target = case.inputs.copy()
            target[leg] += 1.0 if isinstance(case.mechanism.legs[leg].actuator, Revolute) else 0.3
            start, end = case.forward(), solve_forward(case.mechanism, target, case.load, RHO_MAX)
            for found, others, ends in ((start, end, (case.inputs, target)), (end, start, (target, case.inputs))):
                reached, folded = follow_all(found, ends[1])
                inside = [e for e in reached if largest_rho(e) < RHO_MAX - 1e-6]
                assert all(len(members(e, others)) == 1 for e in inside), case
                assert all(len(members(e, inside)) == 1 for e in inside), case
                moved += len(inside)
                for fraction, fold in folded:
                    if largest_rho(fold) < RHO_MAX - 0.2:
                        folds += 1
                        self.check_fold(fold, ends[0], ends[1], fraction)
        assert moved >= 250
        assert folds >= 60

    @staticmethod
    def check_fold(fold: Equilibrium, start: np.ndarray, target: np.ndarray, fraction: float) -> None:
        width, message = 1e-5, f"{fold}, {fraction} of the way from {start.tolist()} to {target.tolist()}"
        before, after = (
            [
                e
                for e in solve_forward(fold.mechanism, start + s * (target - start), fold.load, RHO_MAX + 1.0)
                if largest_rho(e) < RHO_MAX
            ]
            for s in (fraction - width, fraction + width)
        )
        assert len(before) == len(after) + 2, message
        after_poses = np.array([e.pose for e in after])
        twins = sorted(before, key=lambda e: float(np.linalg.norm(e.pose - fold.pose)))[:2]
        assert abs(twins[0].index - twins[1].index) == 1, message
        assert fold.index in (twins[0].index, twins[1].index), message
        others = [e for e in before if e not in twins]
        for index in range(5):
            assert sum(e.index == index for e in others) == sum(e.index == index for e in after), message
        for other in others:
            assert np.abs(after_poses - other.pose).max(axis=1).min() < 0.02, message


def unlimited(mechanism: Mechanism) -> Mechanism:
    """Return the mechanism with limits so wide that nothing meets them."""
    legs = []
    for leg in mechanism.legs:
        actuator = leg.actuator
        if isinstance(actuator, Revolute):
            legs.append(Leg(Revolute(actuator.base, clamp_angle=actuator.clamp_angle, limits=(-30.0, 30.0)), leg.rod))
        else:
            axis, clamp = actuator.axis_angle, actuator.clamp_angle
            legs.append(Leg(Prismatic(actuator.base, axis, clamp, limits=(-30.0, 30.0)), leg.rod))
    return Mechanism(mechanism.name, tuple(legs))


def of(mechanism: Mechanism, equilibrium: Equilibrium) -> Equilibrium:
    return Equilibrium(mechanism, equilibrium.state, equilibrium.inputs, equilibrium.load)


def follow_all(
    starts: Sequence[Equilibrium], target: np.ndarray
) -> tuple[list[Equilibrium], list[tuple[float, Equilibrium]]]:
    """Return the equilibria reached at the target, and (fraction, state at the fold) of those that folded."""
    reached, folded = [], []
    for start in starts:
        wide = unlimited(start.mechanism)
        step = BranchTracker(wide, of(wide, start), follow_index_changes=True).step(target)
        assert step.event in (Event.NONE, Event.FOLD), (start, step.event, step.fraction)
        if step.event == Event.NONE:
            reached.append(step.equilibrium)
        else:
            folded.append((step.fraction, step.equilibrium))
    return reached, folded


def near_fold(fold: Equilibrium, inputs: np.ndarray) -> list[Equilibrium]:
    return members(fold, solve_forward(fold.mechanism, inputs, fold.load, RHO_MAX), tolerance=0.02)


def exact_fraction(fold: Equilibrium, start: np.ndarray, rate: np.ndarray, fraction: float) -> float:
    """Return the fraction of the fold, exact to rounding.

    The squared distance of the twins falls linearly, but for terms of higher order, to zero there.
    """
    for gaps in np.array([[1e-6, 2e-6, 3e-6], [1e-9, 2e-9, 3e-9]]):
        squares = []
        for size in gaps:
            twins = near_fold(fold, start + (fraction - size) * rate)
            assert len(twins) == 2, (fold, size)
            assert abs(twins[0].index - twins[1].index) == 1
            squares.append(float(((twins[0].pose - twins[1].pose) ** 2).sum()))
        by_square = np.polynomial.Polynomial.fit(np.array(squares) / squares[-1], gaps, 2)
        fraction = float(fraction - by_square(0.0))
    return fraction


@pytest.fixture(scope="module")
def folds() -> list[tuple[Equilibrium, np.ndarray, np.ndarray]]:
    """Return folds with the inputs there and the inputs' rate, one per mechanism."""
    found = []
    for seed in range(500, 530):
        case = Problem(seed)
        leg = seed % 2
        rate = np.zeros(2)
        rate[leg] = 1.5 if isinstance(case.mechanism.legs[leg].actuator, Revolute) else 0.5
        wide = unlimited(case.mechanism)
        for start in case.forward():
            step = BranchTracker(wide, of(wide, start), follow_index_changes=True).step(case.inputs + rate)
            if step.event == Event.FOLD and largest_rho(step.equilibrium) < 0.9 * RHO_MAX:
                fraction = exact_fraction(step.equilibrium, case.inputs, rate, step.fraction)
                found.append((step.equilibrium, case.inputs + fraction * rate, rate))
                break
    assert len(found) >= 20
    return found


class TestTwins:
    """The two states that meet at a fold, just before it, and nothing just beyond it."""

    @pytest.mark.parametrize("size", [1e-6, 1e-8, 1e-9, 1e-10, 1e-11, 1e-12])
    def test_are_both_found(self, folds: list[tuple[Equilibrium, np.ndarray, np.ndarray]], size: float) -> None:
        """At 1e-12 of the way from the fold the twins are 1e-6 apart."""
        distances = []
        for fold, inputs, rate in folds:
            twins = near_fold(fold, inputs - size * rate)
            assert len(twins) == 2, (fold, inputs, size)
            assert abs(twins[0].index - twins[1].index) == 1
            assert max(twin.residual for twin in twins) < 1e-10
            distances.append(np.abs(twins[0].pose - twins[1].pose).max())
        assert np.median(distances) == pytest.approx(math.sqrt(size), rel=0.7)

    @pytest.mark.parametrize("size", [1e-12, 1e-10, 1e-8])
    def test_are_gone_beyond_the_fold(
        self, folds: list[tuple[Equilibrium, np.ndarray, np.ndarray]], size: float
    ) -> None:
        for fold, inputs, rate in folds:
            assert near_fold(fold, inputs + size * rate) == [], (fold, inputs, size)


class TestMisuse:
    MECHANISM = two_motors(0.4)

    @pytest.mark.parametrize(
        ("inputs", "message"),
        [
            ([1.0], r"inputs must have shape \(2,\)"),
            ([1.0, 2.0, 3.0], r"inputs must have shape \(2,\)"),
            (1.0, r"inputs must have shape \(2,\)"),
            ([1.0, math.nan], "inputs must be finite"),
            ([-math.inf, 1.0], "inputs must be finite"),
        ],
    )
    def test_bad_inputs(self, inputs: Any, message: str) -> None:
        with pytest.raises(ValueError, match=message):
            solve_forward(self.MECHANISM, inputs)

    @pytest.mark.parametrize(
        ("pose", "message"),
        [
            ([0.0, 0.5, 0.0], r"pose must have shape \(2,\)"),
            ([], r"pose must have shape \(2,\)"),
            ([math.nan, 0.5], "pose must be finite"),
            ([0.0, math.inf], "pose must be finite"),
        ],
    )
    def test_bad_pose(self, pose: Any, message: str) -> None:
        with pytest.raises(ValueError, match=message):
            solve_inverse(self.MECHANISM, pose)

    def test_arguments_that_are_no_numbers(self) -> None:
        with pytest.raises(TypeError, match="inputs must be 2 numbers"):
            solve_forward(self.MECHANISM, ["left", "right"])
        with pytest.raises(TypeError, match="pose must be 2 numbers"):
            solve_inverse(self.MECHANISM, ["here", "there"])
        wrong: Any = "far"
        with pytest.raises(TypeError, match="rho_max must be a number"):
            solve_forward(self.MECHANISM, [2.0, 1.0], rho_max=wrong)
        wrong = 0.5
        with pytest.raises(TypeError, match="refinement must be a whole number"):
            solve_forward(self.MECHANISM, [2.0, 1.0], refinement=wrong)

    @pytest.mark.parametrize("is_inverse", [False, True])
    @pytest.mark.parametrize(
        ("arguments", "message"),
        [
            ({"load": [1.0]}, r"load must have shape \(2,\)"),
            ({"load": [1.0, 0.0, 0.0]}, r"load must have shape \(2,\)"),
            ({"load": [math.nan, 0.0]}, "load must be finite"),
            ({"rho_max": 0.0}, "rho_max must be greater than 0"),
            ({"rho_max": -1.0}, "rho_max must be greater than 0"),
            ({"rho_max": math.nan}, "rho_max must be finite"),
            ({"rho_max": math.inf}, "rho_max must be finite"),
            ({"rho_max": 30.5}, "rho_max must be at most 30"),
            ({"modes": [1]}, "modes must have one entry per rod, 2"),
            ({"modes": [1, 1, 1]}, "modes must have one entry per rod, 2"),
            ({"modes": [0, 1]}, "modes must be at least 1"),
            ({"modes": [{1, -2}, 1]}, "modes must be at least 1"),
            ({"refinement": -1}, "refinement must be at least 0"),
            ({"refinement": 3}, "refinement must be at most 2"),
        ],
    )
    def test_bad_options(self, arguments: dict, message: str, is_inverse: bool) -> None:
        solve = solve_inverse if is_inverse else solve_forward
        with pytest.raises(ValueError, match=message):
            solve(self.MECHANISM, [0.1, 0.5], **arguments)

    @staticmethod
    def assert_empty(found: EquilibriumSet, reason: str) -> None:
        assert len(found) == 0
        assert reason in found.reason
        assert reason in repr(found)

    @pytest.mark.parametrize("pose", [(5.0, 0.0), (0.0, 1.2), (0.0, -1.0), (1e6, 1e6)])
    def test_pose_out_of_reach(self, pose: tuple[float, float]) -> None:
        self.assert_empty(solve_inverse(self.MECHANISM, pose), "from its actuator and the rod is 1 long")

    def test_pose_beyond_the_rods_of_sliders(self) -> None:
        found = solve_inverse(get_mechanism("2PFR-paper"), (3.0, 0.0))
        self.assert_empty(found, "the hinge of leg 0 is 3.2 from its actuator and the rod is 1 long")

    def test_pose_of_a_platform_out_of_reach(self) -> None:
        found = solve_inverse(get_mechanism("3PFR-paper"), (5.0, 0.0, 0.0), rho_max=7.0)
        self.assert_empty(found, "from its actuator and the rod is 1 long")

    def test_bases_too_far_apart(self) -> None:
        found = solve_forward(two_motors(2.5), [0.0, math.pi])
        self.assert_empty(found, "the clamps of legs 0 and 1 are 2.5 apart and their rods reach 2")

    def test_range_too_small(self) -> None:
        found = solve_forward(self.MECHANISM, TestOutsideNumbers.INPUTS, rho_max=1.0)
        self.assert_empty(found, "no equilibrium has all rods' rho <= 1")

    def test_modes_that_no_solution_has(self) -> None:
        found = solve_forward(self.MECHANISM, TestOutsideNumbers.INPUTS, modes=[7, 7])
        self.assert_empty(found, "equilibria is in the modes asked for")

    def test_a_set_with_members_needs_no_reason(self) -> None:
        found = solve_forward(self.MECHANISM, TestOutsideNumbers.INPUTS)
        assert found.reason == ""
        assert repr(found[0]) in repr(found)
        assert found[1:3] == tuple(found)[1:3]
        assert found.stable == tuple(equilibrium for equilibrium in found if equilibrium.index == 0)

    def test_arguments_are_left_alone(self) -> None:
        inputs, pose, load = np.array([2.0, 1.0]), np.array([0.1, 0.6]), np.array([0.3, -0.4])
        modes: list[int | set[int]] = [{1, 2}, 1]
        kept = inputs.copy(), pose.copy(), load.copy()
        solve_forward(self.MECHANISM, inputs, load, modes=modes)
        solve_inverse(self.MECHANISM, pose, load, modes=modes)
        for now, then in zip((inputs, pose, load), kept, strict=True):
            np.testing.assert_array_equal(now, then)
        assert modes == [{1, 2}, 1]

    def test_limits_are_not_checked(self) -> None:
        legs = tuple(Leg(Revolute((x, 0.0), limits=(0.0, 0.1)), Rod(1.0, 1.0)) for x in (-0.2, 0.2))
        found = solve_forward(Mechanism("narrow", legs), TestOutsideNumbers.INPUTS)
        assert len(found) == len(solve_forward(self.MECHANISM, TestOutsideNumbers.INPUTS)) > 0
        assert not any(e.within_limits for e in found)
