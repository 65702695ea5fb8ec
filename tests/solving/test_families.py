"""Families of equilibria, and sets that are neither cut nor hold anything twice.

The truth comes from geometry (straight rods on lines through one point bear any self-stress), from the rod's ODE, which
is integrated anew, and from the symmetry of the mechanisms.
"""

import itertools
import math

import numpy as np
import pytest
from scipy import ndimage

from pcm_gym.arrays import Array
from pcm_gym.mechanism import Leg, Mechanism, Prismatic, Revolute, Rod, get_mechanism
from pcm_gym.solving import (
    BranchTracker,
    Equilibrium,
    EquilibriumSet,
    Event,
    FamilyKind,
    enumeration,
    home_equilibrium,
    solve_forward,
    solve_inverse,
)
from tests.reference.symmetric_designs import Design, distance, doubles, faults, grid, own_residual


def motors(*bases: float, limits: tuple[float, float] = (-math.pi, math.pi), reference: Rod | None = None) -> Mechanism:
    """Two motors on the x-axis, rods of length and stiffness 1."""
    legs = tuple(Leg(Revolute((x, 0.0), limits=limits), Rod(1.0, 1.0)) for x in bases)
    return Mechanism("motors", legs, reference=reference)


def in_a_row(*places: tuple[float, float, float]) -> Mechanism:
    """Sliders on the x-axis at the first numbers, clamped at the second; hinges at the third on the platform's axis."""
    return Mechanism(
        "row", tuple(Leg(Prismatic((x, 0.0), 0.5 * math.pi, angle), Rod(1.0, 1.0), (c, 0.0)) for x, angle, c in places)
    )


def moved_along(found: EquilibriumSet, amounts: tuple[float, ...]) -> list[Equilibrium]:
    """Return states of the only family, straight on from its representative in each of its directions."""
    (family,) = found.families
    one, states = family.representative, []
    for row, amount in itertools.product(family.directions, amounts):
        change, inputs = np.split(row, [len(one.state)])
        states.append(Equilibrium(one.mechanism, one.state + amount * change, one.inputs + amount * inputs, one.load))
    return states


