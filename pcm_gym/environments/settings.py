"""The arguments of an environment, validated, and the scenes in which its episodes take place."""

from dataclasses import dataclass
from typing import Any, get_args

import numpy as np
from numpy.typing import ArrayLike

from pcm_gym.arrays import Array
from pcm_gym.environments.arguments import DEFAULTS, EnvironmentArguments, Observe, Workspace, task_arguments
from pcm_gym.environments.realism import Actuators, Randomisation, per_leg
from pcm_gym.environments.rig import rig_arguments
from pcm_gym.kernels.charts.distances import spread
from pcm_gym.kernels.charts.walks import walk_in_lanes
from pcm_gym.kernels.numerics.compilation import expect
from pcm_gym.kernels.snaps.instability import CONTINUE, HOLD, SNAP, TERMINATE
from pcm_gym.kernels.stepping.goals import poses_seen, score_goals, update_goals
from pcm_gym.kernels.stepping.report import StepRules
from pcm_gym.kernels.stepping.transition import describe_in_lanes, step_in_lanes
from pcm_gym.mechanism import Mechanism, get_mechanism, mechanism_names
from pcm_gym.mechanism.validation import (
    number_not_negative,
    one_of,
    positive_number,
    shape_of,
    shown,
    truth_value,
    whole_number,
)
from pcm_gym.solving.limits import LimitName, limits_of
from pcm_gym.tasks import SPLITS, Goals, OnInstability, Scene, Split, Task, default_max_action, task_type

# What may happen where stability is lost, and the kernels' codes.
BEHAVIOURS: dict[OnInstability, int] = {"terminate": TERMINATE, "snap": SNAP, "hold": HOLD, "continue": CONTINUE}
# Part of the agent's smallest step that a fold may be near before a state counts as nearly singular.
_NEARLY_SINGULAR = 0.5
# Scenes that turn out to have no home are drawn again, up to so many times each.
_DRAWS_PER_SCENE = 4
_MOST_VARIANTS = 128
# What every environment calls until its first step is done: starts and goals, the step.
_FIRST_CALLED = (walk_in_lanes, spread, poses_seen, score_goals, describe_in_lanes, update_goals, step_in_lanes)


@dataclass(frozen=True)
class Settings:
    """The arguments of an environment, validated.

    Attributes
    ----------
    mechanism : Mechanism
    task : Task
    split : "train" or "test"
        Which episodes are drawn.
    shaping : float, optional
        Discount factor with which a potential shapes the rewards.
    on_instability : "terminate", "snap", "hold" or "continue"
    limits : tuple of "stress", "torque" or "contact"
        Limits of the structure that are watched.
    load_range : array (2, d)
        Least and greatest load on the end-effector in the mechanism's units; equal where it is constant.
    observe_load : bool
        Whether a load that varies is observed.
    max_action : array (legs,)
        Increment of each input for an action of 1, rad or m.
    hold_steps : int
        Steps in a row at the goal that make a success.
    singular_margin : float
        States whose singularity margin, in rad and mean rod lengths, is below this cost `cost_singular`.
    randomisation : Randomisation
    variants : int
        Number of scenes where anything varies.
    actuators : Actuators
    observation_noise : float
        Standard deviation of what is measured.
    observe : "all", "rig" or "pose"
        What is sensed.
    render_mode : "rgb_array", optional
    render_ghosts : bool
        Whether pictures show every other equilibrium at the present inputs.
    render_workspace : Atlas or path, optional
        Atlas, or a file with one, whose stable workspace is the background of pictures.
    """

    mechanism: Mechanism
    task: Task
    split: Split
    shaping: float | None
    on_instability: OnInstability
    limits: tuple[LimitName, ...]
    load_range: Array
    observe_load: bool
    max_action: Array
    hold_steps: int
    singular_margin: float
    randomisation: Randomisation
    variants: int
    actuators: Actuators
    observation_noise: float
    observe: Observe
    render_mode: str | None
    render_ghosts: bool
    render_workspace: Workspace

    @classmethod
    def from_arguments(cls, mechanism: Mechanism | str, arguments: EnvironmentArguments) -> "Settings":
        """Return the settings for the keyword arguments of an environment; raise if one is not allowed."""
        if isinstance(mechanism, str):
            mechanism = get_mechanism(one_of("mechanism", mechanism, mechanism_names()))
        if not isinstance(mechanism, Mechanism):
            raise TypeError(f"mechanism must be a Mechanism or a catalogued name, got {shown(mechanism)}")
        task = _task(mechanism, arguments, DEFAULTS | arguments)
        preset = rig_arguments(task) if getattr(task, "difficulty", None) == "rig" else EnvironmentArguments()
        given = DEFAULTS | preset | arguments
        task = _task(mechanism, arguments, given)
        steps = _steps(mechanism, given["max_action"])
        singular_margin = given["singular_margin"]
        if singular_margin is None:
            singular_margin = _NEARLY_SINGULAR * float(mechanism.units.kernel_from_inputs(steps).min())
        return cls(
            mechanism=mechanism,
            task=task,
            split=one_of("split", given["split"], SPLITS),
            shaping=_shaping(task, given["shaping"]),
            on_instability=_behaviour(task, given["on_instability"]),
            limits=limits_of(mechanism, given["limits"]).names,
            load_range=_load_range(mechanism, given["load"]),
            observe_load=truth_value("observe_load", given["observe_load"]),
            max_action=steps,
            hold_steps=whole_number("hold_steps", given["hold_steps"], least=1),
            singular_margin=positive_number("singular_margin", singular_margin),
            randomisation=Randomisation.from_mapping(given["randomisation"]).check(mechanism),
            variants=whole_number("variants", given["variants"], least=1, most=_MOST_VARIANTS),
            actuators=Actuators.from_arguments(
                mechanism, given["actuator_lag"], given["rate_limit"], given["backlash"]
            ),
            observation_noise=number_not_negative("observation_noise", given["observation_noise"]),
            observe=one_of("observe", given["observe"], get_args(Observe)),
            render_mode=one_of("render_mode", given["render_mode"], (None, "rgb_array")),
            render_ghosts=truth_value("render_ghosts", given["render_ghosts"]),
            render_workspace=given["render_workspace"],
        )

    @property
    def stride(self) -> Array:
        """Increment of each input for an action of 1, dimensionless, (legs,)."""
        return self.mechanism.units.kernel_from_inputs(self.max_action)

    @property
    def rules(self) -> StepRules:
        """What comes of a step, for the kernels."""
        return StepRules(BEHAVIOURS[self.on_instability], self.singular_margin)

    @property
    def load_varies(self) -> bool:
        """Whether the load differs from episode to episode."""
        return bool((self.load_range[0] != self.load_range[1]).any())

    def scene(self, mechanism: Mechanism, load: Array) -> Scene:
        """Return the scene of a mechanism under a load."""
        return Scene(
            mechanism, tuple(load.tolist()), tuple(self.stride.tolist()), self.singular_margin, limits=self.limits
        )

    def scenes(self) -> tuple[Scene, ...]:
        """Return the scenes in which episodes take place: one, or `variants` where mechanism or load vary.

        Raises
        ------
        ValueError
            If a home equilibrium loses stability before it carries the load.
        """
        expect(*_FIRST_CALLED)
        if self.randomisation.is_off and not self.load_varies:
            scene = self.scene(self.mechanism, self.load_range[0])
            scene.announce()
            scene.check_seed()  # home is worked out, or refused, before anything else
            return (scene,)
        self.scene(self.mechanism, self.load_range[1]).announce()
        numbers, found, failure = np.random.default_rng(SPLITS.index(self.split)), [], None
        for _ in range(_DRAWS_PER_SCENE * self.variants):
            mechanism = self.mechanism
            if not self.randomisation.is_off:
                mechanism = self.randomisation.draw(mechanism, numbers)
            scene = self.scene(mechanism, numbers.uniform(self.load_range[0], self.load_range[1]))
            try:
                scene.check_roadmap()
            except ValueError as error:
                failure = error
                continue
            found.append(scene)
            if len(found) == self.variants:
                return tuple(found)
        raise ValueError(
            f"load and randomisation must leave a stable home in a quarter of the variants, got {len(found)} of "
            f"{_DRAWS_PER_SCENE * self.variants}; the last one failed: {failure}"
        )


