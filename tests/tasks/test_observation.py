"""The observation is what its table says, element by element."""

import math
from typing import Any

import gymnasium
import numpy as np
import pytest

import pcm_gym
from pcm_gym.solving import Equilibrium
from pcm_gym.tasks import Goals, box_of, observation_elements
from tests.environments.rollouts import MECHANISMS, make_bare, make_native, sweeping_actions

NAMES = MECHANISMS


def expected_elements(equilibrium: Equilibrium, is_stable: bool) -> dict[str, float]:
    """Every element from the public description of the equilibrium, by its documented meaning."""
    mechanism, pose = equilibrium.mechanism, equilibrium.pose
    result = {"x": pose[0] / mechanism.units.length, "y": pose[1] / mechanism.units.length}
    if mechanism.dof == 3:
        result |= {"cos_phi": math.cos(pose[2]), "sin_phi": math.sin(pose[2])}
    for n, (leg, rod, value) in enumerate(
        zip(mechanism.legs, equilibrium.rods, equilibrium.inputs, strict=True), start=1
    ):
        actuator = leg.actuator
        lower, upper = actuator.limits
        result[f"input_{n}"] = 2.0 * (value - lower) / (upper - lower) - 1.0
        clamp = actuator.clamp_angle
        if isinstance(actuator, pcm_gym.Revolute):
            clamp += value
            result |= {f"cos_clamp_{n}": math.cos(clamp), f"sin_clamp_{n}": math.sin(clamp)}
        weight = rod.rho**2 / (10.0 + rod.rho**2)
        result[f"tip_load_along_{n}"] = weight * (2.0 * rod.modulus**2 - 1.0)
        along, across = (
            float(rod.force @ axis)
            for axis in ([math.cos(clamp), math.sin(clamp)], [-math.sin(clamp), math.cos(clamp)])
        )
        size = math.hypot(along, across)
        result |= {f"clamp_load_along_{n}": weight * along / size, f"clamp_load_across_{n}": weight * across / size}
        assert along / size == pytest.approx(math.cos(rod.psi), abs=1e-9)
        assert across / size == pytest.approx(math.sin(rod.psi), abs=1e-9)
    units = mechanism.units
    for n, effort in enumerate((equilibrium.actuator_forces / (units.energy / units.inputs)).tolist(), start=1):
        result[f"effort_{n}"] = effort / (10.0 + abs(effort))
    stability, singularity = equilibrium.stability_margin, equilibrium.singularity_margin
    return result | {
        "is_stable": float(is_stable),
        "stability_margin": stability / (20.0 + abs(stability)),
        "singularity_margin": singularity / (0.1 + singularity),
    }


@pytest.mark.parametrize("name", NAMES)
def test_elements_are_what_they_are_said_to_be(name: str) -> None:
    env = make_bare(f"PCM/{name}-Reach-v0")
    names = [element.name for element in observation_elements(env.mechanism)]
    for seed in range(3):
        env.reset(seed=seed)
        for action in sweeping_actions(30, env.action_space.shape, seed):
            observation, _, terminated, _, _ = env.step(action)
            elements = dict(zip(names, observation["observation"], strict=True))
            equilibrium = env.equilibrium
            for element, value in expected_elements(equilibrium, not terminated).items():
                # the margin of singularity is had from differences here, and at a fold that of stability falls steeply
                is_rough = element == "singularity_margin" or (element == "stability_margin" and terminated)
                tolerance = 1e-6 if is_rough else 1e-9
                assert elements.pop(element) == pytest.approx(value, abs=tolerance), element
            for n, rod in enumerate(equilibrium.rods, start=1):
                across = elements.pop(f"tip_load_across_{n}")
                weight = rod.rho**2 / (10.0 + rod.rho**2)
                angle = 2.0 * math.acos(abs(rod.modulus))
                assert abs(across) == pytest.approx(weight * math.sin(angle), abs=1e-7)
                position = elements.pop(f"mode_{n}")
                assert 1 + math.floor(position / (1.0 - position)) == rod.mode
            assert elements == {}
            if terminated:
                break


