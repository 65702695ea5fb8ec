"""The keyword arguments of an environment: declared, documented and given their defaults here and nowhere else."""

import os
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, TypedDict

from numpy.typing import ArrayLike

from pcm_gym.solving.limits import LimitName
from pcm_gym.tasks import (
    TASKS,
    OnInstability,
    Path,
    ReachDifficulty,
    RewardType,
    Split,
    SwitchDifficulty,
    Task,
    TrackDifficulty,
)

if TYPE_CHECKING:
    from pcm_gym.solving import Atlas

Workspace: TypeAlias = "Atlas | str | os.PathLike[str] | None"
Observe = Literal["all", "rig", "pose"]


class EnvironmentArguments(TypedDict, total=False):
    """Keyword arguments of an environment; none is required.

    A task from outside the package adds its own ones, which are its fields: ``task=Lift, rise=0.1``. Type checkers,
    which do not know them, take ``task=Lift(Goals(mechanism), rise=0.1)``.

    Parameters
    ----------
    render_mode : "rgb_array", optional
        What `render` returns: pictures. With "human", `gymnasium.make` shows these pictures in a window.
    render_ghosts : bool
        Whether pictures show every other equilibrium at the present inputs, faintly, stable or not. They are solved for
        when a picture is drawn: about 10 ms for two legs, a second for a platform.
    render_workspace : Atlas or path, optional
        Atlas of the same mechanism under the same load, or a file with one; its stable workspace is the background of
        the pictures.
    task : "Reach", "Track" or "Switch"
        Reach a goal pose, follow a goal on a closed path, or reach another stable equilibrium at the same inputs. Or
        any other task: its name, once registered, its class, or itself.
    reward_type : "dense" or "sparse"
        How the distance to the goal is rewarded; see `pcm_gym.tasks.Goals`.
    shaping : float, optional
        Discount factor c of the agent, in (0, 1]. With it, rewards contain `c P(s') - P(s)`, where the potential P of a
        state falls by 0.01 with every step of a planner between it and the goal, and is 0 where stability is lost: it
        guides the agent and changes no best policy (A. Y. Ng, D. Harada, S. Russell, 1999, ICML). Not for goals that
        move. `compute_reward` is without it.
    split : "train" or "test"
        Which episodes are drawn. Those of training and test never come nearer to each other than 0.02 mean rod lengths,
        the root of the sum of the squared distances of their starts and goals, and are of other variants where loads or
        mechanisms are drawn. Starts and goals that `reset` is asked for are of neither, and a task from outside has two
        parts only if it says so, with `has_split`.
    difficulty : str, optional
        The tier: where the goals are, or what leads to them; see `pcm_gym.tasks.Reach`, `Track` and `Switch`. With
        "rig" the defaults of `load` and what follows are those of a real rig, for Track of `success_distance` too, see
        `pcm_gym.environments.rig`.
    path : "circle", "eight", "spline" or "any", optional
        For Track: the shape of the paths, any by default; see `pcm_gym.tasks.Track`.
    success_distance : float
        Distance to the goal, in m, that counts as being there.
    hold_steps : int
        States in a row at the goal that make a success.
    on_instability : "terminate", "snap", "hold" or "continue"
        What comes of a step that loses stability; see "Loss of stability".
    max_action : float or array_like (legs,), optional
        Increment of each input for an action of 1; 0.1 rad or 0.03 mean rod lengths by default.
    singular_margin : float, optional
        Threshold of `cost_singular`: estimated distance of the nearest fold in the space of the inputs, in rad and mean
        rod lengths; by default half of the agent's smallest step.
    limits : sequence of "stress", "torque" or "contact"
        Limits of the structure that are watched, none by default. Each adds its cost, `cost_stress`, `cost_torque` or
        `cost_contact`, to the infos and to `cost`: 1 where the state after a step breaks it. Starts, goals, paths and
        the nodes of roadmaps keep them. Stress takes rods of a section and a material, torque takes actuators with a
        `greatest_torque` or `greatest_force`. Contact is a rod that crosses itself, on a platform also another rod or
        an edge of the platform.
    load : array_like (d,) or (2, d), optional
        Load on the end-effector, N (and N m): constant, or the least and the greatest of a range from which it is drawn
        at each reset.
    observe_load : bool
        Whether a load that is drawn is observed.
    randomisation : mapping of str to float, optional
        How much the mechanism differs from episode to episode: largest relative deviations of "stiffness" and "length"
        of each rod, largest deviations in m of each "base" and each "attachment".
    variants : int
        Where loads or mechanisms are drawn: out of so many, which are the same for all environments, up to 128. Each
        takes some tenths of a second when an environment is first made.
    actuator_lag : float
        Time constant with which the actuators follow, in steps.
    rate_limit : float or array_like (legs,), optional
        Largest move of each actuator in a step, rad or m.
    backlash : float or array_like (legs,)
        Play between each actuator and its clamp, rad or m.
    observation_noise : float
        Standard deviation of normal noise on all measured elements of `observation`; the goals and the verdicts on
        stability are exact.
    observe : "all", "rig" or "pose"
        What is sensed of a state: everything; what a rig has, which is the pose, the inputs and what the actuators
        give; or the pose alone. With the last two `achieved_goal` has the noise of the pose, too.
    """

    render_mode: Literal["rgb_array"] | None
    render_ghosts: bool
    render_workspace: Workspace
    task: str | type[Task] | Task
    reward_type: RewardType
    shaping: float | None
    split: Split
    difficulty: ReachDifficulty | TrackDifficulty | SwitchDifficulty | None
    path: Path | None
    success_distance: float
    hold_steps: int
    on_instability: OnInstability
    max_action: ArrayLike | None
    singular_margin: float | None
    limits: Sequence[LimitName]
    load: ArrayLike | None
    observe_load: bool
    randomisation: Mapping[str, float] | None
    variants: int
    actuator_lag: float
    rate_limit: ArrayLike | None
    backlash: ArrayLike
    observation_noise: float
    observe: Observe


