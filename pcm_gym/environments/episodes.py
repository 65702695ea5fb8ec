"""How episodes begin: what is drawn from the scenes, and what a reset is asked for."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from pcm_gym.arrays import Array, Integers
from pcm_gym.environments.settings import Settings
from pcm_gym.kernels.statics.states import States
from pcm_gym.mechanism.validation import finite_vector, one_of
from pcm_gym.solving import Equilibrium
from pcm_gym.tasks import Generators, Scene
from pcm_gym.tasks.scene import reached

RESET_OPTIONS = ("inputs", "equilibrium", "goal", "load")
# What `reset` takes as an equilibrium may be rounded, not wrong.
_RESIDUAL_TOLERANCE = 1e-8


class EpisodeStarts(NamedTuple):
    """How some episodes of one scene begin, dimensionless as in the kernels."""

    members: Integers  # (n,): which of those that were asked for
    scene: int  # its number
    states: States  # (n, ...)
    goals: Array  # (n, p, g)
    witness: Array  # (n, legs + 2 legs + d): inputs and state that meet the first goal; not a number if none is known


def episode_starts(
    settings: Settings,
    scenes: Sequence[Scene],
    generators: Generators,
    options: Mapping[str, Any] | None,
    threads: int,
) -> Iterator[EpisodeStarts]:
    """Yield how the episodes of some generators begin, scene by scene.

    Parameters
    ----------
    settings : Settings
    scenes : sequence of Scene
    generators : sequence of numpy.random.Generator
        For each episode the source of its scene, start and goal.
    options : mapping, optional
        Any of `inputs` (start there), `equilibrium` (start with it), `goal` (a pose or an equilibrium) and `load`.
    threads : int

    Raises
    ------
    ValueError
        If an option is unknown, of wrong shape, or cannot be met on stable equilibria; with "continue" the equilibrium
        may be unstable, and what is reached from it too.
    """
    options = options or {}
    for name in options:
        one_of("options key", name, RESET_OPTIONS)
    goal = _goal_from(settings, options["goal"]) if "goal" in options else None
    numbers = _scene_numbers(settings, scenes, generators, options)
    for number, nominal in enumerate(scenes):
        members = np.flatnonzero(numbers == number)
        if not len(members):
            continue
        scene = _scene_for(nominal, options)
        own = [generators[member] for member in members.tolist()]
        states, goals, witness = _drawn(settings, scene, own, threads)
        if goal is not None:
            goals, witness = _filled(goals, goal[0]), _filled(witness, goal[1])
        yield EpisodeStarts(members, number, states, goals, witness)


def _drawn(settings: Settings, scene: Scene, generators: Generators, threads: int) -> tuple[States, Array, Array]:
    """Return states, goals and witnesses that the task draws."""
    unstable = scene.origin if scene.origin is not None and not scene.origin.is_stable else None
    # the goal of an unstable start is stable none the less
    drawn = settings.task.sample(scene if unstable is None else replace(scene, origin=None), generators, threads)
    states = drawn.states if unstable is None else scene.at_equilibrium(unstable, len(generators))
    if drawn.witness is None:
        return states, drawn.goals, np.full((len(generators), states.inputs.shape[1] + states.x.shape[1]), np.nan)
    return states, drawn.goals, np.concatenate([drawn.witness.inputs, drawn.witness.x], axis=1)


def _scene_numbers(
    settings: Settings, scenes: Sequence[Scene], generators: Generators, options: Mapping[str, Any]
) -> Integers:
    """Return the number of the scene of each episode."""
    if "equilibrium" in options:
        return np.full(len(generators), _scene_of(settings, scenes, options["equilibrium"]))
    if len(scenes) == 1:
        return np.zeros(len(generators), dtype=np.int64)
    return np.array([generator.integers(len(scenes)) for generator in generators])


def _scene_of(settings: Settings, scenes: Sequence[Scene], start: Any) -> int:
    """Return the number of a scene with the mechanism of an equilibrium; raise if it cannot be a start."""
    is_equilibrium = isinstance(start, Equilibrium)
    numbers = [n for n, scene in enumerate(scenes) if is_equilibrium and scene.mechanism == start.mechanism]
    if not numbers:
        raise ValueError(f"option equilibrium must be an Equilibrium of {settings.mechanism.name!r}, got {start!r}")
    if not start.is_stable and settings.on_instability != "continue":
        raise ValueError(f"option equilibrium must be stable, got index {start.index}")
    lower, upper = start.mechanism.lower_limits, start.mechanism.upper_limits
    if not np.all((lower <= start.inputs) & (start.inputs <= upper)):
        raise ValueError(f"option equilibrium must be within the actuators' limits, got {start.inputs.tolist()}")
    if start.residual > _RESIDUAL_TOLERANCE:
        raise ValueError(f"option equilibrium must be one, got residual {start.residual}")
    return numbers[0]


def _scene_for(scene: Scene, options: Mapping[str, Any]) -> Scene:
    """Return the scene with the load and the start that are asked for."""
    if "load" in options:
        scene = replace(scene, load=tuple(scene.mechanism.check_load(options["load"]).tolist()))
    elif "equilibrium" in options:
        scene = replace(scene, load=tuple(options["equilibrium"].load.tolist()))
    if "equilibrium" not in options and "inputs" not in options:
        return scene
    start, load = options.get("equilibrium"), np.array(scene.load)
    start = scene.home if start is None else reached(start, start.inputs, load, "load")
    return replace(scene, origin=reached(start, options.get("inputs", start.inputs), load, "inputs"))


def _filled(array: Array, values: Array) -> Array:
    """Return an array of the shape of another one, with the same values (k,) all over its last axis."""
    return np.tile(values, (*array.shape[:-1], 1))


def _goal_from(settings: Settings, wanted: Any) -> tuple[Array, Array]:
    """Return the goal that a pose or an equilibrium stands for, and its witness."""
    mechanism, goals = settings.mechanism, settings.task.goals
    if isinstance(wanted, Equilibrium):
        if wanted.mechanism.dof != mechanism.dof:
            raise ValueError(f"option goal must be an Equilibrium of {mechanism.name!r}, got {wanted!r}")
        inputs = mechanism.units.kernel_from_inputs(wanted.inputs)
        return goals.of_equilibrium(wanted), np.append(inputs, wanted.state)
    if goals.with_inputs:
        raise ValueError(f"option goal must be an Equilibrium: a pose does not tell the inputs, got {wanted!r}")
    goal = goals.of_pose(finite_vector("option goal", wanted, mechanism.dof))
    if goal not in goals.box:
        raise ValueError(f"option goal must be a pose within the reach of the rods, got {wanted!r}")
    return goal, np.full(mechanism.leg_count + mechanism.state_size, np.nan)