@pytest.mark.parametrize("name", NAMES)
def test_table_is_complete(name: str) -> None:
    mechanism = pcm_gym.get_mechanism(name)
    elements = observation_elements(mechanism)
    assert len({element.name for element in elements}) == len(elements)
    for element in elements:
        assert element.meaning
        assert element.unit
        assert -np.inf < element.low < element.high < np.inf
    box = box_of(observation_elements(mechanism))
    assert box.dtype == np.float64
    assert box.shape == (len(elements),)
    assert Goals(mechanism).box.shape == ((2,) if mechanism.dof == 2 else (4,))


def test_layout_names_the_parts_of_the_observation() -> None:
    keywords: dict[str, Any] = {"load": ((-0.01, -0.02), (0.01, 0.02)), "variants": 2, "actuator_lag": 1.0}
    env = make_bare("PCM/2RFR-Track-v0", on_instability="hold", observation_noise=0.5, **keywords)
    quiet = make_bare("PCM/2RFR-Track-v0", on_instability="hold", **keywords)
    layout = env._simulation.sensors.layout
    names = [element.name for element in env.elements]
    parts = {part.name: names[layout[part.name]] for part in layout.parts}
    assert [name for own in parts.values() for name in own] == names
    assert parts["pose"] == ["x", "y"]
    assert parts["inputs"][3:] == ["input_2", "cos_clamp_2", "sin_clamp_2"]
    assert (len(parts["rods"]), parts["margins"]) == (10, ["stability_margin", "singularity_margin"])
    assert parts["goal_in_8"] == ["x_in_8", "y_in_8"]
    assert (parts["load"], parts["commands"]) == (["load_1", "load_2"], ["command_1", "command_2"])
    is_noisy = env.reset(seed=0)[0]["observation"] != quiet.reset(seed=0)[0]["observation"]
    assert [part for part in parts if is_noisy[layout[part]].any()] == ["pose", "inputs", "rods", "efforts"]
    with pytest.raises(KeyError, match=r"name must be one of .*'is_stable'.*, got 'stable'"):
        layout["stable"]


def test_the_layout_does_not_depend_on_what_comes_of_a_lost_stability() -> None:
    envs = [make_bare("PCM/2RFR-Reach-v0", on_instability=own) for own in ("terminate", "snap", "hold", "continue")]
    assert len({env.elements for env in envs}) == 1
    assert all(env.observation_space == envs[0].observation_space for env in envs)


@pytest.mark.parametrize("name", NAMES)
def test_elements_are_continuous_along_branches(name: str) -> None:
    """Chart seams of the rods' parameters (psi past 2 pi, k through 0 and +-1, mode to mode) leave no jump.

    A step of a thousandth of the default size may change an element by 0.02, away from folds.
    """
    keywords: dict[str, Any] = {"autoreset_mode": "Disabled", "max_episode_steps": None}
    env = make_native(f"PCM/{name}-Reach-v0", 100, **keywords)
    observation, infos = env.reset(seed=0)
    calm = np.ones(100, dtype=np.bool_)
    largest = 0.0
    for coarse in sweeping_actions(40, env.action_space.shape, seed=3, hold=8):
        for action, is_fine in ((coarse, False), (1e-3 * coarse, True)):
            before = observation["observation"]
            calm = calm & (infos["singularity_margin"] > 0.02)
            observation, _, terminated, truncated, infos = env.step(action)
            ended = terminated | truncated
            if is_fine:
                change = np.abs(observation["observation"] - before)[calm & ~ended]
                largest = max(largest, change.max())
            calm = np.ones(100, dtype=np.bool_)
            if ended.any():
                observation, begun = env.reset(options={"reset_mask": ended})
                infos["singularity_margin"][ended] = begun["singularity_margin"][ended]
    assert 0.0 < largest < 0.02


def test_bound_on_the_pose_covers_the_legs_stretched_out() -> None:
    rod = pcm_gym.Rod()
    legs = tuple(pcm_gym.Leg(pcm_gym.Prismatic((x, 0.0), 0.0, 1.5, (-0.7, 0.2)), rod) for x in (-0.3, 0.5))
    mechanism = pcm_gym.Mechanism("bound", legs)
    assert Goals(mechanism).box.high.tolist() == pytest.approx([2.0, 2.0])


def test_elements_name_the_spaces_of_the_registered_environments() -> None:
    for environment_id in pcm_gym.environment_ids():
        env: Any = gymnasium.make(environment_id)
        elements = env.unwrapped.elements
        assert env.observation_space["observation"].shape == (len(elements),)
