"""Motions: what is planned is what the tracker goes, and refusals say what stands in the way."""

import math
from typing import Any

import numpy as np
import pytest

import pcm_gym
from pcm_gym import BranchTracker, Equilibrium, Event, Mechanism, MotionPlanner, Obstacle, PlanningError, plan_motion
from pcm_gym.arrays import Array
from pcm_gym.solving import Roadmap, build_roadmap

MARGIN = 0.05  # half of a motor's usual step
COUNT = 40


@pytest.fixture(scope="module")
def mechanism() -> Mechanism:
    return pcm_gym.get_mechanism("2RFR-paper")


@pytest.fixture(scope="module")
def roadmap(mechanism: Mechanism) -> Roadmap:
    home = pcm_gym.home_equilibrium(mechanism)
    return build_roadmap(mechanism, [home], step=[0.1, 0.1], least_margin=MARGIN)


@pytest.fixture(scope="module")
def pairs(roadmap: Roadmap) -> list[tuple[int, int]]:
    return np.random.default_rng(3).integers(len(roadmap), size=(COUNT, 2)).tolist()


@pytest.fixture(scope="module")
def motions(mechanism: Mechanism, roadmap: Roadmap, pairs: list[tuple[int, int]]) -> list[pcm_gym.Motion]:
    planner = MotionPlanner(mechanism, least_margin=MARGIN, roadmaps=[roadmap])
    starts, goals = ([roadmap.equilibrium(pair[k]) for pair in pairs] for k in range(2))
    found = planner.plan_many(starts, goals)
    planned = [motion for motion in found if motion is not None]
    assert len(planned) == COUNT
    return planned


def partners(roadmap: Roadmap) -> tuple[int, int]:
    """Return two nodes of one cell: of those the pair whose smaller margin is the largest."""
    order = np.argsort(roadmap.cells, kind="stable")
    first, second = order[:-1], order[1:]
    pairs = np.column_stack([first, second])[roadmap.cells[first] == roadmap.cells[second]]
    margins = [min(roadmap.equilibrium(node).singularity_margin for node in pair) for pair in pairs[::50].tolist()]
    chosen: tuple[int, int] = tuple(pairs[::50][int(np.argmax(margins))].tolist())
    return chosen


def outermost(mechanism: Mechanism) -> Array:
    """Return a pose farther from the first base than its rod is long."""
    first = mechanism.legs[0]
    pose = np.zeros(mechanism.dof)
    pose[:2] = np.add(first.actuator.base, [1.1 * first.rod.length, 0.0])
    return pose


def test_the_tracker_goes_every_step_and_meets_every_equilibrium(motions: list[pcm_gym.Motion]) -> None:
    for motion in motions:
        tracker = BranchTracker(motion.mechanism, motion.equilibria[0])
        for wanted in motion.equilibria[1:]:
            step = tracker.step(wanted.inputs)
            assert step.event is Event.NONE
            np.testing.assert_allclose(step.equilibrium.state, wanted.state, rtol=1e-7, atol=1e-9)
            assert step.equilibrium.is_stable
            assert step.equilibrium.singularity_margin >= MARGIN * (1.0 - 1e-6)


def test_steps_are_within_the_longest_ones_and_ends_are_those_asked_for(
    motions: list[pcm_gym.Motion], roadmap: Roadmap, pairs: list[tuple[int, int]]
) -> None:
    for motion, (start, goal) in zip(motions, pairs, strict=True):
        assert motion.length == len(motion.inputs) - 1 == len(motion.equilibria) - 1
        assert np.abs(np.diff(motion.inputs, axis=0)).max(initial=0.0) <= 0.1 * (1.0 + 1e-12)
        for wanted, found in ((start, motion.equilibria[0]), (goal, motion.equilibria[-1])):
            np.testing.assert_allclose(found.inputs, roadmap.inputs[wanted], rtol=0.0, atol=1e-12)
            np.testing.assert_allclose(found.state, roadmap.states[wanted], rtol=1e-6, atol=1e-8)


def test_none_is_longer_than_the_shortest_way_on_the_roadmap_and_most_are_much_shorter(
    motions: list[pcm_gym.Motion], roadmap: Roadmap, pairs: list[tuple[int, int]]
) -> None:
    ways = np.array([len(roadmap.way(*pair)) - 1 for pair in pairs])
    lengths = np.array([motion.length for motion in motions])
    assert (lengths <= ways).all()
    assert lengths.mean() < 0.75 * ways.mean()


