"""Limits of the structure in environments: told as by the equilibria, kept by starts, goals, paths and charts."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import pcm_gym
from pcm_gym.environments.batch import MechanismVectorEnv
from pcm_gym.environments.single import MechanismEnv
from pcm_gym.solving.limits import LIMIT_NAMES, LimitName

ALL: tuple[LimitName, ...] = ("stress", "torque", "contact")


def of_strips(name: str, torque: float, force: float, thickness: float = 0.0005) -> pcm_gym.Mechanism:
    """Return a catalogued mechanism with strips of spring steel and actuators of that strength."""
    rod = pcm_gym.Rod(section=pcm_gym.Strip(0.02, thickness), material=pcm_gym.SPRING_STEEL)
    legs = []
    for leg in pcm_gym.get_mechanism(name).legs:
        limit: dict[str, Any] = {"greatest_torque": torque} if leg.actuator.is_angle else {"greatest_force": force}
        legs.append(replace(leg, rod=rod, actuator=replace(leg.actuator, **limit)))
    return replace(pcm_gym.get_mechanism(name), name=f"{name} of strips", legs=tuple(legs))


# They yield at 10 / m and 18 / m: home is within, other states are not.
MECHANISMS = {
    "2RFR": of_strips("2RFR-paper", torque=1.2, force=9.0, thickness=0.001),
    "3PFR": of_strips("3PFR-paper", torque=1.0, force=1.3, thickness=0.00055),
}


def broken(equilibrium: pcm_gym.Equilibrium) -> dict[str, bool]:
    """Return what an equilibrium breaks, by what it tells of itself."""
    mechanism = equilibrium.mechanism
    pairs = zip(mechanism.legs, equilibrium.actuator_forces.tolist(), strict=True)
    is_platform = mechanism.dof == 3
    return {
        "stress": max(rod.stress_ratio for rod in equilibrium.rods) > 1.0,
        "torque": any(abs(force) > leg.actuator.greatest_effort for leg, force in pairs),
        "contact": any(is_platform or crossing.legs[0] == crossing.legs[1] for crossing in equilibrium.crossings),
    }


def environment(name: str, **arguments: Any) -> MechanismEnv:
    return MechanismEnv(MECHANISMS[name], limits=ALL, **arguments)


@pytest.mark.parametrize("name", MECHANISMS)
def test_costs_are_those_of_the_equilibrium(name):
    env, rng, seen = environment(name, on_instability="snap"), np.random.default_rng(2), set()
    for episode in range(12):
        env.reset(seed=episode)
        way = rng.uniform(-1.0, 1.0, env.action_space.shape)
        for _ in range(40):
            _, _, _, _, info = env.step(np.clip(way + 0.2 * rng.standard_normal(way.shape), -1.0, 1.0))
            wanted = broken(env.equilibrium)
            assert {key: info[f"cost_{key}"] for key in ALL} == {key: float(value) for key, value in wanted.items()}
            named = [info[key] for key in info if key.startswith("cost_")]
            assert info["cost"] == sum(named)
            seen |= {key for key, value in wanted.items() if value}
    assert "torque" in seen  # what never happens is not tested
    assert len(seen) >= 2


@pytest.mark.parametrize("name", MECHANISMS)
def test_a_reset_costs_nothing_and_starts_and_goals_keep_the_limits(name):
    for task, more in (("Reach", {}), ("Reach", {"difficulty": "near"}), ("Track", {})):
        env = environment(name, task=task, **more)
        for seed in range(20):
            _, info = env.reset(seed=seed)
            assert info["cost"] == 0.0
            assert not any(broken(env.equilibrium).values())
            goal = env._simulation.witness(0)
            assert goal is not None
            assert not any(broken(goal).values())


def test_single_and_batch_tell_the_same():
    rng = np.random.default_rng(3)
    batch = MechanismVectorEnv(3, mechanism=MECHANISMS["2RFR"], limits=ALL, autoreset_mode="Disabled")
    single = [environment("2RFR") for _ in range(3)]
    batch.reset(seed=[5, 6, 7])
    for seed, env in zip((5, 6, 7), single, strict=True):
        env.reset(seed=seed)
    for _ in range(30):
        actions = rng.uniform(-1.0, 1.0, (3, 2))
        *_, infos = batch.step(actions)
        for row, env in enumerate(single):
            *_, info = env.step(actions[row])
            for key in ("cost", "cost_stress", "cost_torque", "cost_contact"):
                assert infos[key][row] == info[key]


def test_a_preview_tells_what_the_step_then_costs():
    env, rng = environment("2RFR", on_instability="hold"), np.random.default_rng(4)
    env.reset(seed=1)
    way = np.array([1.0, -1.0])
    for _ in range(30):
        action = np.clip(way + 0.3 * rng.standard_normal(2), -1.0, 1.0)
        asked = env.preview(action[None])
        *_, info = env.step(action)
        for key in ("cost", "cost_stress", "cost_torque", "cost_contact"):
            assert getattr(asked, key)[0] == info[key]


def test_without_limits_there_are_no_such_costs():
    env = MechanismEnv("2RFR")
    _, info = env.reset(seed=0)
    assert not {f"cost_{name}" for name in LIMIT_NAMES} & info.keys()
    asked = MechanismEnv("2RFR", limits=("contact",))
    _, info = asked.reset(seed=0)
    assert "cost_contact" in info
    assert "cost_stress" not in info


@pytest.mark.parametrize("name", MECHANISMS)
def test_roadmaps_leave_out_what_breaks_a_limit_and_what_only_that_leads_to(name):
    mechanism, home = MECHANISMS[name], pcm_gym.home_equilibrium(MECHANISMS[name])
    step = np.ptp([mechanism.lower_limits, mechanism.upper_limits], axis=0) / (24 if mechanism.dof == 2 else 8)
    whole = pcm_gym.build_roadmap(mechanism, [home], step=step)
    kept = pcm_gym.build_roadmap(mechanism, [home], step=step, limits=ALL)
    assert 0 < len(kept) < len(whole)
    assert (kept.components == 0).all()
    # by hand: flood over the nodes of the whole one that break nothing, from the seed
    fine = {node for node in range(len(whole)) if not any(broken(whole.equilibrium(node)).values())}
    reached, border = {whole.seeds[0]}, [whole.seeds[0]]
    while border:
        for node in whole.ways[border.pop()].tolist():
            if node in fine and node not in reached:
                reached.add(node)
                border.append(node)
    assert len(kept) == len(reached)
    assert {tuple(state) for state in kept.states} == {tuple(whole.states[node]) for node in reached}


def test_an_atlas_within_limits_is_the_usable_part_of_the_whole(tmp_path):
    mechanism = MECHANISMS["2RFR"]
    resolution: dict[str, Any] = {"pitch": 0.05, "input_cells": 24, "seed_nodes": 2, "progress": False}
    whole = pcm_gym.build_atlas(mechanism, **resolution)
    usable = pcm_gym.build_atlas(mechanism, limits=ALL, **resolution)
    assert usable.limits == ALL
    for part, all_of_it in ((usable.over_inputs, whole.over_inputs), (usable.over_poses, whole.over_poses)):
        assert 0 < len(part) < len(all_of_it)
        states = np.concatenate([all_of_it.rods, all_of_it.poses / mechanism.units.pose], axis=1).astype(np.float64)
        inputs = mechanism.units.kernel_from_inputs(all_of_it.inputs.astype(np.float64))
        kept = pcm_gym.StructuralLimits(mechanism, ALL).are_kept(states, inputs)
        assert abs(int(kept.sum()) - len(part)) <= 2  # in single precision one may be on the other side
    usable.save(tmp_path / "usable.npz")
    assert pcm_gym.load_atlas(tmp_path / "usable.npz").limits == ALL
    assert pcm_gym.build_atlas(mechanism, **resolution).limits == ()


@pytest.mark.parametrize(
    ("mechanism", "limits", "message"),
    [
        ("2RFR-paper", ("stress",), "limits: 'stress' takes rods with section and material, the rod of leg 0 has none"),
        ("2RFR-paper", ("torque",), "limits: 'torque' takes actuators with a greatest_torque, that of leg 0 has none"),
        ("2PFR-paper", ("torque",), "limits: 'torque' takes actuators with a greatest_force"),
        ("2RFR-paper", ("heat",), "limits must be one of"),
        ("2RFR-paper", ("contact", "contact"), "limits must be named once each"),
    ],
)
def test_limits_that_a_mechanism_cannot_have_are_refused(mechanism, limits, message):
    whole = pcm_gym.get_mechanism(mechanism)
    bare = replace(whole, legs=tuple(replace(leg, rod=pcm_gym.Rod()) for leg in whole.legs))
    with pytest.raises(ValueError, match=message):
        MechanismEnv(bare, limits=limits)


@pytest.mark.parametrize("limits", ["stress", 3, None, (1,)])
def test_limits_that_are_no_names_are_refused(limits):
    with pytest.raises(TypeError, match="limits must be a sequence of str"):
        MechanismEnv("2RFR", limits=limits)


def test_a_home_that_breaks_a_limit_is_refused():
    weak = of_strips("2RFR-paper", torque=1e-3, force=1.0)
    with pytest.raises(ValueError, match=r"home must keep the limits \('torque',\), .* breaks \('torque',\)"):
        MechanismEnv(weak, limits=("torque",))


@pytest.mark.parametrize("strength", [0.0, -1.0, math.nan])
def test_actuators_without_strength_are_refused(strength):
    with pytest.raises(ValueError, match="greatest_torque"):
        pcm_gym.Revolute((0.0, 0.0), greatest_torque=strength)
    with pytest.raises(ValueError, match="greatest_force"):
        pcm_gym.Prismatic((0.0, 0.0), 0.0, 0.0, greatest_force=strength)


# Plans


def test_plans_keep_the_limits_and_others_would_not() -> None:
    """Judged by what the equilibria tell of themselves, on the same starts and goals with limits and without."""
    env = environment("2RFR")
    pairs = []
    for seed in range(60):
        env.reset(seed=seed)
        pairs.append((env.equilibrium, env.witness))
    starts, goals = zip(*pairs, strict=True)
    broken_steps = {}
    for limits in (ALL, ()):
        planner = pcm_gym.MotionPlanner(MECHANISMS["2RFR"], limits=limits)
        motions = [motion for motion in planner.plan_many(starts, goals) if motion is not None]
        assert len(motions) >= 50
        steps = [step for motion in motions for step in motion.equilibria[1:]]
        broken_steps[limits] = sum(any(broken(step).values()) for step in steps)
    assert broken_steps[ALL] == 0 < broken_steps[()]


def test_goals_beyond_the_limits_are_refused_by_name() -> None:
    mechanism = MECHANISMS["2RFR"]
    home = pcm_gym.home_equilibrium(mechanism)
    roadmap = pcm_gym.build_roadmap(mechanism, [home], step=[0.1, 0.1], least_margin=0.05)
    bent = max(map(roadmap.equilibrium, range(len(roadmap))), key=lambda own: own.rods[0].stress_ratio)
    assert pcm_gym.plan_motion(home, bent).length > 0
    with pytest.raises(pcm_gym.PlanningError, match="breaks a limit of the structure") as raised:
        pcm_gym.plan_motion(home, bent, limits=("stress",))
    assert raised.value.obstacle is pcm_gym.Obstacle.STRUCTURE
    with pytest.raises(ValueError, match="limits"):
        pcm_gym.plan_motion(home, bent, limits=("heat",))  # type: ignore[arg-type]
