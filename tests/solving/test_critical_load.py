"""The least load that destabilises: against a search over directions, the fold condition, and a column's own load."""

import math

import numpy as np
import pytest

from pcm_gym.mechanism import Leg, Mechanism, Revolute, Rod, get_mechanism
from pcm_gym.solving import BranchTracker, Equilibrium, Event, critical_load, home_equilibrium, solve_forward

RAYS = 128


def stable_states(name: str, count: int, seed: int) -> list[Equilibrium]:
    """Return stable equilibria at random inputs: of two legs any, of a platform those that home leads to."""
    mechanism, rng = get_mechanism(name), np.random.default_rng(seed)
    found: list[Equilibrium] = []
    while len(found) < count:
        inputs = rng.uniform(0.8 * mechanism.lower_limits, 0.8 * mechanism.upper_limits)
        if mechanism.dof == 2:
            found += solve_forward(mechanism, inputs).stable[:2]
        else:
            step = BranchTracker(mechanism, home_equilibrium(mechanism)).step(0.5 * inputs)
            found += [step.equilibrium] if step.event is Event.NONE else []
    return found[:count]


def least_of_rays(equilibrium: Equilibrium, reach: float) -> float:
    """Return the least load along 128 directions at which a tracker loses the branch, N."""
    mechanism = equilibrium.mechanism
    weights, rng, least = mechanism.units.load / mechanism.units.force, np.random.default_rng(0), math.inf
    for n in range(RAYS):
        direction = rng.standard_normal(mechanism.dof)
        if mechanism.dof == 2:
            direction = np.array([math.cos(2.0 * math.pi * n / RAYS), math.sin(2.0 * math.pi * n / RAYS)])
        direction *= weights / np.linalg.norm(direction)
        tracker = BranchTracker(mechanism, equilibrium)
        step = tracker.step(equilibrium.inputs, equilibrium.load + reach * direction)
        if step.event in (Event.FOLD, Event.INDEX_CHANGE):
            least = min(least, step.fraction * reach)
    return least


@pytest.mark.parametrize(("name", "count"), [("2RFR-paper", 12), ("2PFR-paper", 8), ("3PFR-paper", 6)])
def test_no_direction_of_128_destabilises_with_less(name, count):
    compared = 0
    for equilibrium in stable_states(name, count, 5):
        found = critical_load(equilibrium)
        reach = 100.0 * equilibrium.mechanism.units.force
        least = least_of_rays(equilibrium, reach)
        if found is None:
            assert least == math.inf
        else:
            assert found.size <= least * (1.0 + 1e-7)
            compared += 1
    assert compared >= count / 2


@pytest.mark.parametrize(("name", "count"), [("2RFR-paper", 6), ("2PFR-paper", 4), ("3PFR-paper", 4)])
def test_at_the_critical_load_stability_is_lost_and_before_it_is_not(name, count):
    for equilibrium in stable_states(name, count, 7):
        found = critical_load(equilibrium)
        if found is None:
            continue
        assert abs(found.equilibrium.stability_margin) < 0.01
        assert np.linalg.norm(found.direction) == pytest.approx(1.0, abs=1e-12)
        assert found.equilibrium.load == pytest.approx(equilibrium.load + found.load, rel=1e-12, abs=1e-12)
        tracker = BranchTracker(equilibrium.mechanism, equilibrium)
        before = tracker.step(equilibrium.inputs, equilibrium.load + 0.999 * found.load)
        assert before.event is Event.NONE
        assert before.equilibrium.is_stable
        assert tracker.step(equilibrium.inputs, equilibrium.load + 1.001 * found.load).event is not Event.NONE


def test_the_load_acts_along_the_motion_that_loses_its_stiffness():
    # the normal of det K = 0 in load space, by the least eigenvector of the stiffness there; but at a cusp
    aligned, count = 0, 0
    for equilibrium in stable_states("2RFR-paper", 12, 9):
        found = critical_load(equilibrium)
        if found is not None:
            _, vectors = np.linalg.eigh(found.equilibrium.stiffness)
            aligned += int(abs(abs(vectors[:, 0] @ found.direction) - 1.0) < 1e-4)
            count += 1
    assert count >= 6
    assert aligned >= 0.7 * count


def test_it_is_the_buckling_load_of_two_columns():
    # two upright rods with one tip, clamped at one base each: as the bases come together each carries half of the load,
    # and the pair buckles like a cantilever of twice the stiffness, at pi^2 / 4 EI / L^2 each
    up, gap = math.pi / 2.0, 1e-3
    legs = tuple(Leg(Revolute((x, 0.0)), Rod()) for x in (-gap, gap))
    mechanism = Mechanism("columns", legs, home_inputs=(up, up))
    home = min(solve_forward(mechanism, (up, up)).stable, key=lambda own: -own.pose[1])
    found = critical_load(home)
    assert found is not None
    assert found.size <= 2.0 * math.pi**2 / 4.0


def test_an_unstable_equilibrium_is_refused():
    unstable = next(own for own in solve_forward(get_mechanism("2RFR-paper"), (2.0, 1.0)) if not own.is_stable)
    with pytest.raises(ValueError, match="equilibrium must be stable, got one of index"):
        critical_load(unstable)


def test_nothing_is_found_within_a_short_reach():
    assert critical_load(home_equilibrium(get_mechanism("2RFR-paper")), reach=1.0) is None