def test_where_the_straight_way_keeps_stability_it_is_the_motion(
    motions: list[pcm_gym.Motion], roadmap: Roadmap, pairs: list[tuple[int, int]]
) -> None:
    """No motion can have fewer steps than the straight line of the inputs."""
    straight = 0
    for motion, (start, goal) in zip(motions, pairs, strict=True):
        here, there = roadmap.equilibrium(start), roadmap.equilibrium(goal)
        least = math.ceil(np.abs(there.inputs - here.inputs).max() / 0.1 - 1e-9)
        assert motion.length >= least
        tracker, keeps = BranchTracker(motion.mechanism, here), True
        for part in (1 + np.arange(least)) / least:
            step = tracker.step(here.inputs + part * (there.inputs - here.inputs))
            keeps = keeps and step.event is Event.NONE and step.equilibrium.singularity_margin >= 1.05 * MARGIN
        if keeps and np.allclose(tracker.equilibrium.state, there.state, rtol=1e-6, atol=1e-8):
            straight += 1
            assert motion.length == least
    assert straight >= 3


@pytest.mark.parametrize("name", ["2RFR", "2PFR", "3PFR"])
def test_a_pose_is_met_in_any_working_mode(name: str) -> None:
    own = pcm_gym.get_mechanism(f"{name}-paper")
    start = pcm_gym.home_equilibrium(own)
    there = BranchTracker(own, start).step(start.inputs + 0.1 * np.arange(1, own.leg_count + 1) * own.units.length)
    assert there.event is Event.NONE
    motion = plan_motion(start, there.equilibrium.pose)
    np.testing.assert_allclose(motion.equilibria[-1].pose, there.equilibrium.pose, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(motion.poses[-1], there.equilibrium.pose, rtol=0.0, atol=1e-9)
    assert motion.equilibria[0] == start
    assert motion.length <= plan_motion(start, there.equilibrium).length


def test_inputs_are_met_and_of_several_equilibria_there_the_one_near_a_pose(
    mechanism: Mechanism, roadmap: Roadmap
) -> None:
    first, second = partners(roadmap)
    start, goal = roadmap.equilibrium(first), roadmap.equilibrium(second)
    motion = plan_motion(start, {"inputs": start.inputs, "pose": goal.pose}, least_margin=MARGIN)
    np.testing.assert_allclose(motion.inputs[-1], start.inputs, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(motion.poses[-1], goal.pose, rtol=0.0, atol=1e-8)
    assert motion.length > 2
    for nothing in ({"inputs": start.inputs}, start, start.pose):
        assert plan_motion(start, nothing, least_margin=MARGIN).length == 0


def test_a_goal_that_no_stable_way_leads_to_lies_on_another_sheet(mechanism: Mechanism) -> None:
    start = pcm_gym.home_equilibrium(mechanism)
    others = [own for own in pcm_gym.solve_forward(mechanism, start.inputs).stable if own.pose[1] < 0.5]
    assert others
    assert {obstacle(start, own, least_margin=0.02)[0] for own in others} == {Obstacle.OTHER_SHEET}
    named = {"inputs": start.inputs, "pose": others[0].pose}
    assert obstacle(start, named, least_margin=0.02)[0] is Obstacle.OTHER_SHEET


def test_another_mechanism_is_moved_from_its_own_equilibrium_at_the_same_inputs(mechanism: Mechanism) -> None:
    start = pcm_gym.home_equilibrium(mechanism)
    first, second = mechanism.legs
    stiffer = pcm_gym.Rod(second.rod.length * 1.01, second.rod.bending_stiffness * 1.1)
    true = pcm_gym.Mechanism("true", (first, pcm_gym.Leg(second.actuator, stiffer, second.attachment)))
    motion = plan_motion(start, np.add(start.pose, [0.1, -0.1]), mechanism=true)
    assert motion.mechanism == true
    assert {own.mechanism for own in motion.equilibria} == {true}
    np.testing.assert_array_equal(motion.inputs[0], start.inputs)
    assert 0.0 < np.linalg.norm(motion.poses[0] - start.pose) < 0.1
    np.testing.assert_allclose(motion.poses[-1], np.add(start.pose, [0.1, -0.1]), rtol=0.0, atol=1e-9)
    assert motion.equilibria[0].residual < 1e-10
    nearest = min(
        pcm_gym.solve_forward(true, start.inputs).stable, key=lambda own: float(np.linalg.norm(own.pose - start.pose))
    )
    np.testing.assert_allclose(motion.poses[0], nearest.pose, rtol=0.0, atol=1e-9)


def test_smaller_steps_make_as_long_a_way_of_more_steps(mechanism: Mechanism) -> None:
    start = pcm_gym.home_equilibrium(mechanism)
    goal = np.add(start.inputs, [0.5, -0.2])
    coarse, fine = (plan_motion(start, {"inputs": goal}, step=[s, s], least_margin=0.05) for s in (0.1, 0.05))
    assert (coarse.length, fine.length) == (5, 10)
    uneven = plan_motion(start, {"inputs": goal}, step=[0.1, 0.01], least_margin=0.05)
    assert uneven.length == 20
    assert uneven.path_length(np.array([0.1, 0.01])) == pytest.approx(20.0)


def obstacle(start: Equilibrium, goal: Any, **arguments: Any) -> tuple[Obstacle, str]:
    with pytest.raises(PlanningError) as caught:
        plan_motion(start, goal, **arguments)
    return caught.value.obstacle, str(caught.value)


def test_a_pose_beyond_the_rods_is_out_of_reach(mechanism: Mechanism) -> None:
    found, message = obstacle(pcm_gym.home_equilibrium(mechanism), outermost(mechanism))
    assert found is Obstacle.OUT_OF_REACH
    assert "no equilibrium" in message


def test_unstable_equilibria_are_neither_starts_nor_goals(mechanism: Mechanism) -> None:
    start = pcm_gym.home_equilibrium(mechanism)
    unstable = next(own for own in pcm_gym.solve_forward(mechanism, start.inputs) if not own.is_stable)
    assert obstacle(start, unstable)[0] is Obstacle.ONLY_UNSTABLE
    assert obstacle(unstable, start)[0] is Obstacle.UNSTABLE_START


def test_limits_and_margins_are_told_apart(mechanism: Mechanism, roadmap: Roadmap) -> None:
    start = pcm_gym.home_equilibrium(mechanism)
    beyond = pcm_gym.Mechanism(
        "narrow",
        tuple(
            pcm_gym.Leg(
                pcm_gym.Revolute(leg.actuator.base, leg.actuator.clamp_angle, (own - 0.3, own + 0.3)),
                leg.rod,
                leg.attachment,
            )
            for leg, own in zip(mechanism.legs, start.inputs.tolist(), strict=True)
        ),
        home_inputs=tuple(start.inputs.tolist()),
        home_pose=tuple(start.pose.tolist()),
    )
    home = pcm_gym.home_equilibrium(beyond)
    assert obstacle(home, {"inputs": np.add(start.inputs, [0.5, 0.0])})[0] is Obstacle.LIMITS
    near_fold = min(map(roadmap.equilibrium, range(len(roadmap))), key=lambda own: own.singularity_margin)
    assert obstacle(start, near_fold, least_margin=0.2)[0] is Obstacle.GOAL_MARGIN
    assert obstacle(near_fold, start, least_margin=5.0)[0] in (Obstacle.START_MARGIN, Obstacle.GOAL_MARGIN)


def test_a_goal_that_only_narrow_ways_lead_to_asks_for_less_margin(roadmap: Roadmap) -> None:
    """Around a cusp: a way there and the straight one back cannot both keep a margin as large as that of the ends."""
    first, second = map(roadmap.equilibrium, partners(roadmap))
    margin = 0.98 * min(first.singularity_margin, second.singularity_margin)
    assert obstacle(first, second, least_margin=margin)[0] is Obstacle.MARGIN_ON_THE_WAY
    assert plan_motion(first, second, least_margin=MARGIN).length > 0


def test_bad_arguments_are_named(mechanism: Mechanism) -> None:
    start = pcm_gym.home_equilibrium(mechanism)
    with pytest.raises(TypeError, match="start must be an Equilibrium"):
        plan_motion(start.inputs, start)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match=r"goal must have shape \(2,\)"):
        plan_motion(start, [0.0, 0.0, 0.0])
    with pytest.raises(ValueError, match="goal key must be one of"):
        plan_motion(start, {"place": [0.0, 0.0]})
    with pytest.raises(ValueError, match="goal must tell a pose or inputs"):
        plan_motion(start, {})
    with pytest.raises(ValueError, match="step must be greater than 0"):
        plan_motion(start, start, step=[0.1, 0.0])
    with pytest.raises(ValueError, match="step must be at least 1/10000 of the range"):
        plan_motion(start, start, step=[0.1, 1e-9])
    with pytest.raises(ValueError, match=r"goal\['pose'\] must"):
        plan_motion(start, {"pose": [0.0, np.inf]})
    with pytest.raises(ValueError, match="least_margin must be at least 0"):
        plan_motion(start, start, least_margin=-1.0)
    with pytest.raises(TypeError, match="mechanism must be a Mechanism"):
        plan_motion(start, start, mechanism="2RFR")  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="start must be of a mechanism with legs like those"):
        plan_motion(start, start, mechanism=pcm_gym.get_mechanism("3PFR-paper"))
