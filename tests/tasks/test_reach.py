"""Goals, rewards and success of reaching, as functions over a batch."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import pcm_gym
from pcm_gym.mechanism import get_mechanism
from pcm_gym.solving import BranchTracker, Event, home_equilibrium
from pcm_gym.tasks import Episodes, ReachTask, default_max_action

NAMES = pcm_gym.mechanism_names()
distances = st.floats(0.0, 4.0)


def home_episode(name: str) -> tuple[ReachTask, Episodes]:
    mechanism = get_mechanism(name)
    home, task = home_equilibrium(mechanism), ReachTask(mechanism)
    inputs = home.inputs / mechanism.units.inputs
    values = (np.array(home.state), inputs, np.zeros(mechanism.dof), task.goal_from_pose(home.pose), inputs)
    return task, Episodes(*(value[None] for value in values))


@given(first=distances, second=distances, angle=st.floats(0.0, 6.3))
def test_dense_reward_falls_with_the_distance_and_is_never_negative(first: float, second: float, angle: float) -> None:
    task = ReachTask(get_mechanism("2RFR"))
    goal = np.array([0.1, 0.5])
    places = goal + np.outer([first, second], [math.cos(angle), math.sin(angle)])
    rewards, _ = task.score(places, np.tile(goal, (2, 1)))
    near, far = np.linalg.norm(places - goal, axis=1).argsort(kind="stable")
    assert 1.0 >= rewards[near] >= rewards[far] >= 0.0


@given(distance=distances)
def test_dense_reward_is_as_documented(distance: float) -> None:
    rewards, _ = ReachTask(get_mechanism("2RFR")).score(np.array([[distance, 0.0]]), np.zeros((1, 2)))
    assert rewards[0] == pytest.approx((max(0.0, 1.0 - distance) + math.exp(-distance / 0.05)) / 2.0, abs=1e-14)


def test_sparse_reward_is_success() -> None:
    mechanism = get_mechanism("2RFR")
    achieved = np.array([[0.0, 0.0], [0.0199, 0.0], [0.0, 0.0201], [1.0, 1.0]])
    for reward_type in ("dense", "sparse"):
        rewards, successes = ReachTask(mechanism, reward_type, 0.02).score(achieved, np.zeros((4, 2)))
        assert successes.tolist() == [True, True, False, False]
    assert rewards.tolist() == [1.0, 1.0, 0.0, 0.0]


def test_turn_of_a_platform_counts_as_the_path_of_its_hinges() -> None:
    task = ReachTask(get_mechanism("3PFR"), success_distance=0.02)
    straight, turned = (task.goal_from_pose(np.array([0.1, 0.2, phi])) for phi in (0.0, 0.02 / 0.3))
    for factor, is_reached in ((0.99, True), (1.01, False)):
        other = task.goal_from_pose(np.array([0.1, 0.2, factor * 0.02 / 0.3]))
        assert task.score(straight[None], other[None])[1].tolist() == [is_reached]
    _, successes = task.score(turned[None], task.goal_from_pose(np.array([0.1, 0.2, 0.02 / 0.3 + 2.0 * math.pi]))[None])
    assert successes.tolist() == [True]


@pytest.mark.parametrize("name", NAMES)
def test_goals_and_poses_turn_into_each_other(name: str) -> None:
    mechanism = get_mechanism(name)
    task = ReachTask(mechanism)
    for seed in range(20):
        pose = np.random.default_rng(seed).uniform(-1.0, 1.0, mechanism.dof)
        np.testing.assert_allclose(task.pose_from_goal(task.goal_from_pose(pose)), pose, rtol=0.0, atol=1e-15)


@pytest.mark.parametrize("name", NAMES)
def test_starts_and_goals_are_stable_apart_and_within_the_limits(name: str) -> None:
    task, home = home_episode(name)
    mechanism, units = task.mechanism, task.mechanism.units
    stride = default_max_action(mechanism) / units.inputs
    least_margin = 0.5 * stride.min()
    generator = np.random.default_rng(0)
    starts, goals = [], []
    for _ in range(100):
        episode = task.sample_episodes(home, stride, least_margin, [generator])
        start = pcm_gym.Equilibrium(mechanism, episode.x[0], episode.inputs[0] * units.inputs, np.zeros(mechanism.dof))
        end = BranchTracker(mechanism, start).step(episode.witness[0] * units.inputs)
        assert end.event is Event.NONE
        for equilibrium in (start, end.equilibrium):
            assert equilibrium.is_stable
            assert equilibrium.within_limits
            assert equilibrium.residual < 1e-10
            assert equilibrium.singularity_margin > 1.99 * least_margin
        np.testing.assert_allclose(task.goal_from_pose(end.equilibrium.pose), episode.goal[0], rtol=0.0, atol=1e-8)
        here = task.goal_from_pose(start.pose)
        assert not task.score(here[None], episode.goal)[1][0]
        starts.append(episode.inputs[0])
        goals.append(episode.goal[0])
    # they differ, and the source of chance is the only one
    assert len(np.unique(np.round(starts, 9), axis=0)) > 80
    assert len(np.unique(np.round(goals, 9), axis=0)) == 100
    again = task.sample_episodes(home, stride, least_margin, [np.random.default_rng(0)])
    np.testing.assert_array_equal(again.inputs[0], starts[0])
    np.testing.assert_array_equal(again.goal[0], goals[0])
    np.testing.assert_array_equal(home.x, home_episode(name)[1].x)


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
        ReachTask(get_mechanism("2RFR"), **{name: value})
