"""Starts and goals of the tasks: they can be met as promised, are spread evenly, and are those asked for."""

import math
from typing import Any

import gymnasium
import numpy as np
import pytest
from scipy import stats

import pcm_gym
from pcm_gym.tasks import Reach, Scene
from pcm_gym.tasks.distances import distances
from tests.environments.rollouts import MECHANISMS, assert_same, make_bare, make_native

NAMES = MECHANISMS


def steps_towards(env: Any, inputs: Any) -> list[Any]:
    """Go straight to these inputs with steps of the agent; return what each step returned."""
    results = []
    while True:
        way = (inputs - env.equilibrium.inputs) / env.max_action
        longest = np.abs(way).max()
        results.append(env.step(way / max(longest, 1.0)))
        if longest <= 1.0 or results[-1][2] or results[-1][3]:
            return results


def assert_free(results: list[Any]) -> None:
    """None of these steps ended the episode or cost anything."""
    assert [result[2:4] for result in results] == [(False, False)] * len(results)
    assert [result[-1]["cost"] for result in results] == [0.0] * len(results)


# Reach


@pytest.mark.parametrize("name", NAMES)
def test_near_goals_are_reached_without_cost_by_a_straight_walk_to_their_witness(name: str) -> None:
    env = make_bare(f"PCM/{name}-Reach-v0", difficulty="near", hold_steps=1)
    for seed in range(40):
        _, info = env.reset(seed=seed)
        assert (info["is_success"], env.equilibrium.is_stable, env.equilibrium.within_limits) == (False, True, True)
        results = steps_towards(env, env.witness.inputs)
        assert_free(results)
        assert len(results) <= 16
        np.testing.assert_allclose(env.equilibrium.inputs, env.witness.inputs, rtol=0.0, atol=1e-9)
        assert results[-1][-1]["is_success"], seed
        np.testing.assert_allclose(env.equilibrium.pose, env.goal, rtol=0.0, atol=1e-7)


def scene_of(env: Any) -> Scene:
    scene: Scene = env._simulation.scenes[0]
    return scene


def make_where(environment_id: str, **keywords: Any) -> Any:
    """The environment; skips where the mechanism has no such tier."""
    env = make_bare(environment_id, **keywords)
    try:
        env.reset(seed=0)
    except ValueError as error:
        if f"difficulty must not be {keywords['difficulty']!r} for mechanism {env.mechanism.name!r}" not in str(error):
            raise
        pytest.skip(str(error))
    return env


def go_by(env: Any, nodes: Any, end: pcm_gym.Equilibrium) -> list[Any]:
    """Go over these nodes of the scene's roadmap to an equilibrium; return what each step returned."""
    inputs = [*scene_of(env).roadmap.inputs[nodes[1:-1]], end.inputs]
    return [result for place in inputs for result in steps_towards(env, place)]


def node_of(scene: Scene, equilibrium: pcm_gym.Equilibrium) -> int:
    """The node of the cell on the equilibrium's sheet: the one that a straight step leads to."""
    roadmap = scene.roadmap
    cell = roadmap.raster.cells_of(equilibrium.inputs[None])[0]
    middle = roadmap.inputs[np.flatnonzero(roadmap.cells == cell)[0]]
    there = pcm_gym.BranchTracker(scene.mechanism, equilibrium).step(middle).equilibrium
    own = np.flatnonzero(roadmap.cells == cell)
    return int(own[np.abs(roadmap.states[own] - there.state).max(axis=1).argmin()])


