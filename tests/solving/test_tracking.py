"""Following branches: events and where they are, against the discretised energy; limits, loads, straight rods."""

import json
import math
import pickle

import numpy as np
import pytest
from scipy.optimize import brentq

from pcm_gym.mechanism import Leg, Mechanism, Revolute, get_mechanism
from pcm_gym.solving import BranchTracker, Equilibrium, Event, home_equilibrium
from tests.reference.discrete_energy import DiscreteEnergy
from tests.reference.folds import first_fold
from tests.reference.mechanisms import (
    FAMILIES,
    find_equilibria,
    home_by_construction,
    random_inputs,
    random_mechanism,
)
from tests.reference.orders import fitted_order


def independent_fold(start: Equilibrium, inputs: np.ndarray, load: np.ndarray, step: float = 0.4) -> float | None:
    """Return the fraction of the first fold on the line to (inputs, load), by the discretised energy."""
    discrete, units = DiscreteEnergy(start.mechanism), start.mechanism.units
    input_rate, load_rate = inputs - start.inputs, load - start.load
    scale = np.ones(discrete.size + 1)
    scale[discrete.free : -1] = 20.0 * units.force

    def at(s: float) -> tuple[np.ndarray, np.ndarray]:
        return start.inputs + s * input_rate, start.load + s * load_rate

    def residual(z: np.ndarray) -> np.ndarray:
        return discrete.derivatives(z[:-1], *at(z[-1])).gradient

    def jacobian(z: np.ndarray) -> np.ndarray:
        by_fraction = discrete.input_derivative(z[:-1], *at(z[-1]), input_rate)
        by_fraction[discrete.rods : discrete.free] -= load_rate
        return np.column_stack([discrete.derivatives(z[:-1], *at(z[-1])).hessian, by_fraction])

    z = np.append(discrete.solve(discrete.start(start), *at(0.0)), 0.0)
    fold = first_fold(residual, jacobian, z, direction=1.0, limit=1.0, step=step, scale=scale)
    return None if fold is None else fold[0]


def lines_to_follow(seed: int = 16) -> list[tuple[Equilibrium, np.ndarray, np.ndarray]]:
    """Return starts and targets: random mechanisms with unequal rods, both inputs and load moving far."""
    lines: list[tuple[Equilibrium, np.ndarray, np.ndarray]] = []
    for family in FAMILIES:
        rng = np.random.default_rng(seed)
        while sum(line[0].mechanism.name == family for line in lines) < 4:
            mechanism = random_mechanism(family, rng)
            starts = 3000 if family == "3PFR" else 100
            stable = find_equilibria(
                mechanism, random_inputs(mechanism, rng), np.zeros(mechanism.dof), rng, starts, 6.5
            )
            if not stable:
                continue
            start = stable[0]
            reach = 1.6 if family == "2RFR" else 0.5
            inputs = start.inputs + reach * rng.uniform(-1.0, 1.0, mechanism.leg_count)
            if np.any(inputs < mechanism.lower_limits) or np.any(inputs > mechanism.upper_limits):
                continue
            lines.append(
                (
                    start,
                    inputs,
                    rng.uniform(-1.0, 1.0, mechanism.dof) * (12.0 if family == "3PFR" else 40.0) * mechanism.units.load,
                )
            )
    return lines


