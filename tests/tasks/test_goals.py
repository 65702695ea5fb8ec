"""Goals, their distances and rewards, as functions over a batch."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import pcm_gym
from pcm_gym.mechanism import get_mechanism
from pcm_gym.tasks import Goals, default_max_action

NAMES = ("2RFR", "2PFR", "3PFR")

distances = st.floats(0.0, 4.0)


@given(first=distances, second=distances, angle=st.floats(0.0, 6.3))
def test_dense_reward_falls_with_the_distance_and_is_never_negative(first: float, second: float, angle: float) -> None:
    goals = Goals(get_mechanism("2RFR"))
    goal = np.array([0.1, 0.5])
    places = goal + np.outer([first, second], [math.cos(angle), math.sin(angle)])
    rewards, _ = goals.score(places, np.tile(goal, (2, 1)))
    near, far = np.linalg.norm(places - goal, axis=1).argsort(kind="stable")
    assert 1.0 >= rewards[near] >= rewards[far] > 0.0
    if abs(first - second) > 1e-6:  # nowhere flat
        assert rewards[near] > rewards[far]


@given(distance=distances)
def test_dense_reward_is_as_documented(distance: float) -> None:
    rewards, _ = Goals(get_mechanism("2RFR")).score(np.array([[distance, 0.0]]), np.zeros((1, 2)))
    assert rewards[0] == pytest.approx((1.0 / (1.0 + distance) + math.exp(-distance / 0.05)) / 2.0, abs=1e-14)


def test_sparse_reward_is_success() -> None:
    mechanism = get_mechanism("2RFR")
    achieved = np.array([[0.0, 0.0], [0.0199, 0.0], [0.0, 0.0201], [1.0, 1.0]])
    for reward_type in ("dense", "sparse"):
        rewards, successes = Goals(mechanism, reward_type, 0.02).score(achieved, np.zeros((4, 2)))
        assert successes.tolist() == [True, True, False, False]
    assert rewards.tolist() == [1.0, 1.0, 0.0, 0.0]


def test_turn_of_a_platform_counts_as_the_path_of_its_hinges() -> None:
    goals = Goals(get_mechanism("3PFR-paper"), success_distance=0.02)  # hinges 0.3 m from the centre
    straight, turned = (goals.of_pose(np.array([0.1, 0.2, phi])) for phi in (0.0, 0.02 / 0.3))
    for factor, is_reached in ((0.99, True), (1.01, False)):
        other = goals.of_pose(np.array([0.1, 0.2, factor * 0.02 / 0.3]))
        assert goals.score(straight[None], other[None])[1].tolist() == [is_reached]
    _, successes = goals.score(turned[None], goals.of_pose(np.array([0.1, 0.2, 0.02 / 0.3 + 2.0 * math.pi]))[None])
    assert successes.tolist() == [True]


@pytest.mark.parametrize("name", NAMES)
def test_goals_and_poses_turn_into_each_other(name: str) -> None:
    mechanism = get_mechanism(name)
    goals = Goals(mechanism)
    for seed in range(20):
        pose = np.random.default_rng(seed).uniform(-1.0, 1.0, mechanism.dof)
        np.testing.assert_allclose(goals.pose(goals.of_pose(pose)), pose, rtol=0.0, atol=1e-15)


def test_default_steps_suit_the_actuator() -> None:
    assert default_max_action(get_mechanism("2RFR")).tolist() == [0.1, 0.1]
    legs = tuple(pcm_gym.Leg(pcm_gym.Prismatic((x, 0.0), 1.57, 1.57), pcm_gym.Rod(length=2.0)) for x in (-0.4, 0.4))
    assert default_max_action(pcm_gym.Mechanism("long", legs)) == pytest.approx([0.06, 0.06])


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("reward_type", "shaped"),
        ("reward_type", 1),
        ("success_distance", 0.0),
        ("success_distance", math.nan),
        ("success_distance", "near"),
    ],
)
def test_bad_arguments_are_named(name: str, value: Any) -> None:
    with pytest.raises((ValueError, TypeError), match=name):
        Goals(get_mechanism("2RFR"), **{name: value})
