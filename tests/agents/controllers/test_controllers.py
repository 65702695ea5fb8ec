"""Controllers act within bounds, the same for the same seed, and towards the goal."""

import numpy as np
import pytest

from agents.controllers.controller import Controller
from agents.controllers.random import RandomController
from agents.controllers.resolved_rate import ResolvedRateController, damped_solutions, pose_error
from agents.controllers.table import CONTROLLERS, new_controller
from agents.controllers.view import View
from agents.evaluation.rollouts import make_evaluation_batch, run_episodes
from agents.experiments.config import parse_config
from agents.learners.learner import new_learner
from agents.learners.policy import LearntPolicy
from agents.learners.settings import EnvironmentConfig

REACH = EnvironmentConfig(id="PCM/2RFR-Reach-v0")
COUNT = 4


@pytest.fixture(scope="module")
def policy() -> LearntPolicy:
    content = {"name": "x", "environment": {"id": REACH.id}, "total_steps": 10, "num_envs": 2}
    return LearntPolicy(new_learner(parse_config(content)), None)


@pytest.fixture
def view() -> View:
    env = make_evaluation_batch(REACH, COUNT)
    observation, _ = env.reset(seed=50)
    under_way = np.array([True, True, False, True])
    generators = [np.random.default_rng(row) for row in range(COUNT)]
    return View(env, observation, np.zeros(COUNT, dtype=np.int64), under_way, generators)


@pytest.mark.parametrize("name", CONTROLLERS)
def test_every_controller_of_the_table_acts_within_bounds(name: str, policy: LearntPolicy, view: View) -> None:
    actions = new_controller(name, policy).act(view)
    assert actions.shape == view.action_shape == (COUNT, 2)
    assert (np.abs(actions) <= 1.0).all()
    assert actions[view.under_way].any(axis=1).all()


@pytest.mark.parametrize("controller", [RandomController(), ResolvedRateController()], ids=["random", "resolved rate"])
def test_result_does_not_depend_on_how_many_run_side_by_side(controller: Controller) -> None:
    seeds = [3, 1, 4, 1, 5]
    alone, together = (
        sorted(
            run_episodes(make_evaluation_batch(REACH, count), "any", controller, seeds),
            key=lambda result: result.episode,
        )
        for count in (1, 3)
    )
    assert alone == together
    assert [result.seed for result in together] == seeds
    assert [result.episode for result in together] == list(range(5))


def test_resolved_rate_controller_reaches_what_no_fold_bars() -> None:
    results = list(run_episodes(make_evaluation_batch(REACH, 4), "any", ResolvedRateController(), range(20)))
    assert np.mean([result.is_success for result in results]) >= 0.5
    for result in results:
        assert result.is_success or result.is_violation or result.cost > 0.0 or result.final_error > 0.0
        assert not (result.is_safe_success and result.cost > 0.0)


def test_damped_solutions_solve_regular_systems_as_damping_vanishes() -> None:
    jacobians = np.array([[[2.0, 1.0], [0.5, -1.0]], [[0.0, 3.0], [1.0, 0.2]]])
    errors = np.array([[0.3, -0.2], [0.1, 0.4]])
    solutions = damped_solutions(jacobians, errors, 1e-9)
    np.testing.assert_allclose(np.einsum("nij,nj->ni", jacobians, solutions), errors, rtol=1e-12)


def test_damped_solution_is_bounded_at_a_singularity() -> None:
    at, near = np.diag([1.0, 0.0]), np.diag([1.0, 1e-8])
    solutions = damped_solutions(np.array([at, near]), np.tile([0.0, 1.0], (2, 1)), 0.05)
    assert np.abs(solutions[0]).max() == 0.0
    assert np.abs(solutions[1]).max() < 1e-5


def test_damped_solution_is_zero_without_a_usable_jacobian_and_unharmed_beside_one() -> None:
    unusable = [np.zeros((2, 2)), np.full((2, 2), np.nan), np.full((2, 2), np.inf)]
    solutions = damped_solutions(np.array([*unusable, np.eye(2)]), np.ones((4, 2)), 1e-9)
    np.testing.assert_array_equal(solutions[:3], np.zeros((3, 2)))
    np.testing.assert_allclose(solutions[3], np.ones(2))


def test_orientation_error_goes_the_shorter_way_round() -> None:
    error = pose_error(np.array([1.0, 0.0, 3.0]), np.array([0.0, 0.0, -3.0]))
    np.testing.assert_allclose(error, [1.0, 0.0, 6.0 - 2.0 * np.pi])