def _task(mechanism: Mechanism, arguments: EnvironmentArguments, given: EnvironmentArguments) -> Task:
    """Return the task that the arguments ask for, by its name or class, or as it is; `given` has the defaults too."""
    task = given["task"]
    if isinstance(task, Task):
        if task.goals != Goals(mechanism, task.goals.reward_type, task.goals.success_distance, type(task).with_inputs):
            raise ValueError(f"task must have goals of mechanism {mechanism.name!r} and of its own kind, got {task!r}")
        for name in arguments.keys() & {"reward_type", "success_distance", *task.argument_names()}:
            raise TypeError(f"{name} must be given to the task where that is made before, got both it and {task!r}")
        task_arguments(type(task), arguments)
        return task
    kind = task_type(task)
    goals = Goals(mechanism, given["reward_type"], given["success_distance"], kind.with_inputs)
    return kind(goals, **task_arguments(kind, arguments))


def _shaping(task: Task, shaping: Any) -> float | None:
    if shaping is None:
        return None
    factor = positive_number("shaping", shaping)
    if factor > 1.0:
        raise ValueError(f"shaping must be a discount factor of at most 1, got {factor}")
    if task.period > 1:
        raise ValueError(f"shaping must be None for task {type(task).__name__!r}, whose goals move, got {factor}")
    return factor


def _behaviour(task: Task, on_instability: Any) -> OnInstability:
    allowed = task.behaviours
    one_of("on_instability", on_instability, tuple(BEHAVIOURS))
    if on_instability not in allowed:
        raise ValueError(f"on_instability must be one of {list(allowed)} for {task!r}, got {shown(on_instability)}")
    checked: OnInstability = on_instability
    return checked


def _load_range(mechanism: Mechanism, load: ArrayLike | None) -> Array:
    if load is not None and len(shape_of(load)) == 2:
        ends = np.zeros((2, mechanism.dof))
        if shape_of(load)[0] == 2:
            ends[:] = [mechanism.check_load(end) for end in np.asarray(load)]
        if shape_of(load)[0] != 2 or not (ends[0] <= ends[1]).all():
            raise ValueError(f"load must be one load, or (least, greatest), got {shown(load)}")
        return ends
    return np.tile(mechanism.check_load(load), (2, 1))


def _steps(mechanism: Mechanism, max_action: ArrayLike | None) -> Array:
    steps = default_max_action(mechanism) if max_action is None else per_leg("max_action", max_action, mechanism)
    if not np.all(steps > 0.0):
        raise ValueError(f"max_action must be greater than 0, got {steps.tolist()}")
    return steps
