"""Controllers of the table act within bounds, and the same whatever runs beside them."""

import numpy as np
import pytest

from agents.controllers.table import new_controller, remarks
from agents.evaluation.rollouts import make_evaluation_batch, run_episodes
from agents.experiments.config import parse_config
from agents.learners.learner import new_learner
from agents.learners.policy import LearntPolicy
from agents.learners.settings import EnvironmentConfig
from pcm_gym.references import REFERENCES, View, new_reference

REACH = EnvironmentConfig(id="PCM/2RFR-Reach-v0")
COUNT = 4


@pytest.fixture(scope="module")
def policy() -> LearntPolicy:
    content = {"name": "x", "environment": {"id": REACH.id}, "total_steps": 10, "num_envs": 2}
    return LearntPolicy(new_learner(parse_config(content)), None)


def test_the_table_has_what_has_learnt_and_every_reference() -> None:
    assert list(remarks()) == ["trained", *REFERENCES]


@pytest.mark.parametrize("name", remarks())
def test_every_controller_of_the_table_acts_within_bounds(name: str, policy: LearntPolicy) -> None:
    env = make_evaluation_batch(REACH, COUNT)
    observation, _ = env.reset(seed=50)
    view = View.of(env, observation, [np.random.default_rng(row) for row in range(COUNT)])
    actions = new_controller(name, policy).act(view)
    assert actions.shape == view.action_shape == (COUNT, 2)
    assert (np.abs(actions) <= 1.0).all()


@pytest.mark.parametrize("name", REFERENCES)
def test_result_does_not_depend_on_how_many_run_side_by_side(name: str) -> None:
    seeds = [3, 1, 4, 1, 5]
    alone, together = (
        sorted(
            run_episodes(make_evaluation_batch(REACH, count), "any", new_reference(name), seeds),
            key=lambda result: result.episode,
        )
        for count in (1, 3)
    )
    assert alone == together
    assert [result.seed for result in together] == seeds
    assert [result.episode for result in together] == list(range(5))


def test_resolved_rate_controller_reaches_what_no_fold_bars() -> None:
    results = list(run_episodes(make_evaluation_batch(REACH, 4), "any", new_reference("resolved rate"), range(20)))
    assert np.mean([result.is_success for result in results]) >= 0.5
    for result in results:
        assert result.is_success or result.is_violation or result.cost > 0.0 or result.final_error > 0.0
        assert not (result.is_safe_success and result.cost > 0.0)