@pytest.mark.parametrize("name", NAMES)
def test_detours_are_needed_and_free_of_cost(name: str) -> None:
    """The straight way of the inputs does not lead to the goal, by the tracker; the one along the roadmap arrives."""
    env = make_where(f"PCM/{name}-Reach-v0", difficulty="detour", hold_steps=1)
    scene = scene_of(env)
    for seed in range(10):
        env.reset(seed=seed)
        start, goal = env.equilibrium, env.witness
        straight = pcm_gym.BranchTracker(env.mechanism, start).step(goal.inputs)
        is_lost = straight.event in (pcm_gym.Event.FOLD, pcm_gym.Event.INDEX_CHANGE)
        assert is_lost or np.abs(straight.equilibrium.state - goal.state).max() > 1e-6
        results = go_by(env, scene.roadmap.way(node_of(scene, start), node_of(scene, goal)), goal)
        assert_free(results)
        assert results[-1][-1]["is_success"]


@pytest.mark.parametrize("name", NAMES)
def test_goals_anywhere_are_reached_within_four_fifths_of_the_time(name: str) -> None:
    """By the distances over hubs, which the shortest way along the axes of the roadmap bounds from both sides."""
    env = make_native(f"PCM/{name}-Reach-v0", 64)
    env.reset(seed=0)
    scene, limit = scene_of(env), gymnasium.spec(f"PCM/{name}-Reach-v0").max_episode_steps
    assert limit is not None
    own, rows = distances(scene), env._simulation.rows
    witness = scene.states(rows.witness[:, scene.mechanism.leg_count :], rows.witness[:, : scene.mechanism.leg_count])
    for row in range(8):
        start = env.equilibrium(row)
        goal = pcm_gym.Equilibrium.unchecked(
            scene.mechanism, witness.x[row], scene.mechanism.units.inputs_from_kernel(witness.inputs[row]), start.load
        )
        ends = np.array([node_of(scene, start)]), np.array([node_of(scene, goal)])
        steps = own.most(*ends)[0]
        assert steps <= 0.8 * limit
        along_axes = own.steps_per_way * scene.roadmap.step_counts(ends[0])[0][0, ends[1][0]]
        hub = 2.0 * 2.0 * own.steps_per_way  # goals are up to two ways from a hub, there and back
        assert along_axes / scene.mechanism.leg_count <= steps <= along_axes + hub


# Two sliders on vertical rails, with the tip above them: they never meet a fold.
NO_FOLDS = pcm_gym.Mechanism(
    "no folds",
    legs=tuple(
        pcm_gym.Leg(pcm_gym.Prismatic((x, 0.0), math.pi / 2.0, math.pi / 2.0, (-0.5, 0.5)), pcm_gym.Rod(1.0, 1.0))
        for x in (-0.35, 0.35)
    ),
)


@pytest.mark.parametrize(
    ("task", "difficulty"), [("Reach", "detour"), ("Switch", "around"), ("Switch", "near"), ("Switch", "far")]
)
def test_tiers_that_a_mechanism_does_not_have_are_refused_by_name(task: str, difficulty: str) -> None:
    env = make_bare("PCM/2RFR-Reach-v0", mechanism=NO_FOLDS, task=task, difficulty=difficulty)
    with pytest.raises(ValueError, match=f"difficulty must not be '{difficulty}' for mechanism 'no folds'"):
        env.reset(seed=0)


@pytest.mark.parametrize("name", ["2RFR-paper", "2PFR"])
def test_starts_are_spread_evenly_over_the_poses_of_every_sheet(name: str) -> None:
    """Against the atlas, whose sampling is uniform by construction.

    In ten bins each of x and of y they differ from it by no more than chance, so home is a place like any other. In the
    2RFR itself the reserve closes a way to half of its home branch.
    """
    env = make_bare("PCM/2RFR-Reach-v0", mechanism=name)
    scene, legs = scene_of(env), env.mechanism.leg_count
    states = scene.starts(np.random.default_rng(0).random((2000, 1 + legs)))
    atlas = pcm_gym.build_atlas(scene.mechanism, pitch=0.05, input_cells=48, seed_nodes=4, progress=False)
    sampled = atlas.sample(np.random.default_rng(0), 6000, branch=atlas.home_branch)
    clear = np.array([equilibrium.singularity_margin >= scene.reserve for equilibrium in sampled])
    expected = np.array([equilibrium.pose for equilibrium in sampled])[clear]
    found = scene.mechanism.units.length * states.x[:, 2 * legs :]
    for axis in range(2):
        edges = np.quantile(expected[:, axis], np.linspace(0.0, 1.0, 11))
        edges[[0, -1]] = -np.inf, np.inf
        table = [np.histogram(values[:, axis], edges)[0] for values in (found, expected)]
        assert stats.chi2_contingency(table).pvalue > 1e-4, (axis, table)