class TestFolds:
    def test_tracker_and_discretised_energy_find_the_same_folds(self) -> None:
        """The fraction is promised to 1e-8. The tracker must neither miss a fold nor see one that is not there."""
        folds = 0
        for start, inputs, load in lines_to_follow():
            step = BranchTracker(start.mechanism, start, follow_index_changes=True).step(inputs, load)
            expected = independent_fold(start, inputs, load)
            if expected is None:
                assert step.event == Event.NONE, f"{start!r} to {inputs.tolist()}, {load.tolist()}"
                continue
            folds += 1
            assert step.event == Event.FOLD, f"{start!r} to {inputs.tolist()}, {load.tolist()}"
            assert step.fraction == pytest.approx(expected, abs=1e-8)
            assert step.equilibrium.residual < 1e-10
            assert step.equilibrium.index == start.index
        assert folds >= 5

    def test_target_just_before_a_fold_is_reached_and_just_beyond_is_not(self) -> None:
        start = home_by_construction("3PFR")
        load = np.array([0.0, -100.0, 0.0]) * start.mechanism.units.load
        fold = BranchTracker(start.mechanism, start).step(start.inputs, load)
        assert fold.event == Event.FOLD
        for gap in (1e-2, 1e-4, 1e-6):
            before = BranchTracker(start.mechanism, start).step(start.inputs, (fold.fraction - gap) * load)
            assert before.event == Event.NONE
            assert before.fraction == 1.0
            np.testing.assert_allclose(before.equilibrium.load, (fold.fraction - gap) * load, rtol=1e-15)
            beyond = BranchTracker(start.mechanism, start).step(start.inputs, (fold.fraction + gap) * load)
            assert beyond.event == Event.FOLD
            assert beyond.fraction * (fold.fraction + gap) == pytest.approx(fold.fraction, abs=1e-8)

    def test_margin_vanishes_as_the_root_of_the_distance(self) -> None:
        """What makes a fold a fold: the stiffness falls like sqrt(1 - s / s_fold)."""
        start = home_by_construction("3PFR")
        load = np.array([0.0, -100.0, 0.0]) * start.mechanism.units.load
        fraction = BranchTracker(start.mechanism, start).step(start.inputs, load).fraction
        gaps = np.geomspace(1e-9, 1e-6, 7)
        tracker = BranchTracker(start.mechanism, start)
        margins = [tracker.step(start.inputs, (fraction - gap) * load).equilibrium.stability_margin for gap in gaps]
        assert fitted_order(gaps, np.array(margins)) == pytest.approx(0.5, abs=0.01)


class TestPitchfork:
    """The 2PFR pressed down in its plane of symmetry: at some load it gives way sideways."""

    @pytest.fixture
    def home(self) -> Equilibrium:
        return home_by_construction("2PFR")

    @pytest.fixture
    def critical_load(self, home: Equilibrium) -> float:
        """Return the load at which the discretised energy loses its sideways stiffness, in EI / L^2.

        By interpolation from both sides: at the load itself Newton's matrix is singular.
        """
        discrete, unit = DiscreteEnergy(home.mechanism), home.mechanism.units.load
        z = discrete.solve(discrete.start(home), home.inputs, home.load)
        loads, stiffness = [*np.arange(1.0, 31.0), 31.1, 31.2, 31.25, 31.3, 31.4, 31.45, 31.5, 31.6], []
        for load in loads:
            z = discrete.solve(z, home.inputs, np.array([0.0, -load]) * unit)
            stiffness.append(discrete.stiffness(z, home.inputs, np.array([0.0, -load]) * unit)[0, 0])
        by_load = np.polynomial.Polynomial.fit(loads[-8:], stiffness[-8:], 5)
        return float(brentq(by_load, 31.1, 31.6))

    @pytest.mark.parametrize("target", [-31.35, -31.4, -32.0, -33.0, -34.0, -100.0])
    def test_stops_at_the_state_just_before(self, home: Equilibrium, critical_load: float, target: float) -> None:
        load = np.array([0.0, target]) * home.mechanism.units.load
        step = BranchTracker(home.mechanism, home).step(home.inputs, load)
        assert step.event == Event.INDEX_CHANGE
        # a margin in proportion to the distance tells it only as well as rounding lets Newton near a singular point
        assert -step.fraction * target == pytest.approx(critical_load, rel=1e-4)
        assert -step.fraction * target <= critical_load + 1e-6
        assert step.equilibrium.index == 0
        assert 0.0 < step.equilibrium.stability_margin < 0.1
        assert abs(step.equilibrium.pose[0]) < 1e-6
        np.testing.assert_allclose(step.equilibrium.load, step.fraction * load, rtol=1e-12)

    def test_of_the_catalogued_mechanism_in_newtons(self) -> None:
        mechanism = get_mechanism("2PFR-paper")
        home = home_equilibrium(mechanism)
        step = BranchTracker(mechanism, home).step(home.inputs, (0.0, -5.0))
        assert step.event == Event.INDEX_CHANGE
        assert step.equilibrium.index == 0
        assert 0.9 < step.fraction < 1.0

    @pytest.mark.parametrize("target", [-31.4, -32.0, -33.0, -34.0])
    def test_goes_through_on_request(self, home: Equilibrium, target: float) -> None:
        """On the symmetric branch, now unstable, and back."""
        load = np.array([0.0, target]) * home.mechanism.units.load
        tracker = BranchTracker(home.mechanism, home, follow_index_changes=True)
        step = tracker.step(home.inputs, load)
        assert step.event == Event.NONE
        assert step.equilibrium.index == 1
        assert abs(step.equilibrium.pose[0]) < 1e-9
        back = tracker.step(home.inputs, np.zeros(2))
        assert back.event == Event.NONE
        np.testing.assert_allclose(back.equilibrium.state, home.state, atol=1e-9)

    def test_folds_beyond_it_where_the_discretised_energy_does(self, home: Equilibrium) -> None:
        load = np.array([0.0, -100.0]) * home.mechanism.units.load
        step = BranchTracker(home.mechanism, home, follow_index_changes=True).step(home.inputs, load)
        assert step.event == Event.FOLD
        assert step.fraction == pytest.approx(0.348478723505, abs=1e-8)  # tests.reference.folds, 56 polynomials


