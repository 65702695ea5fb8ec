"""Controllers act within bounds, the same for the same seed, and towards the goal."""

import numpy as np
import pytest

from agents.config import EnvironmentConfig
from agents.controllers import RandomController, ResolvedRateController, damped_solution, pose_error
from agents.rollouts import Controller, RunningEpisode, longest_run, make_envs, run_episodes

REACH = EnvironmentConfig(id="PCM/2RFR-Reach-v0")


@pytest.mark.parametrize("controller", [RandomController(), ResolvedRateController()], ids=lambda it: it.name)
def test_actions_are_within_bounds_whoever_acts(controller: Controller) -> None:
    episodes = [RunningEpisode.begin(env, index, 50 + index) for index, env in enumerate(make_envs(REACH, 4))]
    actions = controller.act(episodes)
    assert actions.shape == (4, episodes[0].action_count)
    assert (np.abs(actions) <= 1.0).all()


@pytest.mark.parametrize("controller", [RandomController(), ResolvedRateController()], ids=lambda it: it.name)
def test_result_does_not_depend_on_how_many_run_side_by_side(controller: Controller) -> None:
    seeds = [3, 1, 4, 1, 5]
    alone = list(run_episodes(make_envs(REACH, 1), controller, seeds))
    together = list(run_episodes(make_envs(REACH, 3), controller, seeds))
    assert alone == together
    assert [result.seed for result in together] == seeds
    assert [result.episode for result in together] == list(range(5))


def test_starts_and_goals_are_the_same_for_every_controller() -> None:
    env = make_envs(REACH, 1)[0]
    goals = []
    for controller in (RandomController(), ResolvedRateController()):
        episode = RunningEpisode.begin(env, 0, 11)
        goals.append(episode.observation["desired_goal"])
        episode.step(controller.act([episode])[0])
    np.testing.assert_array_equal(goals[0], goals[1])


def test_resolved_rate_controller_reaches_what_no_fold_bars() -> None:
    results = list(run_episodes(make_envs(REACH, 4), ResolvedRateController(), range(20)))
    assert np.mean([result.is_success for result in results]) >= 0.5
    for result in results:
        assert result.is_success or result.is_violation or result.cost > 0.0 or result.final_error > 0.0
        assert not (result.is_safe_success and result.cost > 0.0)


def test_damped_solution_solves_a_regular_system_as_damping_vanishes() -> None:
    jacobian = np.array([[2.0, 1.0], [0.5, -1.0]])
    error = np.array([0.3, -0.2])
    np.testing.assert_allclose(jacobian @ damped_solution(jacobian, error, 1e-9), error, rtol=1e-12)


def test_damped_solution_is_bounded_at_a_singularity() -> None:
    jacobian = np.array([[1.0, 0.0], [0.0, 0.0]])
    assert np.abs(damped_solution(jacobian, np.array([0.0, 1.0]), 0.05)).max() == 0.0
    near = np.array([[1.0, 0.0], [0.0, 1e-8]])
    assert np.abs(damped_solution(near, np.array([0.0, 1.0]), 0.05)).max() < 1e-5


@pytest.mark.parametrize("jacobian", [np.zeros((2, 2)), np.full((2, 2), np.nan), np.full((2, 2), np.inf)])
def test_damped_solution_is_zero_without_a_usable_jacobian(jacobian: np.ndarray) -> None:
    np.testing.assert_array_equal(damped_solution(jacobian, np.ones(2), 0.05), np.zeros(2))


def test_orientation_error_goes_the_shorter_way_round() -> None:
    error = pose_error(np.array([1.0, 0.0, 3.0]), np.array([0.0, 0.0, -3.0]))
    np.testing.assert_allclose(error, [1.0, 0.0, 6.0 - 2.0 * np.pi])


@pytest.mark.parametrize(
    ("flags", "expected"),
    [([], 0), ([False], 0), ([True], 1), ([True, True, False, True], 2), ([False, True, True], 2)],
)
def test_longest_run_counts_successive_flags(flags: list[bool], expected: int) -> None:
    assert longest_run(np.array(flags, dtype=np.bool_)) == expected