@pytest.mark.parametrize("name", NAMES)
def test_equal_seeds_give_equal_episodes_whatever_the_batch(name: str) -> None:
    for difficulty in ("near", "anywhere"):
        batch = make_native(f"PCM/{name}-Reach-v0", 7, difficulty=difficulty)
        observation, _ = batch.reset(seed=3)
        for row in (0, 6):
            single = make_bare(f"PCM/{name}-Reach-v0", difficulty=difficulty).reset(seed=3 + row)[0]
            assert_same({key: array[row] for key, array in observation.items()}, single)


# Track


@pytest.mark.parametrize(("path", "difficulty"), [("circle", "inside"), ("eight", "edge"), ("spline", "edge")])
@pytest.mark.parametrize("name", NAMES)
def test_paths_are_followed_without_cost_by_a_controller_that_knows_the_kinematics(
    name: str, path: str, difficulty: str
) -> None:
    """Steps of Newton's method with the forward Jacobian, which is no part of how the paths are made."""
    env = make_bare(f"PCM/{name}-Track-v0", path=path, difficulty=difficulty)
    for seed in range(4):
        env.reset(seed=seed)
        period = env.task.period
        goals = env._simulation.rows.goals[0].copy()
        for step in range(1, period + 1):
            goal = env.task.goals.pose(goals[step % period])
            inputs = _inverse(env.equilibrium, goal)
            result = env.step((inputs - env.equilibrium.inputs) / env.max_action)
            assert_free([result])
            np.testing.assert_allclose(env.equilibrium.pose[:2], goal[:2], rtol=0.0, atol=1e-6)
        assert result[-1]["is_success"]
        assert result[-1]["share_at_goal"] == 1.0
        assert result[-1]["error"] == pytest.approx(0.0, abs=1e-6)
        np.testing.assert_allclose(goals[0], env._simulation.goal(0), rtol=0.0, atol=1e-12)


def test_tracking_is_a_success_by_its_share_of_all_steps() -> None:
    """Beside the counts of this test: of the steps at the goal, and of all."""
    env = make_bare("PCM/2RFR-Track-v0")
    env.reset(seed=1)
    at_goal = 0
    for step in range(1, 201):
        inputs = env.equilibrium.inputs
        if step % 40 > 5:  # now and then it waits
            wanted = env._simulation.rows.goals[0][step % env.task.period]
            inputs = _inverse(env.equilibrium, env.task.goals.pose(wanted))
        *_, info = env.step(np.clip((inputs - env.equilibrium.inputs) / env.max_action, -1.0, 1.0))
        at_goal += info["error"] <= env.success_distance
        assert info["share_at_goal"] == pytest.approx(at_goal / step)
        assert info["is_success"] == (step >= env.task.period and at_goal >= 0.8 * step)
    assert 0 < at_goal < 200


def _inverse(equilibrium: pcm_gym.Equilibrium, pose: Any) -> Any:
    tracker = pcm_gym.BranchTracker(equilibrium.mechanism, equilibrium)
    for _ in range(8):
        here = tracker.equilibrium
        error = pose - here.pose
        error[2:] = np.remainder(error[2:] + np.pi, 2.0 * np.pi) - np.pi
        if np.abs(error).max() < 1e-9:
            break
        tracker.step(here.inputs + np.linalg.solve(here.forward_jacobian, error))
    return tracker.equilibrium.inputs


