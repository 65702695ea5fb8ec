"""This package: a batch of environments, one environment, and the tracker of branches alone.

Environments are made by Gymnasium, wrappers included, with the largest action set to one degree and without an end of
the episode; each step returns observation, reward and full info, stability included. The batch runs in one thread. The
tracker's equilibrium computes its verdict when it is asked for, so it is asked: index and both margins.
"""

from typing import Any

import gymnasium
import numpy as np

from benchmarks.peers.following import Places, Step
from benchmarks.peers.problem import BASES, HOME, INCREMENT, STEPS, inputs_on_path
from pcm_gym import BranchTracker, Equilibrium, Event, Leg, Mechanism, Revolute, Rod, home_equilibrium
from pcm_gym.arrays import Array

_ENVIRONMENT = "PCM/2RFR-Reach-v0"


def home() -> Equilibrium:
    """Return the equilibrium where the path begins."""
    legs = tuple(Leg(Revolute(base=(x, 0.0)), Rod(length=1.0, bending_stiffness=1.0)) for x in BASES)
    return home_equilibrium(Mechanism("2RFR", legs, home_inputs=tuple(HOME), home_pose=(0.0, 0.9275)))


def prepare_batch(places: Places) -> Step:
    """Return the step of a native batch; each row is first led to its place on the path."""
    start, on_path = home(), inputs_on_path()
    env = gymnasium.make_vec(_ENVIRONMENT, len(places), "vector_entry_point", threads=1, **_settings(start.mechanism))
    env.reset(options={"equilibrium": start})
    step = _stepping(env, np.tile(start.inputs, (len(places), 1)))
    for place in range(STEPS):
        step(on_path[np.minimum(place, places)])
    return step


def prepare_environment(place: Places) -> Step:
    """Return the step of one environment."""
    start, inputs = home(), inputs_on_path()[place]
    env = gymnasium.make(_ENVIRONMENT, **_settings(start.mechanism))
    env.reset(options={"equilibrium": start, "inputs": inputs})
    return _stepping(env, inputs)


def _settings(mechanism: Mechanism) -> dict[str, Any]:
    return {"mechanism": mechanism, "max_action": INCREMENT, "max_episode_steps": -1}


def _stepping(env: Any, inputs: Array) -> Step:
    def step(target: Array) -> Array:
        nonlocal inputs
        observation, _, terminated, truncated, _ = env.step((target - inputs) / INCREMENT)
        if np.any(terminated) or np.any(truncated):
            raise RuntimeError("an episode ended on the path")
        inputs = target
        tips: Array = observation["achieved_goal"]
        return tips

    return step


def prepare_tracker(place: Places) -> Step:
    """Return the step of a tracker, with the verdict on stability."""
    start = home()
    tracker = BranchTracker(start.mechanism, start)
    tracker.step(inputs_on_path()[place])

    def step(target: Array) -> Array:
        tracked = tracker.step(target)
        reached = tracked.equilibrium
        is_sound = reached.is_stable and reached.stability_margin > 0.0 and reached.singularity_margin > 0.0
        if tracked.event != Event.NONE or not is_sound:
            raise RuntimeError(f"the tracker met {tracked.event} on the path")
        return reached.pose

    return step
