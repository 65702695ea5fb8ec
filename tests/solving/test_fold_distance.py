"""The distance to the nearest fold: against tracked rays, singular curves, and the normal form of a fold."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.stats import spearmanr

from pcm_gym.arrays import Array
from pcm_gym.mechanism import Leg, Mechanism, Prismatic, Rod, get_mechanism
from pcm_gym.solving import (
    BranchTracker,
    Equilibrium,
    Event,
    forward_singularities,
    home_equilibrium,
    nearest_fold,
    solve_forward,
)


def stable_states(name: str, count: int, seed: int) -> list[Equilibrium]:
    """Return random stable states: of two legs any, of a platform those that can be driven to from home."""
    mechanism, rng = get_mechanism(f"{name}-paper"), np.random.default_rng(seed)
    found: list[Equilibrium] = []
    while len(found) < count:
        inputs = rng.uniform(mechanism.lower_limits, mechanism.upper_limits)
        if mechanism.dof == 2:
            found += solve_forward(mechanism, inputs).stable
        else:
            found.append(BranchTracker(mechanism, home_equilibrium(mechanism)).step(0.5 * inputs).equilibrium)
    return found[:count]


def unlimited(equilibrium: Equilibrium) -> Equilibrium:
    """Return the same state of the mechanism with actuators that have practically no limits."""
    mechanism = equilibrium.mechanism
    legs = []
    for leg in mechanism.legs:
        actuator = type(leg.actuator)(**{**vars(leg.actuator), "limits": (-50.0, 50.0)})
        legs.append(type(leg)(actuator, leg.rod, leg.attachment))
    return Equilibrium(Mechanism("unlimited", tuple(legs)), equilibrium.state, equilibrium.inputs, equilibrium.load)


def distance_by_rays(equilibrium: Equilibrium, reach: float, directions: Array) -> float:
    """Return the least distance at which a ray of inputs meets a fold."""
    start, least = unlimited(equilibrium), math.inf
    units = start.mechanism.units.inputs
    for direction in directions:
        step = BranchTracker(start.mechanism, start).step(start.inputs + reach * direction * units)
        if step.event in (Event.FOLD, Event.INDEX_CHANGE):
            least = min(least, step.fraction * reach)
    return least


def circle(count: int) -> Array:
    angles = 2.0 * math.pi * (np.arange(count) + 0.1) / count
    return np.column_stack([np.cos(angles), np.sin(angles)])


class TestNearestFold:
    @pytest.mark.parametrize(("name", "count", "reach"), [("2RFR", 15, 1.5), ("2PFR", 10, 1.0)])
    def test_no_ray_is_shorter(self, name: str, count: int, reach: float) -> None:
        compared = 0
        for state in stable_states(name, count, 4):
            fold, least = nearest_fold(state, reach), distance_by_rays(state, reach, circle(64))
            if fold is None:
                assert least == math.inf
                continue
            compared += 1
            assert fold.distance <= least * (1.0 + 1e-9)
        assert compared > count // 4

    def test_no_ray_is_shorter_for_a_platform(self) -> None:
        directions = np.random.default_rng(0).normal(size=(64, 3))
        directions /= np.linalg.norm(directions, axis=1)[:, None]
        for state in stable_states("3PFR", 3, 5):
            fold = nearest_fold(state, 1.0)
            assert fold is not None
            assert fold.distance <= distance_by_rays(state, 1.0, directions) * (1.0 + 1e-9)

    def test_it_is_a_fold_at_that_distance_and_can_be_driven_to(self) -> None:
        for state in stable_states("2RFR", 6, 6):
            fold = nearest_fold(state)
            if fold is None:
                continue
            assert np.linalg.norm(fold.inputs - state.inputs) == pytest.approx(fold.distance, rel=1e-12)
            assert fold.equilibrium.residual < 1e-11
            assert fold.equilibrium.singularity_margin < 1e-9
            before = unlimited(state)
            step = BranchTracker(before.mechanism, before).step(
                state.inputs + 0.999999 * fold.distance * fold.direction
            )
            assert step.event is Event.NONE
            # a millionth of the way is left, which the margin tells to a part of the order of its root
            assert step.equilibrium.singularity_margin == pytest.approx(1e-6 * fold.distance, rel=0.3)

    def test_between_parallel_rails_it_is_the_distance_from_a_line(self) -> None:
        """The folds at parallel rails are lines: the distance is that of a point from a line."""
        mechanism = get_mechanism("2PFR-paper")
        curves = forward_singularities(mechanism, index=0, grid=4, progress=False)
        offsets = [float(curve.inputs[0, 0] - curve.inputs[0, 1]) for curve in curves]
        compared = 0
        for state in stable_states("2PFR", 10, 7):
            fold = nearest_fold(state)
            if fold is None or fold.equilibrium.index > 1:
                continue
            difference = state.inputs[0] - state.inputs[1]
            distances = [abs(difference - offset) / math.sqrt(2.0) for offset in offsets]
            # the fold is one of these lines, if it lies in the range of the inputs; which one is a matter of the sheet
            if abs(fold.inputs[0] - fold.inputs[1]) < 0.9:
                assert min(abs(fold.distance - distance) for distance in distances) < 1e-8
                compared += 1
        assert compared > 1

    def test_wrong_reach_is_named(self) -> None:
        with pytest.raises(ValueError, match="reach must be greater than 0"):
            nearest_fold(home_equilibrium(get_mechanism("2RFR-paper")), 0.0)


class TestMargin:
    """`singularity_margin`, the estimate, against the exact distance."""

    @pytest.mark.parametrize(("name", "count"), [("2RFR", 20), ("2PFR", 20), ("3PFR", 3)])
    def test_its_error_vanishes_towards_the_fold(self, name: str, count: int) -> None:
        compared = 0
        for state in stable_states(name, count, 8):
            fold, start = nearest_fold(state, 1.0), unlimited(state)
            if fold is None or fold.distance < 1e-2:
                continue
            errors = []
            for distance in (1e-4, 1e-6, 1e-8):
                way = (fold.distance - distance) * fold.direction * state.mechanism.units.inputs
                step = BranchTracker(start.mechanism, start).step(state.inputs + way)
                assert step.event is Event.NONE
                errors.append(abs(step.equilibrium.singularity_margin / distance - 1.0))
            compared += 1
            # the error goes with the square root of the distance: a tenth for a hundredth
            assert errors[1] < 0.2 * errors[0] + 1e-3
            assert errors[2] < 0.01
        assert compared > 2

    @pytest.mark.parametrize(("name", "count"), [("2RFR", 100), ("2PFR", 100), ("3PFR", 20)])
    def test_it_ranks_states_as_the_exact_distance_does(self, name: str, count: int) -> None:
        """Better than the least eigenvalue, whose correlation with it is negative for a platform."""
        margins, softest, distances = [], [], []
        for state in stable_states(name, count, 10):
            fold = nearest_fold(state)
            if fold is not None:
                margins.append(state.singularity_margin)
                softest.append(state.stability_margin)
                distances.append(fold.distance)
        assert len(margins) > count // 3
        correlation = spearmanr(margins, distances).statistic
        assert correlation > max(0.5, 0.2 + spearmanr(softest, distances).statistic)

    @pytest.mark.parametrize("name", ["2RFR", "2PFR"])
    def test_it_is_nothing_at_a_fold(self, name: str) -> None:
        for curve in forward_singularities(get_mechanism(f"{name}-paper"), index=0, grid=4, progress=False):
            assert max(curve.equilibrium(k).singularity_margin for k in range(0, len(curve), 5)) < 1e-6

    @pytest.mark.parametrize("name", ["2RFR", "2PFR", "3PFR"])
    def test_it_is_finite_and_positive_elsewhere(self, name: str) -> None:
        for state in [home_equilibrium(get_mechanism(f"{name}-paper")), *stable_states(name, 40, 9)]:
            assert 0.0 < state.singularity_margin <= 10.0

    @pytest.mark.parametrize("name", ["2RFR", "2PFR", "3PFR"])
    def test_it_has_no_unit(self, name: str) -> None:
        """A mechanism thrice as large, of rods seven times as stiff, is as far from its folds."""
        state, scale = stable_states(name, 1, 11)[0], 3.0
        mechanism, legs = state.mechanism, []
        for leg in mechanism.legs:
            changes: dict[str, Any] = {"base": tuple(scale * x for x in leg.actuator.base)}
            is_rail = isinstance(leg.actuator, Prismatic)
            if is_rail:
                changes["limits"] = tuple(scale * x for x in leg.actuator.limits)
            actuator = replace(leg.actuator, **changes)
            rod = Rod(scale * leg.rod.length, 7.0 * leg.rod.bending_stiffness)
            x, y = leg.attachment
            legs.append(Leg(actuator, rod, (scale * x, scale * y)))
        larger = Mechanism("larger", tuple(legs))
        inputs = state.inputs * (scale if is_rail else 1.0)
        same = Equilibrium(larger, state.state, inputs, state.load)
        assert same.residual < 1e-12
        assert same.singularity_margin == pytest.approx(state.singularity_margin, rel=1e-6)

    def test_straight_rods_are_no_fold(self) -> None:
        """Two straight unloaded rods: the stiffness has a pole there, the distance none."""
        mechanism = get_mechanism("2RFR-paper")
        half = math.acos(0.2)
        straight = Equilibrium(
            mechanism,
            np.array([0.0, 0.0, 0.0, 0.0, 0.0, math.sin(half)]),
            np.array([half, math.pi - half]),
            np.zeros(2),
        )
        assert straight.residual < 1e-14
        beside = BranchTracker(mechanism, straight).step(straight.inputs + np.array([1e-4, 2e-4])).equilibrium
        assert straight.singularity_margin > 0.1
        assert straight.singularity_margin == pytest.approx(beside.singularity_margin, rel=0.01)