class TestStraightRods:
    """Any force along a straight rod leaves it as it is."""

    @pytest.mark.parametrize(
        ("mechanism", "inputs", "load", "dimension", "isolated"),
        [
            (motors(0.0, 0.0), (1.0, 1.0), None, 1, None),
            (motors(-1.0, 1.0), (0.0, math.pi), None, 1, 0),
            (motors(-1.0, 1.0), (0.0, math.pi), (2.0, 0.0), 1, 0),
            (in_a_row((0.0, 0.0, 0.0), (0.2, 0.0, 0.2), (0.4, 0.0, 0.4)), (0.0, 0.0, 0.0), None, 2, None),
            (in_a_row((0.0, 0.0, 0.0), (2.2, math.pi, 0.2), (0.1, 0.0, 0.1)), (0.0, 0.0, 0.0), None, 2, None),
            (Design(1.3, 0.3, 0.0).mechanism(), (0.0, 0.0, 0.0), None, 1, 0),
        ],
    )
    def test_bear_any_self_stress(
        self, mechanism: Mechanism, inputs: tuple, load: tuple | None, dimension: int, isolated: int | None
    ) -> None:
        found = solve_forward(mechanism, inputs, load, rho_max=3.5)
        (family,) = found.families
        assert (family.kind, family.dimension) == (FamilyKind.SELF_STRESS, dimension)
        assert family.directions.shape == (dimension, mechanism.state_size + mechanism.leg_count)
        np.testing.assert_allclose(family.directions @ family.directions.T, np.eye(dimension), atol=1e-12)
        assert not family.representative.is_stable
        assert own_residual(family.representative) < 1e-12
        for moved in moved_along(found, (-15.0, -0.3, 4.0)):
            assert own_residual(moved) < 1e-11
            assert all(distance(moved, member) > 1e-3 for member in found)
        assert doubles(found) == []
        assert isolated is None or len(found) == isolated
        assert repr(family) in repr(found) or repr(family) in found.reason

    @pytest.mark.parametrize("rho_max", [0.5, 2.0, 3.5, 8.0])
    def test_are_seen_whatever_the_range(self, rho_max: float) -> None:
        (family,) = solve_forward(motors(0.0, 0.0), (1.0, 1.0), rho_max=rho_max).families
        assert family.kind == FamilyKind.SELF_STRESS
        np.testing.assert_allclose(family.representative.pose, (math.cos(1.0), math.sin(1.0)), atol=1e-12)

    def test_whose_load_is_beyond_the_range_are_none(self) -> None:
        facing = motors(-1.0, 1.0), (0.0, math.pi)
        assert solve_forward(*facing, (3.0, 0.0), rho_max=1.0).families == ()
        assert solve_forward(*facing, (3.0, 0.0), rho_max=2.0).families != ()
        assert solve_forward(*facing, (0.0, 3.0), rho_max=5.0).families == ()

    @pytest.mark.parametrize("pose", [(0.0, 1.0), (0.6, -0.8)])
    def test_at_a_pose_at_full_reach(self, pose: tuple[float, float]) -> None:
        found = solve_inverse(motors(0.0, 0.0), pose)
        (family,) = found.families
        assert (len(found), family.kind, family.dimension) == (0, FamilyKind.SELF_STRESS, 1)
        np.testing.assert_allclose(family.representative.inputs, math.atan2(pose[1], pose[0]), atol=1e-7)
        assert "self-stress" in found.reason

    @pytest.mark.parametrize("gap", [1e-4, 1e-6, 1e-8, 1e-10])
    def test_that_all_but_reach_are_no_family(self, gap: float) -> None:
        for mechanism, inputs in (
            (motors(-1.0 + gap, 1.0), (0.0, math.pi)),
            (motors(0.0, 0.0), (1.0, 1.0 + 100.0 * gap)),
            (Design(0.7, 0.3 - gap, 0.0).mechanism(), (0.0, 0.0, 0.0)),
        ):
            found = solve_forward(mechanism, inputs, rho_max=5.0)
            assert found.families == ()
            assert len(found) > 0
            assert doubles(found) == []
            assert max(map(own_residual, found)) < 1e-10

    def test_of_which_one_has_no_partner_are_isolated(self) -> None:
        """A truss that is statically determinate: straight rods, and one state."""
        inputs = (math.acos(0.6), math.pi - math.acos(0.6))
        found = solve_forward(motors(-0.6, 0.6), inputs)
        assert found.families == ()
        assert sum(np.abs(e.pose - (0.0, 0.8)).max() < 1e-9 for e in found) == 1
        assert found.stable


class TestOpposedRods:
    """At a pose in the middle between two equal motors each shape of one rod is balanced by its image through it."""

    HALF, RHO_MAX = 0.2, 9.0

    def test_are_as_many_curves_as_there_are_of_one_rod(self) -> None:
        found = solve_inverse(motors(-self.HALF, self.HALF), (0.0, 0.0), rho_max=self.RHO_MAX)
        assert {family.kind for family in found.families} == {FamilyKind.OPPOSED_RODS}
        assert {family.dimension for family in found.families} == {1}
        assert len(found.families) == self.curves_of_one_rod()
        for family in found.families:
            state = family.representative.state
            np.testing.assert_allclose(state[:2], state[2:4], atol=1e-9)
            assert own_residual(family.representative) < 1e-10
            assert np.all(np.abs(family.representative.inputs) <= math.pi)
        assert doubles_at_a_pose(found) == []
        assert max(map(own_residual, found)) < 1e-10
        # what is isolated is not the image of itself
        assert all(np.abs(e.state[:2] - e.state[2:4]).max() > 1e-3 for e in found)

    def curves_of_one_rod(self) -> int:
        """Return the number of curves in the plane of a rod's loads on which its tip is that far from its base."""
        side = np.linspace(-(self.RHO_MAX**2), self.RHO_MAX**2, 300)
        g_x, g_y = np.meshgrid(side, side, indexing="ij")
        span = np.hypot(*integrated_tips(g_x, g_y, steps=80)) - self.HALF
        below = span < 0.0
        corners = below[1:, 1:], below[:-1, 1:], below[1:, :-1], below[:-1, :-1]
        is_crossed = np.any(corners, axis=0) & ~np.all(corners, axis=0)
        is_crossed &= np.hypot(g_x, g_y)[1:, 1:] < self.RHO_MAX**2
        return int(ndimage.label(is_crossed, np.ones((3, 3)))[1])

    def test_are_tangent_to_their_directions(self) -> None:
        for family in solve_inverse(motors(-self.HALF, self.HALF), (0.0, 0.0)).families:
            one, (row,) = family.representative, family.directions
            errors = []
            for amount in (1e-2, 1e-3):
                change, inputs = np.split(amount * row, [len(one.state)])
                errors.append(
                    own_residual(Equilibrium(one.mechanism, one.state + change, one.inputs + inputs, one.load))
                )
            assert errors[1] < 0.02 * errors[0] < 2e-4

    def test_a_load_ends_them(self) -> None:
        found = solve_inverse(motors(-self.HALF, self.HALF), (0.0, 0.0), load=(0.3, 1.0))
        assert found.families == ()
        assert 0 < len(found) < 100
        assert doubles_at_a_pose(found) == []


