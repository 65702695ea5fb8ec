"""The arguments of an environment, validated, and the scenes in which its episodes take place."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any, Literal

import numpy as np
from gymnasium import spaces
from numpy.typing import ArrayLike

from pcm_gym.arrays import Array
from pcm_gym.environments.realism import Actuators, Randomisation, per_leg
from pcm_gym.kernels.snaps.instability import CONTINUE, HOLD, SNAP, TERMINATE
from pcm_gym.kernels.stepping.report import StepRules
from pcm_gym.mechanism import Mechanism, get_mechanism
from pcm_gym.mechanism.validation import finite_number, one_of, positive_number, whole_number
from pcm_gym.tasks import (
    TASKS,
    Element,
    Goals,
    RewardType,
    Scene,
    Task,
    box_of,
    command_elements,
    default_max_action,
    goal_elements,
    load_elements,
    observation_elements,
)

OnInstability = Literal["terminate", "snap", "hold", "continue"]
# What may happen where stability is lost, and the kernels' codes.
BEHAVIOURS: dict[OnInstability, int] = {"terminate": TERMINATE, "snap": SNAP, "hold": HOLD, "continue": CONTINUE}
# Part of the agent's smallest step that a fold may be near before a state counts as nearly singular.
_NEARLY_SINGULAR = 0.5
# Scenes that turn out to have no home are drawn again, up to so many times each.
_DRAWS_PER_SCENE = 4
_MOST_VARIANTS = 128


@dataclass(frozen=True)
class Settings:
    """The arguments of an environment, validated.

    Attributes
    ----------
    mechanism : Mechanism
    task : Task
    on_instability : "terminate", "snap", "hold" or "continue"
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
    """

    mechanism: Mechanism
    task: Task
    on_instability: OnInstability
    load_range: Array
    observe_load: bool
    max_action: Array
    hold_steps: int
    singular_margin: float
    randomisation: Randomisation
    variants: int
    actuators: Actuators
    observation_noise: float

    @classmethod
    def from_arguments(
        cls,
        mechanism: Mechanism | str = "2RFR",
        *,
        task: str = "Reach",
        reward_type: RewardType = "dense",
        difficulty: str | None = None,
        path: str | None = None,
        success_distance: float = 0.02,
        hold_steps: int = 3,
        on_instability: OnInstability = "terminate",
        max_action: ArrayLike | None = None,
        singular_margin: float | None = None,
        load: ArrayLike | None = None,
        observe_load: bool = True,
        randomisation: Mapping[str, float] | None = None,
        variants: int = 16,
        actuator_lag: float = 0.0,
        rate_limit: ArrayLike | None = None,
        backlash: ArrayLike = 0.0,
        observation_noise: float = 0.0,
    ) -> "Settings":
        """Return the settings for the keyword arguments of an environment; raise if one is not allowed."""
        if isinstance(mechanism, str):
            mechanism = get_mechanism(mechanism)
        if not isinstance(mechanism, Mechanism):
            raise TypeError(f"mechanism must be a Mechanism or a catalogued name, got {mechanism!r}")
        one_of("on_instability", on_instability, tuple(BEHAVIOURS))
        steps = _steps(mechanism, max_action)
        if singular_margin is None:
            singular_margin = _NEARLY_SINGULAR * float(mechanism.units.kernel_from_inputs(steps).min())
        if task == "Switch" and difficulty == "fall" and on_instability != "snap":
            raise ValueError(f"on_instability must be 'snap' for difficulty 'fall', got {on_instability!r}")
        goals = Goals(mechanism, reward_type, success_distance, with_inputs=task == "Switch")
        return cls(
            mechanism=mechanism,
            task=_task(task, goals, {"difficulty": difficulty, "path": path}),
            on_instability=on_instability,
            load_range=_load_range(mechanism, load),
            observe_load=bool(one_of("observe_load", observe_load, (True, False))),
            max_action=steps,
            hold_steps=whole_number("hold_steps", hold_steps, least=1),
            singular_margin=positive_number("singular_margin", singular_margin),
            randomisation=Randomisation.from_mapping(randomisation).check(mechanism),
            variants=_variants(variants),
            actuators=Actuators.from_arguments(mechanism, actuator_lag, rate_limit, backlash),
            observation_noise=_not_negative("observation_noise", observation_noise),
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

    @property
    def always_stable(self) -> bool:
        """Whether no state is ever observed whose stability is lost."""
        return self.on_instability in ("snap", "hold")

    @property
    def elements(self) -> tuple[Element, ...]:
        """The elements of the observation: of the state, and of what else is to be seen."""
        elements = observation_elements(self.mechanism)
        if self.always_stable:
            elements = tuple(element for element in elements if element.name != "is_stable")
        for steps in self.task.look_ahead:
            elements += goal_elements(self.mechanism, steps)
        if self.load_varies and self.observe_load:
            elements += load_elements(self.mechanism)
        if not self.actuators.are_ideal:
            elements += command_elements(self.mechanism)
        return elements

    def spaces(self) -> tuple[spaces.Space[Any], spaces.Space[Any]]:
        """Return observation and action space of one environment."""
        goal = self.task.goals.box
        observation = spaces.Dict({"observation": box_of(self.elements), "achieved_goal": goal, "desired_goal": goal})
        return observation, spaces.Box(-1.0, 1.0, (self.mechanism.leg_count,), np.float32)

    def scene(self, mechanism: Mechanism, load: Array) -> Scene:
        """Return the scene of a mechanism under a load."""
        return Scene(mechanism, tuple(load.tolist()), tuple(self.stride.tolist()), self.singular_margin)

    def scenes(self) -> tuple[Scene, ...]:
        """Return the scenes in which episodes take place: one, or `variants` where mechanism or load vary.

        Raises
        ------
        ValueError
            If a home equilibrium loses stability before it carries the load.
        """
        if self.randomisation.is_off and not self.load_varies:
            scene = self.scene(self.mechanism, self.load_range[0])
            _ = scene.home  # worked out, or refused, before anything else
            return (scene,)
        numbers, found, failure = np.random.default_rng(0), [], None
        for _ in range(_DRAWS_PER_SCENE * self.variants):
            mechanism = self.mechanism
            if not self.randomisation.is_off:
                mechanism = self.randomisation.draw(mechanism, numbers)
            scene = self.scene(mechanism, numbers.uniform(self.load_range[0], self.load_range[1]))
            try:
                _ = scene.roadmap
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


def _task(name: str, goals: Goals, arguments: Mapping[str, Any]) -> Task:
    kind = TASKS[one_of("task", name, list(TASKS))]
    allowed = {field.name for field in fields(kind)} - {"goals"}
    given = {key: value for key, value in arguments.items() if value is not None}
    for key in given:
        if key not in allowed:
            raise ValueError(f"{key} must be None for task {name!r}, got {given[key]!r}")
    return kind(goals, **given)


def _load_range(mechanism: Mechanism, load: ArrayLike | None) -> Array:
    if load is not None and np.ndim(load) == 2:
        if len(load) != 2:  # type: ignore[arg-type]  # what has two dimensions has a length
            raise ValueError(f"load must be one load, or the least and the greatest one, got {load!r}")
        ends = np.stack([mechanism.check_load(end) for end in load])  # type: ignore[union-attr]
        if not (ends[0] <= ends[1]).all():
            raise ValueError(f"load must be (least, greatest), got {load!r}")
        return ends
    return np.tile(mechanism.check_load(load), (2, 1))


def _steps(mechanism: Mechanism, max_action: ArrayLike | None) -> Array:
    steps = default_max_action(mechanism) if max_action is None else per_leg("max_action", max_action, mechanism)
    if not np.all(steps > 0.0):
        raise ValueError(f"max_action must be greater than 0, got {steps.tolist()}")
    return steps


def _not_negative(name: str, value: Any) -> float:
    number = finite_number(name, value)
    if number < 0.0:
        raise ValueError(f"{name} must be at least 0, got {number}")
    return number


def _variants(value: Any) -> int:
    count = whole_number("variants", value, least=1)
    if count > _MOST_VARIANTS:
        raise ValueError(f"variants must be at most {_MOST_VARIANTS}, got {count}")
    return count