class TestLimits:
    @pytest.mark.parametrize("family", FAMILIES)
    def test_stops_exactly_at_the_first_limit(self, family: str) -> None:
        home = home_by_construction(family)
        mechanism = home.mechanism
        target = home.inputs.copy()
        target[1] = mechanism.upper_limits[1] + 0.1
        target[0] += 0.05
        tracker = BranchTracker(mechanism, home)
        step = tracker.step(target)
        if step.event == Event.FOLD:
            pytest.skip("this mechanism folds first")
        assert step.event == Event.ACTUATOR_LIMIT
        expected = (mechanism.upper_limits[1] - home.inputs[1]) / (target[1] - home.inputs[1])
        assert step.fraction == pytest.approx(expected, rel=1e-14)
        assert step.equilibrium.inputs[1] == pytest.approx(mechanism.upper_limits[1], rel=1e-14)
        assert step.equilibrium.residual < 1e-10
        again = tracker.step(target)
        assert again.event == Event.ACTUATOR_LIMIT
        assert again.fraction == pytest.approx(0.0, abs=1e-12)
        back = tracker.step(home.inputs)
        assert back.event == Event.NONE
        np.testing.assert_allclose(back.equilibrium.state, home.state, atol=1e-9)

    def test_state_at_its_limit_is_within_limits(self) -> None:
        home = home_by_construction("2PFR")
        tracker = BranchTracker(home.mechanism, home)
        at_limit = tracker.step([0.7, 0.1]).equilibrium
        assert at_limit.within_limits

    def test_input_outside_may_move_inwards(self) -> None:
        legs = tuple(Leg(Revolute((x, 0.0), limits=(0.5, 2.5))) for x in (-0.2, 0.2))
        mechanism = Mechanism("narrow", legs)
        wide = home_by_construction("2RFR")
        tracker = BranchTracker(wide.mechanism, wide)
        outside = tracker.step([2.7, 1.0]).equilibrium
        start = Equilibrium(mechanism, outside.state, outside.inputs, np.zeros(2))
        assert not start.within_limits
        step = BranchTracker(mechanism, start).step([2.2, 1.0])
        assert step.event == Event.NONE
        assert BranchTracker(mechanism, start).step([2.9, 1.0]).event == Event.ACTUATOR_LIMIT


class TestLoads:
    @pytest.mark.parametrize("family", FAMILIES)
    def test_load_on_and_off_returns(self, family: str) -> None:
        home = home_by_construction(family)
        tracker = BranchTracker(home.mechanism, home)
        load = np.array([6.0, -9.0, 1.0])[: home.mechanism.dof] * home.mechanism.units.load
        loaded = tracker.step(home.inputs, load)
        assert loaded.event == Event.NONE
        np.testing.assert_array_equal(loaded.equilibrium.load, load)
        assert np.abs(loaded.equilibrium.pose - home.pose).max() > 1e-3
        total = sum(rod.force for rod in loaded.equilibrium.rods)
        np.testing.assert_allclose(total, load[:2], atol=1e-9 * np.abs(load).max())
        kept = tracker.step(home.inputs + 0.02)
        np.testing.assert_array_equal(kept.equilibrium.load, load)
        tracker.step(home.inputs)
        back = tracker.step(home.inputs, np.zeros(home.mechanism.dof))
        np.testing.assert_allclose(back.equilibrium.state, home.state, atol=1e-9)

    def test_small_load_answers_by_the_stiffness(self) -> None:
        """d pose = K^-1 d load, with the error falling with the square of the load's step (central differences)."""
        for family in FAMILIES:
            home = home_by_construction(family)
            unit = home.mechanism.units.load * np.array([1.0, -0.5, 0.3])[: home.mechanism.dof]
            expected = np.linalg.solve(home.stiffness, unit)
            steps, errors = np.geomspace(0.2, 2.0, 5), []
            for size in steps:
                ahead = BranchTracker(home.mechanism, home).step(home.inputs, size * unit).equilibrium
                behind = BranchTracker(home.mechanism, home).step(home.inputs, -size * unit).equilibrium
                errors.append(np.linalg.norm((ahead.pose - behind.pose) / (2.0 * size) - expected))
            assert fitted_order(steps, np.array(errors)) == pytest.approx(2.0, abs=0.1)