def integrated_tips(g_x: Array, g_y: Array, steps: int) -> tuple[Array, Array]:
    """Return the tips from the base of rods with these loads at their tips, by Runge and Kutta's method."""

    def slope(state: Array) -> Array:
        tau, rate = state[0], state[1]
        return np.stack([rate, g_x * np.sin(tau) - g_y * np.cos(tau), np.cos(tau), np.sin(tau)])

    state, h = np.zeros((4, *g_x.shape)), 1.0 / steps
    for _ in range(steps):
        first = slope(state)
        second = slope(state + 0.5 * h * first)
        third = slope(state + 0.5 * h * second)
        state = state + h / 6.0 * (first + 2.0 * second + 2.0 * third + slope(state + h * third))
    return state[2], state[3]


def doubles_at_a_pose(found: EquilibriumSet) -> list[tuple[Equilibrium, Equilibrium]]:
    """Return the pairs with the same forces and the same directions of the clamps."""
    return [
        (one, other)
        for one, other in doubles(found)
        if np.abs(np.remainder(one.inputs - other.inputs + 1.0, 2.0 * math.pi) - 1.0).max() < 1e-6
    ]


class TestTipsOnMotors:
    @pytest.mark.parametrize("away", [1e-3, 1e-6, 1e-8, 1e-10, 1e-12, 1e-15, 0.0])
    def test_are_held_in_as_many_ways_as_beside_them(self, away: float) -> None:
        mechanism = motors(-0.2, 0.2)
        found, beside = solve_inverse(mechanism, (-0.2 + away, 0.0)), solve_inverse(mechanism, (-0.2 + 1e-4, 0.0))
        assert found.families == ()
        assert len(found) == len(beside) == 8
        assert max(map(own_residual, found)) < 1e-10
        for one in beside:
            nearest = min(distance(one, other) for other in found)
            assert nearest < 20.0 * (abs(away - 1e-4) + 1e-9)

    def test_loops_on_one_place_turn_together(self) -> None:
        """Either may bend either way: four families."""
        found = solve_inverse(motors(0.0, 0.0), (0.0, 0.0), rho_max=6.0)
        assert [(family.kind, family.dimension) for family in found.families] == [(FamilyKind.FREE_ROTATION, 1)] * 4
        assert len(found) == 0
        sides = {tuple(np.sign(family.representative.state[[1, 3]])) for family in found.families}
        assert len(sides) == 4
        for family in found.families:
            one = family.representative
            for angle in (0.4, 2.0, -3.0):
                assert own_residual(Equilibrium(one.mechanism, one.state, one.inputs + angle, one.load)) < 1e-10

    def test_loops_under_a_load_do_not(self) -> None:
        found = solve_inverse(motors(0.0, 0.0), (0.0, 0.0), load=(0.0, 3.0), rho_max=6.0)
        assert found.families == ()
        assert len(found) == 8
        assert doubles_at_a_pose(found) == []


