"""Searches for all equilibria end: with the whole set, or by saying that their budget is spent."""

import math

import numpy as np
import pytest

import pcm_gym
from tests.reference.mechanisms import find_equilibria


@pytest.mark.parametrize("solve", [pcm_gym.solve_forward, pcm_gym.solve_inverse])
def test_search_says_that_its_budget_is_spent(solve) -> None:
    mechanism = pcm_gym.get_mechanism("2RFR-paper")
    home = pcm_gym.home_equilibrium(mechanism)
    where = home.inputs if solve is pcm_gym.solve_forward else home.pose
    with (
        pcm_gym.search_budget(1000),
        pytest.raises(pcm_gym.SearchBudgetError, match=r"'2RFR-paper'.* its budget is 1e\+03"),
    ):
        solve(mechanism, where)
    assert len(solve(mechanism, where)) > 1


def test_budget_is_that_of_each_search_in_a_context() -> None:
    mechanism = pcm_gym.get_mechanism("2RFR-paper")
    with pcm_gym.search_budget(1000):
        with pytest.raises(pcm_gym.SearchBudgetError):
            pcm_gym.home_equilibrium(mechanism)
        with pcm_gym.search_budget(float("inf")):
            assert pcm_gym.home_equilibrium(mechanism).is_stable


@pytest.mark.parametrize("wrong", [0.0, -1.0, float("nan"), "many"])
def test_budget_that_is_no_positive_number_is_refused(wrong) -> None:
    with pytest.raises((TypeError, ValueError), match="tests must be"), pcm_gym.search_budget(wrong):
        pass


def platform(short: float) -> pcm_gym.Mechanism:
    """Return a platform on three motors with one short rod."""
    legs = []
    for n, length in enumerate((1.0, 1.0, short)):
        direction = math.pi / 2.0 + 2.0 * math.pi / 3.0 * n
        x, y = math.cos(direction), math.sin(direction)
        motor = pcm_gym.Revolute(base=(0.8 * x, 0.8 * y), clamp_angle=direction + math.pi + 0.5)
        legs.append(pcm_gym.Leg(motor, pcm_gym.Rod(length, 0.05), attachment=(0.3 * x, 0.3 * y)))
    return pcm_gym.Mechanism("one short rod", tuple(legs))


def test_platforms_with_one_short_rod_have_the_equilibria_that_random_starts_find() -> None:
    """Newton's method from random rods, which knows nothing of pose cells and of how far starts may lead."""
    numbers, count = np.random.default_rng(0), 0
    for short in (0.5, 0.25, 0.15):
        mechanism = platform(short)
        inputs, load = np.array(mechanism.home_inputs), np.zeros(3)
        known = np.array([one.state for one in pcm_gym.solve_forward(mechanism, inputs, rho_max=5.0)])
        for other in find_equilibria(mechanism, inputs, load, numbers, 20_000, 5.0):
            gaps = known - other.state
            gaps[:, -1] -= 2.0 * math.pi * np.round(gaps[:, -1] / (2.0 * math.pi))
            assert np.abs(gaps).max(axis=1).min() < 1e-6, (short, other)
            count += 1
    assert count > 3


def test_search_with_too_many_pose_cells_is_given_up_aloud() -> None:
    """They are as small as the shortest rod wants them, here a thousandth of the others."""
    mechanism = platform(0.001)
    with pcm_gym.search_budget(3e6), pytest.raises(pcm_gym.SearchBudgetError, match="'one short rod'"):
        pcm_gym.solve_forward(mechanism, np.array(mechanism.home_inputs), rho_max=3.0)