@pytest.mark.parametrize("family", FAMILIES)
def test_forward_jacobian_is_the_limit_of_tracked_differences(family: str) -> None:
    home = home_by_construction(family)
    scale = 0.3 if family == "2RFR" else 0.06
    off_center = BranchTracker(home.mechanism, home).step(
        home.inputs + scale * np.array([0.5, -0.3, 0.2])[: len(home.inputs)]
    )
    start = off_center.equilibrium
    assert off_center.event == Event.NONE
    steps = scale * np.geomspace(2e-2, 0.2, 5)
    for leg in range(home.mechanism.leg_count):
        direction = np.eye(home.mechanism.leg_count)[leg]
        errors = []
        for size in steps:
            ahead = BranchTracker(home.mechanism, start).step(start.inputs + size * direction).equilibrium
            behind = BranchTracker(home.mechanism, start).step(start.inputs - size * direction).equilibrium
            difference = (ahead.pose - behind.pose) / (2.0 * size)
            errors.append(np.linalg.norm(difference - start.forward_jacobian[:, leg]))
        assert fitted_order(steps, np.array(errors)) == pytest.approx(2.0, abs=0.15)


class TestStraightRods:
    """Two motors turned so that both rods are exactly straight: their own stiffness has a pole there."""

    @staticmethod
    def truss(load: np.ndarray) -> Equilibrium:
        mechanism = Mechanism("truss", tuple(Leg(Revolute((x, 0.0))) for x in (-0.6, 0.6)))
        angle = math.atan2(0.8, 0.6)
        directions = np.array([[0.6, 0.8], [-0.6, 0.8]])
        tension = np.linalg.solve(directions.T, load)
        state = np.array([tension[0], 0.0, tension[1], 0.0, 0.0, 0.8])
        return Equilibrium(mechanism, state, np.array([angle, math.pi - angle]), load)

    def test_from_tension_through_no_load_to_compression(self) -> None:
        """As long as no rod buckles, nothing moves."""
        start = self.truss(np.array([3.0, 40.0]))
        tracker = BranchTracker(start.mechanism, start)
        for load in ([0.0, 0.0], [0.0, -20.0], [2.0, 1.0], [-4.0, -25.0]):
            step = tracker.step(start.inputs, load)
            assert step.event == Event.NONE, load
            np.testing.assert_allclose(step.equilibrium.pose, [0.0, 0.8], atol=1e-12)
            np.testing.assert_allclose(step.equilibrium.state, self.truss(np.array(load)).state, atol=1e-9)
            assert step.equilibrium.index == 0

    def test_buckling_of_one_rod_is_a_change_of_index(self) -> None:
        """The load along the first rod alone: it buckles at the textbook's clamped-pinned load."""
        start = self.truss(np.zeros(2))
        load = -30.0 * np.array([0.6, 0.8])
        step = BranchTracker(start.mechanism, start).step(start.inputs, load)
        assert step.event == Event.INDEX_CHANGE
        assert 30.0 * step.fraction == pytest.approx(20.190728556, rel=1e-4)
        assert step.equilibrium.index == 0

    def test_out_of_the_straight_and_back(self) -> None:
        start = self.truss(np.array([0.5, 6.0]))
        tracker = BranchTracker(start.mechanism, start)
        for turn in ([0.1, 0.0], [0.0, 0.3], [-0.2, 0.2], [0.0, 0.0]):
            step = tracker.step(start.inputs + np.array(turn))
            assert step.event == Event.NONE
            assert np.isfinite(step.equilibrium.state).all()
            assert step.equilibrium.residual < 1e-10
        np.testing.assert_allclose(step.equilibrium.state, start.state, atol=1e-9)

    def test_across_the_straight_state(self) -> None:
        """From bent one way to bent the other, the straight state exactly halfway and at a third."""
        start = self.truss(np.array([0.0, 5.0]))
        turn = np.array([0.2, -0.1])
        bent = BranchTracker(start.mechanism, start).step(start.inputs + turn).equilibrium
        for part in (1.0, 2.0):
            tracker = BranchTracker(start.mechanism, bent)
            across = tracker.step(start.inputs - part * turn)
            assert across.event == Event.NONE
            back = tracker.step(start.inputs)
            assert back.event == Event.NONE
            np.testing.assert_allclose(back.equilibrium.state, start.state, atol=1e-9)

    def test_one_straight_rod(self) -> None:
        """Rod 1 straight and pulled along itself by rod 2, which is bent: found by turning motor 2 until it fits."""
        mechanism = Mechanism("half truss", tuple(Leg(Revolute((x, 0.0))) for x in (-0.2, 0.2)))
        start = home_by_construction("2RFR")
        tracker = BranchTracker(start.mechanism, start)

        def bend(second: float) -> float:
            found = tracker.step([math.radians(70.0), second])
            assert found.event == Event.NONE
            return float(found.equilibrium.state[1])

        second = brentq(bend, math.radians(50.0), math.radians(60.0), xtol=1e-14)
        near = tracker.step([math.radians(70.0), second]).equilibrium
        state = np.array(near.state)
        state[1] = 0.0  # exactly straight
        exact = Equilibrium(mechanism, state, near.inputs, np.zeros(2))
        assert exact.residual < 1e-11
        assert exact.index == near.index
        assert np.isfinite(exact.stiffness).all()
        np.testing.assert_allclose(exact.forward_jacobian, near.forward_jacobian, rtol=1e-6, atol=1e-8)
        for turn in ([0.2, 0.0], [0.0, 0.2], [-0.1, 0.3]):
            step = BranchTracker(mechanism, exact).step(exact.inputs + np.array(turn))
            assert step.event == Event.NONE
            assert step.equilibrium.residual < 1e-10


