"""References act within bounds, the same for the same seed and whatever runs beside them, and towards the goal."""

from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

import pcm_gym
from pcm_gym.environments.batch import MechanismVectorEnv
from pcm_gym.references import REFERENCES, ReferencePolicy, View, new_reference
from pcm_gym.references.resolved_rate import damped_solutions

REACH, COUNT = "PCM/2RFR-Reach-v0", 4
LATE: dict[str, Any] = {"actuator_lag": 2.0, "backlash": 0.01, "randomisation": {"length": 0.02}, "variants": 2}


def make_batch(environment: str, count: int, **arguments: Any) -> MechanismVectorEnv:
    env = gymnasium.make_vec(
        environment,
        num_envs=count,
        vectorization_mode="vector_entry_point",
        autoreset_mode=AutoresetMode.DISABLED,
        **arguments,
    )
    assert isinstance(env, MechanismVectorEnv)
    return env


def run(name: str, env: MechanismVectorEnv, steps: int, seed: int = 7) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return which rows end at their goal, which have lost stability, and what they cost."""
    policy = ReferencePolicy(name, env)
    observation, infos = env.reset(seed=seed)
    lost, cost = np.zeros(env.num_envs, dtype=np.bool_), np.zeros(env.num_envs)
    for _ in range(steps):
        observation, _, terminated, _, infos = env.step(policy(observation))
        lost |= infos["cost_unstable"] > 0.0
        cost += infos["cost"]
        if terminated.any():  # what comes afterwards is another episode, whose seed does not matter here
            cost[terminated] = np.inf
            observation, _ = env.reset(seed=[0] * env.num_envs, options={"reset_mask": terminated})
    return np.asarray(infos["is_success"]), lost, cost


@pytest.mark.parametrize("name", REFERENCES)
def test_actions_are_within_bounds_and_those_of_waiting_rows_do_not_matter(name: str) -> None:
    env = make_batch(REACH, COUNT)
    observation, _ = env.reset(seed=50)
    under_way = np.array([True, True, False, True])
    generators = [np.random.default_rng(row) for row in range(COUNT)]
    view = View.of(env, observation, generators, under_way)
    actions = new_reference(name).act(view)
    assert actions.shape == view.action_shape == (COUNT, 2)
    assert (np.abs(actions) <= 1.0).all()
    assert actions[under_way].any(axis=1).all() == (name != "standing still")


@pytest.mark.parametrize("name", REFERENCES)
@pytest.mark.parametrize("environment", ["PCM/3PFR-Reach-v0", "PCM/2RFR-Track-v0"])
def test_a_single_environment_is_the_first_row_of_a_batch(name: str, environment: str) -> None:
    single, batch = gymnasium.make(environment), make_batch(environment, 3)
    own, row = single.reset(seed=7)[0], batch.reset(seed=7)[0]
    one, many = ReferencePolicy(name, single), ReferencePolicy(name, batch)
    for _ in range(6):
        action, actions = one(own), many(row)
        assert (action.shape, actions.shape) == (single.action_space.shape, (3, *action.shape))
        np.testing.assert_array_equal(action, actions[0])
        own, row = single.step(action)[0], batch.step(actions)[0]


def test_planners_reach_goals_that_a_jacobian_does_not() -> None:
    env = make_batch(REACH, 16, difficulty="anywhere")
    by_name = {name: run(name, env, 98) for name in ("resolved rate", "shielded resolved rate", "planner")}
    success, lost, cost = by_name["planner"]
    assert success.mean() >= 0.9
    assert not lost.any()
    assert not cost[success].any()
    assert by_name["resolved rate"][0].mean() < 0.8
    assert by_name["resolved rate"][1].any()
    assert not by_name["shielded resolved rate"][1].any()


def test_a_planner_goes_as_many_steps_as_its_motion_has() -> None:
    env = make_batch(REACH, 6, difficulty="anywhere")
    env.reset(seed=7)
    simulation = env._simulation
    scene = simulation.scenes[0]
    planner = pcm_gym.MotionPlanner(env.mechanism, least_margin=scene.margin, roadmaps=[scene.roadmap])
    motions = planner.plan_many([env.equilibrium(row) for row in range(6)], [env.goal(row) for row in range(6)])
    lengths = [motion.length for motion in motions if motion is not None]
    assert len(lengths) == 6
    policy, errors = ReferencePolicy("planner", env), []
    observation, _ = env.reset(seed=7)
    for _ in range(max(lengths)):
        observation, _, _, _, _ = env.step(policy(observation))
        errors.append([float(np.hypot(*(env.goal(row) - env.equilibrium(row).pose))) for row in range(6)])
    for row, length in enumerate(lengths):
        assert errors[length - 1][row] < 1e-5
        assert length == 1 or errors[length - 2][row] > 1e-5


def test_who_knows_the_truth_keeps_stability_where_clamps_follow_late_and_models_are_off() -> None:
    env = make_batch(REACH, 24, difficulty="anywhere", **LATE)
    true, nominal = run("planner", env, 98), run("nominal planner", env, 98)
    assert not true[1].any()
    assert not true[2].any()
    assert true[0].mean() >= 0.9
    assert (nominal[0] & (nominal[2] == 0.0)).mean() < true[0].mean()


def test_a_goal_that_moves_is_followed_where_clamps_follow_late() -> None:
    env = make_batch("PCM/2RFR-Track-v0", 6, **LATE)
    policy = ReferencePolicy("planner", env)
    observation, _ = env.reset(seed=7)
    errors = []
    for _ in range(60):
        observation, _, _, _, infos = env.step(policy(observation))
        assert not infos["cost_unstable"].any()
        errors.append(np.linalg.norm(observation["desired_goal"] - observation["achieved_goal"], axis=1))
    assert np.max(errors[10:]) < 0.02


def test_planners_switch_sheets() -> None:
    success, lost, cost = run("planner", make_batch("PCM/2RFR-Switch-v0", 6), 100)
    assert success.all()
    assert not lost.any()
    assert not cost.any()


def test_predictive_control_goes_where_rewards_are_and_nowhere_else() -> None:
    success, lost, _ = run("predictive", make_batch(REACH, 8, difficulty="near"), 60)
    assert success.mean() >= 0.7
    assert not lost.any()


def test_bad_names_and_environments_are_refused() -> None:
    with pytest.raises(ValueError, match="name must be one of"):
        new_reference("chance")
    with pytest.raises(TypeError, match="env must be an environment of pcm_gym"):
        ReferencePolicy("random", gymnasium.make("CartPole-v1"))
    with pytest.raises(ValueError, match="seed must be"):
        ReferencePolicy("random", gymnasium.make(REACH), seed=-1)


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
    env = make_batch("PCM/3PFR-Reach-v0", 1)
    observation, _ = env.reset(seed=1)
    for key, angle in (("achieved_goal", -3.0), ("desired_goal", 3.0)):
        observation[key][0, 2:] = np.cos(angle), np.sin(angle)
    errors = View.of(env, observation, [np.random.default_rng()]).pose_errors
    assert errors[0, 2] == pytest.approx(6.0 - 2.0 * np.pi)
