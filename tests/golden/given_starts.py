"""Episodes whose starts are given: unstable equilibria, both sides of a bifurcation, and a fall that never ends."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np

import pcm_gym
from pcm_gym import BranchTracker, Equilibrium, Leg, Mechanism, Prismatic, Revolute, Rod
from tests.environments.rollouts import make_bare, sweeping_actions

# Inputs of the first motor of the fork: from before its pitchfork to beyond it, and to where it has become one again.
FORK_START, FORK_TARGETS = 0.15, ((0.25, 0.5, 0.9), (0.18, 0.21, 0.24, 0.3, 0.2, 0.1), (0.9, 0.4))


def from_anywhere(environment_id: str, keywords: dict[str, Any]) -> list[Any]:
    """From equilibria most of which are unstable, then from inputs, to a pose, under a load."""
    env = make_bare(environment_id, **keywords)
    mechanism, records = env.mechanism, []
    home = pcm_gym.home_equilibrium(mechanism)
    inputs = home.inputs + 0.03 * np.arange(1, mechanism.leg_count + 1)
    found = pcm_gym.solve_forward(mechanism, inputs, rho_max=7.0 if mechanism.leg_count == 2 else 6.5)
    starts: list[dict[str, Any]] = [{"equilibrium": one} for one in found[:12]]
    starts += [{"inputs": inputs}, {"goal": home.pose}, {"load": 0.05 * mechanism.units.load}]
    starts.append({"inputs": inputs, "goal": home.pose})
    for seed, options in enumerate(starts):
        records.append(env.reset(seed=seed, options=options))
        records += _until_end(env, sweeping_actions(20, env.action_space.shape, seed, hold=10))
    return records


def at_a_fork(environment_id: str, keywords: dict[str, Any]) -> list[Any]:
    """Over the pitchfork of a symmetric mechanism whose motors turn alike, and back."""
    start, records = fork(), []
    env = make_bare(environment_id, mechanism=start.mechanism, max_action=1.0, **keywords)
    for seed, targets in enumerate(FORK_TARGETS):
        records.append(env.reset(seed=seed, options={"equilibrium": start, "goal": (0.0, 0.5)}))
        moves = np.diff([FORK_START, *targets])
        records += _until_end(env, np.column_stack([moves, -moves]))
    return records


def without_rest(environment_id: str, keywords: dict[str, Any]) -> list[Any]:
    """Over a fold beyond which a moment turns the platform for ever."""
    start = restless()
    env = make_bare(environment_id, mechanism=start.mechanism, **keywords)
    records: list[Any] = [env.reset(seed=0, options={"equilibrium": start, "goal": start.pose})]
    return records + _until_end(env, np.ones((20, 3)))


def _until_end(env: Any, actions: Any) -> list[Any]:
    records = []
    for action in actions:
        records.append(env.step(action))
        if records[-1][2] or records[-1][3]:
            break
    return records


def fork() -> Equilibrium:
    """A symmetric mechanism under a load on its axis, before a bifurcation into two stable branches."""
    motors = (Revolute((x, 0.0), limits=(-6.0, 8.0)) for x in (-0.19, 0.19))
    mechanism = Mechanism(
        "fork", tuple(Leg(motor) for motor in motors), home_inputs=tuple(fork_inputs(-1.0)), home_pose=(0.0, 0.5)
    )
    home = pcm_gym.home_equilibrium(mechanism, (0.0, -6.4))
    return BranchTracker(mechanism, home).step(fork_inputs(FORK_START)).equilibrium


def fork_inputs(first: float) -> tuple[float, float]:
    return first, math.pi - first


def restless() -> Equilibrium:
    """A small platform on soft rods that gives way to a moment; of three alike, the one farthest along x."""
    legs = []
    for direction in np.radians([90.0, 210.0, 330.0]).tolist():
        outwards = np.array([math.cos(direction), math.sin(direction)])
        actuator = Prismatic(tuple(0.6 * outwards), direction + math.pi / 2.0, direction + math.pi + 0.5)
        legs.append(Leg(actuator, Rod(), tuple(0.15 * outwards)))
    mechanism = Mechanism("soft", tuple(legs))
    found = pcm_gym.solve_forward(mechanism, np.zeros(3), (0.0, 0.0, 2.0), 6.5).stable
    start = max(found, key=lambda one: one.pose[0])
    return BranchTracker(mechanism, start).step(start.inputs, (0.0, 0.0, 5.0)).equilibrium


STARTS: dict[str, Callable[[str, dict[str, Any]], list[Any]]] = {
    "anywhere": from_anywhere,
    "fork": at_a_fork,
    "restless": without_rest,
}