DEFAULTS: EnvironmentArguments = {
    "render_mode": None,
    "render_ghosts": False,
    "render_workspace": None,
    "task": "Reach",
    "reward_type": "dense",
    "shaping": None,
    "split": "train",
    "difficulty": None,
    "path": None,
    "success_distance": 0.02,
    "hold_steps": 3,
    "on_instability": "terminate",
    "max_action": None,
    "singular_margin": None,
    "limits": (),
    "load": None,
    "observe_load": True,
    "randomisation": None,
    "variants": 16,
    "actuator_lag": 0.0,
    "rate_limit": None,
    "backlash": 0.0,
    "observation_noise": 0.0,
    "observe": "all",
}


# Arguments that a task of the package has of its own, and those that every environment has.
_OF_TASKS = {name for task in TASKS.values() for name in task.argument_names()}
_COMMON = tuple(name for name in DEFAULTS if name not in _OF_TASKS)
# What environments and their batches take beside these.
CONSTRUCTION = ("mechanism", "num_envs", "max_episode_steps", "autoreset_mode", "threads")


def task_arguments(task: type[Task], arguments: Mapping[str, Any]) -> dict[str, Any]:
    """Return those of an environment's arguments that are its task's own; None stands for the task's default.

    Raises
    ------
    TypeError
        If an argument is neither the environment's nor the task's, or would be both.
    ValueError
        If it is that of another task.
    """
    name, own = task.__name__, task.argument_names()
    allowed = ["mechanism", *_COMMON, *own]
    for key in arguments.keys() - {*allowed, *_OF_TASKS}:
        raise TypeError(f"{key!r} is no argument of an environment with task {name!r}, which takes {allowed}")
    for key in {*own} & {*_COMMON, *CONSTRUCTION}:
        raise TypeError(f"{key!r} must not be an argument of task {name!r}: every environment has one of that name")
    found = {key: value for key, value in arguments.items() if key not in _COMMON and value is not None}
    for key in found.keys() - {*own}:
        raise ValueError(f"{key} must be None for task {name!r}, got {found[key]!r}")
    return found