class TestFoldsAndForks:
    def test_are_no_families(self) -> None:
        """Where two or three states meet the equations are singular as well."""
        mechanism, count = motors(-0.25, 0.25), 0
        for turn, start in itertools.product((0.6, -0.8, 2.0), solve_forward(mechanism, (2.2, 0.9))):
            for rate in (np.array([1.0, -1.0]), np.array([1.0, 0.3])):
                step = BranchTracker(mechanism, start, follow_index_changes=False).step(start.inputs + turn * rate)
                if step.event not in (Event.FOLD, Event.INDEX_CHANGE):
                    continue
                count += 1
                found = solve_forward(mechanism, step.equilibrium.inputs)
                assert found.families == ()
                assert 1 <= sum(distance(step.equilibrium, other) < 1e-3 for other in found) <= 3
                assert doubles(found, 1e-9) == []
        assert count >= 5


class TestSymmetricDesigns:
    DESIGNS = grid()

    def test_the_grid_is_large_and_holds_straight_rods_in_each_row(self) -> None:
        assert len(self.DESIGNS) >= 200
        assert sum(design.has_straight_rods for design in self.DESIGNS) >= 5

    @pytest.mark.slow
    @pytest.mark.parametrize("design", [*DESIGNS[3::37], Design(0.7, 0.3, 0.0), Design(0.5, 0.5, 0.0)])
    def test_have_finite_sets_or_families(self, design: Design) -> None:
        assert faults(design, design.equilibria(), sample=4) == []

    def test_loops_of_three_motors_turn_together(self) -> None:
        """Three equal forces a third of a turn apart, turned against the arms: no moment at any angle."""
        one = Design(0.5, 0.5, 0.0, has_motors=True).mechanism()
        state, inputs, _ = self._loops(one)
        for angle in (0.0, 1.0, -2.5):
            assert own_residual(Equilibrium(one, state, inputs + angle, np.zeros(3))) < 1e-9

    @staticmethod
    def _loops(mechanism: Mechanism) -> tuple[Array, Array, Array]:
        family = solve_inverse(motors(0.0, 0.0), (0.0, 0.0), rho_max=6.0).families[0]
        loop = family.representative.state[:2]
        inputs = np.array([-2.0 * angle - math.pi for angle in np.radians([90.0, 210.0, 330.0])])
        return np.concatenate([loop, loop, loop, np.zeros(3)]), inputs, np.zeros(3)


