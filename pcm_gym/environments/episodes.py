"""How episodes begin: what is drawn from the scenes, and what a reset is asked for."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from pcm_gym.arrays import Array, Integers, Mask
from pcm_gym.environments.settings import Settings
from pcm_gym.kernels.statics.states import States
from pcm_gym.mechanism import Mechanism
from pcm_gym.mechanism.validation import finite_array, finite_vector, instance_of, mapping, one_of, shown
from pcm_gym.solving import Equilibrium
from pcm_gym.tasks import Episodes, Generators, Scene, draw_until, in_split
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
    fewest_falls: Integers  # (n,): without which nothing leads to the goal


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
        may be unstable, and what is reached from it too. If the task has no episodes, or none of the split.
    """
    options = mapping("options", options)
    for name in options:
        one_of("options key", name, RESET_OPTIONS)
    goal = _goal_from(settings, scenes, options["goal"]) if "goal" in options else None
    numbers = _scene_numbers(settings, scenes, generators, options)
    for number, nominal in enumerate(scenes):
        members = np.flatnonzero(numbers == number)
        if not len(members):
            continue
        scene = _scene_for(nominal, options)
        own = [generators[member] for member in members.tolist()]
        if goal is not None:
            drawn = _towards(settings, _starts(settings, scene, own, threads), *goal)
        elif settings.task.has_split and scene.origin is None:
            drawn = _drawn_of_split(settings, scene, own, threads)
        else:
            drawn = _drawn(settings, scene, own, threads)
        yield EpisodeStarts(members, number, *drawn)


class _Drawn(NamedTuple):
    """What a task has drawn."""

    states: States
    goals: Array
    witness: Array
    fewest_falls: Integers


def _drawn_of_split(settings: Settings, scene: Scene, generators: Generators, threads: int) -> _Drawn:
    """Return what the task draws of the training's or the test's part: of each generator the first that is of it."""
    task, split = settings.task, settings.split

    def drawn(own: Generators) -> tuple[Episodes, Mask]:
        episodes = task.sample(scene, own, threads)
        _check_drawn(settings, episodes, len(own))
        starts = task.goals.of_states(episodes.states.x, episodes.states.inputs)
        return episodes, in_split(split, starts, episodes.goals[:, 0])

    return _as_drawn(draw_until(drawn, generators, f"split {split!r} must leave episodes of task {task!r}"))


def _drawn(settings: Settings, scene: Scene, generators: Generators, threads: int) -> _Drawn:
    """Return what the task draws."""
    unstable = scene.origin if scene.origin is not None and not scene.origin.is_stable else None
    # the goal of an unstable start is stable none the less
    drawn = settings.task.sample(scene if unstable is None else replace(scene, origin=None), generators, threads)
    _check_drawn(settings, drawn, len(generators))
    made = _as_drawn(drawn)
    return made if unstable is None else made._replace(states=scene.at_equilibrium(unstable, len(generators)))


def _starts(settings: Settings, scene: Scene, generators: Generators, threads: int) -> States:
    """Return where episodes begin: at the scene's origin, for which nothing is drawn, or where the task draws them."""
    if scene.origin is None:
        return _drawn(settings, scene, generators, threads).states
    scene.check_seed()
    return scene.at_equilibrium(scene.origin, len(generators))


def _towards(settings: Settings, starts: States, goal: Array, witness: Array) -> _Drawn:
    """Return episodes with one goal (g,), and its witness, all the way."""
    count = len(starts.x)
    goals = np.tile(goal, (count, settings.task.period, 1))
    return _Drawn(starts, goals, np.tile(witness, (count, 1)), np.zeros(count, dtype=np.int64))


def _as_drawn(drawn: Episodes) -> _Drawn:
    states, falls = drawn.states, drawn.fewest_falls
    assert falls is not None
    if drawn.witness is None:
        witness = np.full((len(states.x), states.inputs.shape[1] + states.x.shape[1]), np.nan)
    else:
        witness = np.concatenate([drawn.witness.inputs, drawn.witness.x], axis=1)
    return _Drawn(states, drawn.goals, witness, falls)


def _check_drawn(settings: Settings, drawn: Episodes, count: int) -> None:
    """Raise unless a task has drawn episodes of the right shapes, finite all over."""
    mechanism, task = settings.mechanism, settings.task
    instance_of("what sample() returns", drawn, Episodes)
    widths = {"x": mechanism.state_size, "inputs": mechanism.leg_count, "load": mechanism.dof}
    told = {"states": drawn.states} | ({} if drawn.witness is None else {"witness": drawn.witness})
    for name, states in told.items():
        for part, array in states._asdict().items():
            finite_array(f"{name}.{part} of sample()", array, (count, widths[part]))
    finite_array("goals of sample()", drawn.goals, (count, task.period, task.goals.size))


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
        raise ValueError(
            f"option equilibrium must be an Equilibrium of {settings.mechanism.name!r}, got {shown(start)}"
        )
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
    inputs = scene.mechanism.check_inputs(options["inputs"]) if "inputs" in options else start.inputs
    return replace(scene, origin=reached(start, inputs, load, "inputs"))


def _goal_from(settings: Settings, scenes: Sequence[Scene], wanted: Any) -> tuple[Array, Array]:
    """Return the goal that a pose or an equilibrium stands for, and its witness."""
    mechanism, goals = settings.mechanism, settings.task.goals
    if isinstance(wanted, Equilibrium):
        if wanted.mechanism not in (mechanism, *(scene.mechanism for scene in scenes)):
            raise ValueError(f"option goal must be an Equilibrium of {mechanism.name!r}, got {shown(wanted)}")
        if wanted.residual > _RESIDUAL_TOLERANCE:
            raise ValueError(f"option goal must be an equilibrium, got residual {wanted.residual}")
        goal, inputs = goals.of_equilibrium(wanted), mechanism.units.kernel_from_inputs(wanted.inputs)
        if goal not in goals.box:
            raise ValueError(f"option goal must be within the actuators' limits, got {shown(wanted)}")
        return goal, np.append(inputs, wanted.state)
    if goals.with_inputs:
        raise ValueError(f"option goal must be an Equilibrium: a pose does not tell the inputs, got {shown(wanted)}")
    pose = finite_vector("option goal", wanted, mechanism.dof)
    goal = goals.of_pose(pose)
    if goal not in goals.box or not any(_is_in_reach(scene.mechanism, pose) for scene in scenes):
        raise ValueError(f"option goal must be a pose within the reach of the rods, got {shown(wanted)}")
    return goal, np.full(mechanism.leg_count + mechanism.state_size, np.nan)


def _is_in_reach(mechanism: Mechanism, pose: Array) -> bool:
    """Return whether at this pose no hinge is farther from its actuator, within the limits, than its rod is long."""
    for leg, hinge in zip(mechanism.legs, mechanism.hinges(pose).tolist(), strict=True):
        actuator, (lower, upper) = leg.actuator, leg.actuator.limits
        along = math.fsum(
            (there - base) * axis for there, base, axis in zip(hinge, actuator.base, actuator.axis, strict=True)
        )
        if math.dist(actuator.clamp_point(min(max(along, lower), upper)), hinge) > leg.rod.length:
            return False
    return True