def test_circles_are_round_and_figures_of_eight_cross_themselves() -> None:
    for path in ("circle", "eight"):
        env = make_native("PCM/2RFR-Track-v0", 20, path=path)
        env.reset(seed=0)
        for goals in env._simulation.rows.goals:
            centre = goals.mean(axis=0)
            radii = np.hypot(*(goals - centre).T)
            if path == "circle":
                np.testing.assert_allclose(radii, radii[0], rtol=1e-9)
                assert radii[0] >= 2.0 * env.task.goals.tolerance  # who stands still is not at the goal
            else:  # twice around the crossing, in opposite senses
                assert radii.min() < 0.2 * radii.max()
                x, y = (goals - centre).T
                area = 0.5 * np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))
                assert abs(area) < 1e-9


def test_the_goal_ahead_is_seen() -> None:
    env = make_bare("PCM/2RFR-Track-v0")
    names = [element.name for element in env.elements]
    observation, _ = env.reset(seed=0)
    seen = [observation["observation"][names.index("x_in_1")]]
    for _ in range(5):
        observation, *_ = env.step(np.zeros(2))
        assert observation["desired_goal"][0] == seen[-1]
        seen.append(observation["observation"][names.index("x_in_1")])
    assert len(set(seen)) == 6


# Switch


@pytest.mark.parametrize("environment_id", [f"PCM/{name}-Switch-v0" for name in NAMES])
def test_switches_lead_to_another_stable_equilibrium_at_the_same_inputs(environment_id: str) -> None:
    env = make_where(environment_id, difficulty="around", on_instability="terminate")
    rho_max = 9.0 if env.mechanism.leg_count == 2 else 6.5
    for seed in range(3):
        env.reset(seed=seed)
        start = env.equilibrium
        np.testing.assert_array_equal(env.witness.inputs, start.inputs)
        np.testing.assert_allclose(env.witness.pose, env.goal, rtol=0.0, atol=1e-12)
        members = pcm_gym.solve_forward(
            env.mechanism, start.inputs, rho_max=max(rho_max, *(rod.rho for rod in start.rods))
        )
        goals = [found for found in members.stable if np.allclose(found.pose, env.goal, atol=1e-6)]
        assert len(goals) == 1
        assert np.linalg.norm(goals[0].pose - start.pose) > env.success_distance
        assert (
            env.reset(seed=seed, options={"equilibrium": start, "goal": start})[1]["is_success"] is False
        )  # held once
        env.step(np.zeros(env.action_space.shape))
        assert env.step(np.zeros(env.action_space.shape))[-1]["is_success"]


@pytest.mark.parametrize("difficulty", ["near", "far"])
@pytest.mark.parametrize("name", NAMES)
def test_a_stable_way_leads_to_the_other_equilibrium(name: str, difficulty: str) -> None:
    env = make_where(f"PCM/{name}-Switch-v0", difficulty=difficulty, on_instability="terminate", hold_steps=1)
    scene = scene_of(env)
    for seed in range(3):
        env.reset(seed=seed)
        start, goal = env.equilibrium, env.witness
        step = np.array(scene.stride) * env.mechanism.units.inputs
        roadmap = pcm_gym.build_roadmap(env.mechanism, [start, goal], step=step, least_margin=scene.reserve)
        way = roadmap.way(*roadmap.seeds)
        assert (len(way) - 1 <= 3 * 30) if difficulty == "near" else (len(way) - 1 > 60 / scene.steps_per_way)
        inputs = [*roadmap.inputs[way], goal.inputs]
        results = [result for place in inputs for result in steps_towards(env, place)]
        assert_free(results)
        assert results[-1][-1]["is_success"]