class TestNothingIsCut:
    MECHANISM, INPUTS = motors(-0.2, 0.2), (2.1, 1.0)

    def test_room_is_made_for_large_sets(self, monkeypatch: pytest.MonkeyPatch) -> None:
        whole, back = solve_forward(self.MECHANISM, self.INPUTS), solve_inverse(self.MECHANISM, (0.3, 0.7))
        monkeypatch.setattr(enumeration, "_ROOMS", (2, 4, 64))
        for found, other in (
            (solve_forward(self.MECHANISM, self.INPUTS), whole),
            (solve_inverse(self.MECHANISM, (0.3, 0.7)), back),
        ):
            assert [e.state.tolist() for e in found] == [e.state.tolist() for e in other]

    def test_what_has_no_room_is_refused(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(enumeration, "_ROOMS", (2, 4))
        with pytest.raises(ValueError, match=r"rho_max must be smaller .* 9.0 leaves more than 3 equilibria"):
            solve_forward(self.MECHANISM, self.INPUTS)
        with pytest.raises(ValueError, match="leaves more than 3 equilibria"):
            solve_inverse(self.MECHANISM, (0.3, 0.7))


class TestNothingIsThereTwice:
    def test_across_the_seam_of_a_motor(self) -> None:
        """Clamps are turned so that an input comes out as pi, or all but."""
        plain = motors(-0.2, 0.2)
        found = solve_inverse(plain, (0.3, 0.7))
        for one, shift in itertools.product(found, (0.0, 1e-16, -1e-15, 1e-12)):
            legs = tuple(
                Leg(Revolute(leg.actuator.base, clamp_angle=value - math.pi + shift), leg.rod)
                for leg, value in zip(plain.legs, one.inputs.tolist(), strict=True)
            )
            turned = solve_inverse(Mechanism("turned", legs), (0.3, 0.7))
            assert len(turned) == len(found)
            assert all(-math.pi < value <= math.pi for e in turned for value in e.inputs)

    def test_across_the_seam_of_a_platform(self) -> None:
        found = Design(0.5, 0.3, 0.0).equilibria()
        assert sum(abs(abs(e.pose[2]) - math.pi) < 1e-9 for e in found) >= 5
        assert doubles(found) == []
        assert all(-math.pi < e.pose[2] <= math.pi for e in found)

    @pytest.mark.parametrize("ratio", [1e-3, 1e-2, 1e2, 1e3])
    def test_with_rods_of_unlike_lengths(self, ratio: float) -> None:
        """Stiff as their squared lengths, so that they can balance each other."""
        rng = np.random.default_rng(11)
        bases = np.array([[0.0, 0.0], [0.6, 0.2] if ratio < 1.0 else [0.6 * ratio, 0.0]])
        legs = tuple(
            Leg(Revolute(tuple(base)), Rod(length, length**2)) for base, length in zip(bases, (1.0, ratio), strict=True)
        )
        short = bases[1 if ratio < 1.0 else 0], min(ratio, 1.0)
        for angle, part in zip(rng.uniform(-3.0, 3.0, 6), rng.uniform(0.2, 0.9, 6), strict=True):
            pose = short[0] + short[1] * part * np.array([math.cos(angle), math.sin(angle)])
            coarse, fine = (solve_inverse(Mechanism("unlike", legs), pose, refinement=level) for level in (0, 1))
            assert 0 < len(coarse) == len(fine) < 40
            assert doubles_at_a_pose(coarse) == []


class TestUnitsAndPlaces:
    @pytest.mark.parametrize("length", [1e-6, 1e-3, 1e-2, 30.0, 1e3])
    @pytest.mark.parametrize("stiffness", [1e-3, 1.0, 1e3])
    def test_the_reference_rod_does_not_matter(self, length: float, stiffness: float) -> None:
        reference = Rod(length, stiffness)
        for plain, other in (
            (
                solve_forward(motors(-0.2, 0.2), (2.1, 1.0)),
                solve_forward(motors(-0.2, 0.2, reference=reference), (2.1, 1.0)),
            ),
            (
                solve_inverse(motors(-0.2, 0.2), (0.3, 0.7)),
                solve_inverse(motors(-0.2, 0.2, reference=reference), (0.3, 0.7)),
            ),
        ):
            self.assert_same(plain, other, np.zeros(2), 1e-9)

    @pytest.mark.parametrize("shift", [1e3, 1e5, 1e7])
    def test_the_place_does_not_matter(self, shift: float) -> None:
        """Bases that double precision holds exactly."""
        plain, moved = motors(-0.25, 0.25), motors(shift - 0.25, shift + 0.25)
        self.assert_same(
            solve_forward(plain, (2.1, 1.0)), solve_forward(moved, (2.1, 1.0)), np.array([shift, 0.0]), 1e-15 * shift
        )
        self.assert_same(
            solve_inverse(plain, (0.25, 0.75)),
            solve_inverse(moved, (shift + 0.25, 0.75)),
            np.array([shift, 0.0]),
            1e-15 * shift,
        )

    def test_a_family_is_one_in_any_units(self) -> None:
        plain = solve_forward(motors(-1.0, 1.0), (0.0, math.pi))
        foreign = solve_forward(motors(-1.0, 1.0, reference=Rod(1e-2)), (0.0, math.pi))
        far = solve_forward(motors(511.0, 513.0), (0.0, math.pi))
        for found in (plain, foreign, far):
            (family,) = found.families
            np.testing.assert_allclose(np.abs(family.directions[0, [0, 2]]), math.sqrt(0.5), rtol=1e-12)
        np.testing.assert_allclose(far.families[0].representative.pose, (512.0, 0.0), atol=1e-12)

    def test_where_a_rod_is_not_resolved_is_refused(self) -> None:
        with pytest.raises(ValueError, match=r"base must be within 1e\+09 .* got \(999999999999.8, 0.0\)"):
            motors(1e12 - 0.2, 1e12 + 0.2)

    @staticmethod
    def assert_same(plain: EquilibriumSet, other: EquilibriumSet, shift: Array, tolerance: float) -> None:
        assert len(plain) == len(other) > 0
        for one, same in zip(plain, other, strict=True):
            np.testing.assert_allclose(same.pose - shift, one.pose, rtol=0.0, atol=1e-12 + tolerance)
            np.testing.assert_allclose(same.inputs, one.inputs, rtol=0.0, atol=1e-9 + 100.0 * tolerance)
            for rod, same_rod in zip(one.rods, same.rods, strict=True):
                np.testing.assert_allclose(same_rod.force, rod.force, rtol=0.0, atol=1e-7 + 1e3 * tolerance)
            assert same.index == one.index


class TestLimits:
    def test_full_turns_count(self) -> None:
        """Against trying all turns within reach."""
        rng, seen = np.random.default_rng(5), set()
        for _ in range(6):
            lower = rng.uniform(-9.0, 3.0, 2)
            upper = lower + rng.uniform(2.0, 8.0, 2)
            legs = tuple(
                Leg(Revolute((x, 0.0), limits=tuple(pair)), Rod(1.0, 1.0))
                for x, pair in zip((-0.2, 0.2), np.stack([lower, upper], 1), strict=True)
            )
            for one in solve_inverse(Mechanism("limited", legs), rng.uniform([-0.4, 0.2], [0.4, 0.8])):
                turned = one.inputs + 2.0 * math.pi * np.arange(-5, 6)[:, None]
                reachable = bool(np.all(np.any((lower <= turned) & (turned <= upper), axis=0)))
                assert one.within_limits == reachable
                seen.add(reachable)
                inside = one.inputs_within_limits
                assert (inside is not None) == reachable
                if inside is not None:
                    assert np.all((lower <= inside) & (inside <= upper))
                    turns = (inside - one.inputs) / (2.0 * math.pi)
                    np.testing.assert_allclose(turns, np.round(turns), atol=1e-12)
                    assert own_residual(Equilibrium(one.mechanism, one.state, inside, one.load)) < 1e-10
        assert seen == {False, True}

    def test_inputs_within_the_limits_stay(self) -> None:
        mechanism, count = get_mechanism("2RFR-paper"), 0
        for one in solve_inverse(mechanism, (0.1, 0.7)):
            if np.all((mechanism.lower_limits <= one.inputs) & (one.inputs <= mechanism.upper_limits)):
                count += 1
                assert one.inputs_within_limits is not None
                np.testing.assert_array_equal(one.inputs_within_limits, one.inputs)
        assert count >= 2

    def test_a_slider_has_no_turns(self) -> None:
        found = solve_inverse(get_mechanism("2PFR-paper"), (0.1, 2.0))
        assert all((one.inputs_within_limits is None) == bool(np.any(np.abs(one.inputs) > 0.5)) for one in found)


class TestHomes:
    def test_on_a_family_are_refused(self) -> None:
        mechanism = Design(0.7, 0.3, 0.0).mechanism()
        with pytest.raises(
            ValueError, match=r"lies at home_inputs .* on a family of equilibria, which is no home: Family\(self"
        ):
            home_equilibrium(mechanism)

    def test_beside_a_family_are_found(self) -> None:
        mechanism = Design(0.7, 0.3, 0.0).mechanism()
        stable = Design(0.7, 0.3, 0.0).equilibria().stable
        chosen = Mechanism("beside", mechanism.legs, home_pose=tuple(stable[0].pose))
        np.testing.assert_allclose(home_equilibrium(chosen).pose, stable[0].pose, atol=1e-9)

    def test_that_are_not_found_say_how_far_was_searched(self) -> None:
        with pytest.raises(
            ValueError, match=r"no stable equilibrium with every rho <= 13 .*; larger loads were not searched"
        ):
            home_equilibrium(motors(-1.2, 1.2))