class TestMisuse:
    @pytest.fixture
    def tracker(self) -> BranchTracker:
        home = home_by_construction("2RFR")
        return BranchTracker(home.mechanism, home)

    @pytest.mark.parametrize(
        ("inputs", "message"),
        [
            ([1.0], r"inputs must have shape \(2,\)"),
            ([1.0, 2.0, 3.0], r"inputs must have shape \(2,\)"),
            ([1.0, math.nan], "inputs must be finite"),
            ([math.inf, 1.0], "inputs must be finite"),
        ],
    )
    def test_bad_inputs_are_named(self, tracker: BranchTracker, inputs: list[float], message: str) -> None:
        before = tracker.equilibrium
        with pytest.raises(ValueError, match=message):
            tracker.step(inputs)
        assert tracker.equilibrium is before

    def test_bad_load_is_named(self, tracker: BranchTracker) -> None:
        with pytest.raises(ValueError, match=r"load must have shape \(2,\)"):
            tracker.step([1.0, 2.0], [0.0, 0.0, 1.0])

    def test_equilibrium_of_another_mechanism_is_refused(self) -> None:
        one, other = home_by_construction("2RFR"), home_by_construction("2PFR")
        with pytest.raises(ValueError, match="2PFR"):
            BranchTracker(other.mechanism, one)

    def test_no_way_to_go_is_gone(self, tracker: BranchTracker) -> None:
        before = tracker.equilibrium
        step = tracker.step(before.inputs)
        assert (step.event, step.fraction) == (Event.NONE, 1.0)
        np.testing.assert_allclose(step.equilibrium.state, before.state, atol=1e-11)

    def test_arguments_are_left_alone(self, tracker: BranchTracker) -> None:
        before = tracker.equilibrium
        kept = (before.state.copy(), before.inputs.copy(), before.load.copy())
        inputs, load = before.inputs + 0.1, np.array([0.1, 0.2])
        inputs_kept, load_kept = inputs.copy(), load.copy()
        tracker.step(inputs, load)
        for now, then in zip(
            (before.state, before.inputs, before.load, inputs, load), (*kept, inputs_kept, load_kept), strict=True
        ):
            np.testing.assert_array_equal(now, then)

    def test_equilibrium_survives_pickling(self, tracker: BranchTracker) -> None:
        before = tracker.equilibrium
        after = pickle.loads(pickle.dumps(before))
        assert after.mechanism == before.mechanism
        np.testing.assert_array_equal(after.state, before.state)
        np.testing.assert_array_equal(after.stiffness, before.stiffness)
        with pytest.raises(ValueError, match="read-only"):
            after.state[0] = 1.0

    def test_events_are_whole_numbers_with_names(self) -> None:
        names = ["none", "fold", "index_change", "actuator_limit", "solver_failure"]
        assert [str(event) for event in Event] == [f"{event}" for event in Event] == names
        assert [int(event) for event in Event] == json.loads(json.dumps(list(Event))) == list(range(5))
        assert [Event(code) for code in range(5)] == list(Event)

    def test_every_event_has_a_message(self) -> None:
        assert len({event.message for event in Event}) == len(Event)