@pytest.mark.parametrize("name", NAMES)
def test_a_fall_leads_to_goals_that_no_stable_way_leads_to(name: str) -> None:
    env = make_where(f"PCM/{name}-Switch-v0", difficulty="fall", on_instability="snap", hold_steps=1)
    scene, reached = scene_of(env), 0
    step = np.array(scene.stride) * env.mechanism.units.inputs
    for seed in range(6):
        _, info = env.reset(seed=seed)
        assert info["fewest_falls"] >= 1
        goal = env.witness
        roadmap = pcm_gym.build_roadmap(env.mechanism, [env.equilibrium, goal], step=step, least_margin=scene.reserve)
        first, last = roadmap.seeds
        assert roadmap.components[first] != roadmap.components[last]
        falls = pcm_gym.find_falls(roadmap)
        if info["fewest_falls"] > 1 or roadmap.step_counts([first], falls)[1][0, last] != 1.0:
            continue  # the other sheets that it leads over are not charted here
        leaves = [pair for pair in falls if np.isfinite(roadmap.step_counts([first])[0][0, pair[0]])]
        edge, landing = next(pair for pair in leaves if len(roadmap.way(pair[1], last)))
        results = [result for node in roadmap.way(first, edge) for result in steps_towards(env, roadmap.inputs[node])]
        assert_free(results)
        before = env.equilibrium.energy
        over = steps_towards(env, roadmap.inputs[landing])
        assert sum(result[-1]["losses"] for result in over) == 1
        released = sum(result[-1]["energy_released"] for result in over)
        assert released > 0.0
        # what the actuators do on the way is little
        assert released == pytest.approx(before - env.equilibrium.energy, rel=0.5, abs=0.05 * before)
        np.testing.assert_allclose(env.equilibrium.state, roadmap.states[landing], rtol=0.0, atol=1e-6)
        inputs = [*roadmap.inputs[roadmap.way(landing, last)[1:]], goal.inputs]
        results = [result for place in inputs for result in steps_towards(env, place)]
        assert_free(results)
        assert results[-1][-1]["is_success"]
        reached += 1
    assert reached > 0


def test_falls_as_a_goal_need_falls_that_are_followed() -> None:
    with pytest.raises(ValueError, match=r"on_instability must be one of \['snap'\] for Switch"):
        make_bare("PCM/2RFR-Switch-v0", difficulty="fall")


# What a reset is asked for


@pytest.mark.parametrize("task", ["Reach", "Track"])
@pytest.mark.parametrize("name", NAMES)
def test_reset_takes_inputs(name: str, task: str) -> None:
    env = make_bare(f"PCM/{name}-{task}-v0")
    home = pcm_gym.home_equilibrium(env.mechanism)
    inputs = home.inputs + 0.3 * env.max_action
    env.reset(seed=0, options={"inputs": inputs.tolist()})
    expected = pcm_gym.BranchTracker(env.mechanism, home).step(inputs).equilibrium
    np.testing.assert_array_equal(env.equilibrium.inputs, expected.inputs)
    np.testing.assert_allclose(env.equilibrium.pose, expected.pose, rtol=0.0, atol=1e-10)


@pytest.mark.parametrize("environment_id", pcm_gym.environment_ids())
def test_reset_takes_an_equilibrium(environment_id: str) -> None:
    env = make_bare(environment_id)
    env.reset(seed=0)
    start = env.equilibrium
    for target in (env, make_bare(environment_id)):
        target.reset(seed=1, options={"equilibrium": start})
        np.testing.assert_array_equal(target.equilibrium.state, start.state)
        np.testing.assert_array_equal(target.equilibrium.inputs, start.inputs)


@pytest.mark.parametrize("difficulty", ["near", "anywhere", "detour"])
def test_a_given_start_has_goals_of_every_kind(difficulty: str) -> None:
    env = make_bare("PCM/2RFR-Reach-v0", difficulty=difficulty)
    env.reset(seed=0)
    start = env.equilibrium
    goals = set()
    for seed in range(5):
        env.reset(seed=seed, options={"equilibrium": start})
        assert np.array_equal(env.equilibrium.state, start.state)
        goals.add(tuple(env.goal))
    assert len(goals) == 5


def test_equal_starts_are_charted_once(monkeypatch: pytest.MonkeyPatch) -> None:
    charted = []

    def counted(*arguments: Any, **keywords: Any) -> Any:
        charted.append(arguments)
        return pcm_gym.build_roadmap(*arguments, **keywords)

    monkeypatch.setattr("pcm_gym.tasks.scene.build_roadmap", counted)
    for difficulty in ("near", "anywhere"):
        env = make_bare("PCM/2RFR-Reach-v0", difficulty=difficulty)
        env.reset(seed=0)
        for inputs in ((1.31, 2.07), [1.31, 2.07], np.array([1.31, 2.07])):
            env.reset(options={"inputs": inputs})
            np.testing.assert_array_equal(env.equilibrium.inputs, inputs)
    assert len(charted) <= 2  # once from home, if no test before has been there, and once from these inputs


@pytest.mark.parametrize("name", NAMES)
def test_reset_takes_a_goal(name: str) -> None:
    env = make_bare(f"PCM/{name}-Reach-v0", hold_steps=1)
    env.reset(seed=3)
    pose = env.goal
    options = {"goal": tuple(pose)}
    observation, _ = env.reset(seed=0, options=options)
    assert options == {"goal": tuple(pose)}
    np.testing.assert_allclose(env.goal, pose, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(observation["desired_goal"], env.task.goals.of_pose(pose), rtol=0.0, atol=1e-15)
    for goal in (env.equilibrium.pose, env.equilibrium):
        assert env.reset(options={"goal": goal, "equilibrium": env.equilibrium})[1]["is_success"]


def test_goals_with_inputs_are_equilibria() -> None:
    env = make_bare("PCM/2RFR-Switch-v0")
    with pytest.raises(ValueError, match="goal must be an Equilibrium"):
        env.reset(options={"goal": (0.0, 0.5)})


@pytest.mark.parametrize("name", NAMES)
def test_reset_takes_a_load_for_one_episode(name: str) -> None:
    environment_id = f"PCM/{name}-Reach-v0"
    env = make_bare(environment_id, load=(0.0, 0.02))
    padding = [0.0] * (env.mechanism.dof - 2)
    env.reset(seed=0)
    assert env.equilibrium.load.tolist() == pytest.approx([0.0, 0.02, *padding])
    free = env.reset(seed=0, options={"load": [0.0] * env.mechanism.dof})[0]
    assert env.equilibrium.load.tolist() == [0.0] * env.mechanism.dof
    assert_same(free, make_bare(environment_id).reset(seed=0)[0])
    env.step(env.action_space.high)
    assert env.equilibrium.load.tolist() == [0.0] * env.mechanism.dof
    env.reset()
    assert env.equilibrium.load.tolist() == pytest.approx([0.0, 0.02, *padding])


@pytest.mark.parametrize("name", NAMES)
def test_options_hold_for_every_row_of_a_batch(name: str) -> None:
    env, batch = make_bare(f"PCM/{name}-Reach-v0"), make_native(f"PCM/{name}-Reach-v0", 2)
    env.reset(seed=5)
    options = {"equilibrium": env.equilibrium, "goal": env.goal, "load": (0.0, 0.01)}
    observation, _ = batch.reset(seed=0, options=options)
    for row in range(2):
        expected, _ = env.reset(seed=row, options=options)
        assert_same({key: array[row] for key, array in observation.items()}, expected)


def test_tasks_name_arguments_of_others() -> None:
    for task, name in (("Reach", "path"), ("Switch", "path")):
        with pytest.raises(ValueError, match=name):
            make_bare(f"PCM/2RFR-{task}-v0", **{name: "near"})
    for task, name in (("Reach", "difficulty"), ("Track", "difficulty"), ("Switch", "difficulty"), ("Track", "path")):
        with pytest.raises(ValueError, match=name):
            make_bare(f"PCM/2RFR-{task}-v0", **{name: "farthest"})
    with pytest.raises(ValueError, match="task"):
        make_bare("PCM/2RFR-Reach-v0", task="Push")
    assert isinstance(make_bare("PCM/2RFR-Reach-v0").task, Reach)
