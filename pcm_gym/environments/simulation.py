"""The one transition under every environment: a batch of mechanisms, their goals, rewards and costs."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pcm_gym.kernels.instability import CONTINUE, HOLD, SNAP, TERMINATE
from pcm_gym.kernels.threads import LEAST_ROWS, pieces_of, run_all
from pcm_gym.kernels.transition import (
    COST_ROWS,
    EVENT,
    LIMIT,
    LOST,
    MORSE_INDEX,
    RESIDUAL,
    SINGULAR,
    SINGULARITY_MARGIN,
    SOLVER,
    STABILITY_FEATURES,
    STABILITY_MARGIN,
    UNSTABLE,
    VERDICT_ROWS,
    Report,
    States,
    describe_batch,
    step_batch,
)
from pcm_gym.mechanism import Mechanism, get_mechanism
from pcm_gym.mechanism.validation import finite_vector, one_of, positive_number
from pcm_gym.solving import BranchTracker, Equilibrium, Event, home_equilibrium
from pcm_gym.solving.tracking import EVENTS
from pcm_gym.tasks import Episodes, ReachTask, default_max_action, goal_box, observation_elements
from pcm_gym.tasks.reach import RewardType

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
OnInstability = Literal["terminate", "snap", "hold", "continue"]

_EVENT_NAMES = np.array([event.value for event in EVENTS], dtype=object)
_RESET_OPTIONS = ("inputs", "equilibrium", "goal", "load")
# What may happen where stability is lost, and the kernels' codes.
BEHAVIOURS: dict[OnInstability, int] = {"terminate": TERMINATE, "snap": SNAP, "hold": HOLD, "continue": CONTINUE}
# What `reset` takes as an equilibrium may be rounded, not wrong.
_RESIDUAL_TOLERANCE = 1e-8


@dataclass(frozen=True)
class Settings:
    """The arguments of an environment, validated.

    Attributes
    ----------
    mechanism : Mechanism
    task : ReachTask
    on_instability : "terminate", "snap", "hold" or "continue"
    load : array (d,)
        Load on the end-effector in the mechanism's units.
    max_action : array (legs,)
        Increment of each input for an action of 1, rad or m.
    singular_margin : float
        States whose singularity margin is below this cost `cost_singular`.
    """

    mechanism: Mechanism
    task: ReachTask
    on_instability: OnInstability
    load: Array
    max_action: Array
    singular_margin: float

    @classmethod
    def from_arguments(
        cls,
        mechanism: Mechanism | str,
        reward_type: RewardType,
        on_instability: OnInstability,
        load: ArrayLike | None,
        max_action: ArrayLike | None,
        success_distance: float,
        singular_margin: float,
    ) -> "Settings":
        """Return the settings for the keyword arguments of an environment; raise if one is not allowed."""
        if isinstance(mechanism, str):
            mechanism = get_mechanism(mechanism)
        if not isinstance(mechanism, Mechanism):
            raise TypeError(f"mechanism must be a Mechanism or a catalogued name, got {mechanism!r}")
        one_of("on_instability", on_instability, tuple(BEHAVIOURS))
        if max_action is None:
            steps = default_max_action(mechanism)
        else:
            count = mechanism.leg_count
            steps = finite_vector(
                "max_action", np.full(count, max_action) if np.ndim(max_action) == 0 else max_action, count
            )
        if not np.all(steps > 0.0):
            raise ValueError(f"max_action must be greater than 0, got {steps.tolist()}")
        return cls(
            mechanism=mechanism,
            task=ReachTask(mechanism, reward_type, success_distance),
            on_instability=on_instability,
            load=mechanism.check_load(load),
            max_action=steps,
            singular_margin=positive_number("singular_margin", singular_margin),
        )


class Outcome(NamedTuple):
    """What one step, or a reset, of some rows came to; every array is new."""

    observation: dict[str, Array]
    reward: Array  # (n,)
    terminated: Mask  # (n,): stability was lost, and what comes of it is not followed
    failed: Mask  # (n,): the solver failed
    success: Mask  # (n,)
    costs: Array  # (4, n)
    verdicts: Array  # (7, n)

    def row_info(self, row: int) -> dict[str, Any]:
        """Return the info of one row, in Python's own types."""
        verdict, costs = self.verdicts[:, row].tolist(), self.costs[:, row].tolist()
        return {
            "is_success": bool(self.success[row]),
            "cost": sum(costs),
            "cost_unstable": costs[UNSTABLE],
            "cost_singular": costs[SINGULAR],
            "cost_limit": costs[LIMIT],
            "cost_solver": costs[SOLVER],
            "index": int(verdict[MORSE_INDEX]),
            "stability_margin": verdict[STABILITY_MARGIN],
            "singularity_margin": verdict[SINGULARITY_MARGIN],
            "residual": verdict[RESIDUAL],
            "event": _EVENT_NAMES[int(verdict[EVENT])],
        }

    def infos(self) -> dict[str, NDArray[Any]]:
        """Return the infos of all rows, one array per key; those of numbers are parts of this outcome."""
        verdicts, costs = self.verdicts, self.costs
        return {
            "is_success": self.success,
            "cost": costs.sum(axis=0),
            "cost_unstable": costs[UNSTABLE],
            "cost_singular": costs[SINGULAR],
            "cost_limit": costs[LIMIT],
            "cost_solver": costs[SOLVER],
            "index": verdicts[MORSE_INDEX].astype(np.int64),
            "stability_margin": verdicts[STABILITY_MARGIN],
            "singularity_margin": verdicts[SINGULARITY_MARGIN],
            "residual": verdicts[RESIDUAL],
            "event": _EVENT_NAMES[verdicts[EVENT].astype(np.intp)],
        }


class Simulation:
    """The states and goals of `count` mechanisms that step together, and whose episode a loss of stability has ended.

    Parameters
    ----------
    settings : Settings
    count : int
        Number of rows.
    threads : int
        Threads that share the rows where they are many. No result depends on their number.

    Raises
    ------
    ValueError
        If the home equilibrium loses stability before it carries the load.
    """

    def __init__(self, settings: Settings, count: int, threads: int = 1) -> None:
        mechanism = settings.mechanism
        self.settings = settings
        self.count = count
        self._threads = threads
        self._units = mechanism.units
        self._stride = settings.max_action / self._units.inputs
        self._behaviour = BEHAVIOURS[settings.on_instability]
        self._free_home = home_equilibrium(mechanism)
        self._home = self._home_under(settings.load)
        self._feature_count = len(observation_elements(mechanism))
        self._rows = np.arange(count)
        start = self._home.repeated(count)
        self.states = States(start.x, start.inputs, start.load)
        self.goals, self.witnesses = start.goal, start.witness
        self.lost = np.zeros(count, dtype=np.bool_)

    def equilibrium(self, row: int) -> Equilibrium:
        """Return the present equilibrium of one row."""
        return Equilibrium(
            self.settings.mechanism,
            self.states.x[row],
            self.states.inputs[row] * self._units.inputs,
            self.states.load[row] * self._units.load,
        )

    def step(self, actions: Array) -> Outcome:
        """Move every row by its action (n, legs), cut to [-1, 1], times the largest increment."""
        report = self._empty_report()
        run_all(self._step_jobs(self._rows, actions, report), self._threads)
        outcome = self._outcome(report, self.goals.copy())
        self.lost = outcome.terminated.copy()
        return outcome

    def step_and_reset(self, actions: Array, begun: Mask, generators: Sequence[np.random.Generator]) -> Outcome:
        """Begin new episodes in the rows `begun` (n,), each with its generator, without reward, and step the others."""
        report, rows = self._empty_report(), np.flatnonzero(begun)
        stepped = np.flatnonzero(~begun)
        begin = partial(self.reset_rows, rows, generators, None)
        run_all([begin, *self._step_jobs(stepped, actions, report)], self._threads if self.count >= LEAST_ROWS else 1)
        self.lost[stepped] = report.verdicts[LOST, stepped] > 0.0
        self._describe(rows, report)
        outcome = self._outcome(report, self.goals.copy())
        outcome.reward[rows] = 0.0
        return outcome

    def _step_jobs(self, rows: NDArray[np.intp], actions: Array, report: Report) -> list[Callable[[], None]]:
        legs, margin = self.settings.mechanism.leg_table, self.settings.singular_margin
        behaviour = self._behaviour

        def step(first: int, last: int) -> None:
            step_batch(legs, self.states, rows[first:last], actions, self._stride, behaviour, margin, report)

        return pieces_of(step, len(rows), self._threads)

    def observe(self, rows: NDArray[np.intp]) -> Outcome:
        """Return what some rows come to when they stand still, as after a reset: no cost, no event."""
        report = self._empty_report()
        self._describe(rows, report)
        chosen = Report(report.verdicts[:, rows], report.costs[:, rows], report.features[rows])
        return self._outcome(chosen, self.goals[rows])

    def _empty_report(self) -> Report:
        return Report(
            np.empty((VERDICT_ROWS, self.count)),
            np.empty((COST_ROWS, self.count)),
            np.empty((self.count, self._feature_count)),
        )

    def _describe(self, rows: NDArray[np.intp], report: Report) -> None:
        describe_batch(self.settings.mechanism.leg_table, self.states, rows, report)
        report.features[rows[self.lost[rows]], -STABILITY_FEATURES] = 0.0

    def _outcome(self, report: Report, goals: Array) -> Outcome:
        task, costs = self.settings.task, report.costs
        achieved = task.goals_from_features(report.features)
        rewards, successes = task.score(achieved, goals)
        is_stable = report.features[:, -STABILITY_FEATURES] > 0.0
        return Outcome(
            {"observation": report.features, "achieved_goal": achieved, "desired_goal": goals},
            rewards,
            report.verdicts[LOST] > 0.0,
            costs[SOLVER] > 0.0,
            successes & is_stable,
            costs,
            report.verdicts,
        )

    def reset_rows(
        self,
        rows: Sequence[int] | NDArray[np.intp],
        generators: Sequence[np.random.Generator],
        options: Mapping[str, Any] | None,
    ) -> None:
        """Begin new episodes in some rows.

        Parameters
        ----------
        rows : sequence of int
        generators : sequence of numpy.random.Generator
            For each of the rows the source of its start and goal.
        options : mapping, optional
            Any of `inputs` (start there), `equilibrium` (start with it), `goal` (a pose) and `load`.

        Raises
        ------
        ValueError
            If an option is unknown, of wrong shape, or cannot be met on stable equilibria; with "continue" the
            equilibrium may be unstable, and what is reached from it too.
        """
        options = options or {}
        for name in options:
            one_of("options key", name, _RESET_OPTIONS)
        episodes = self._sample(options, generators)
        for array, values in zip(self.states, (episodes.x, episodes.inputs, episodes.load), strict=True):
            array[rows] = values
        self.goals[rows], self.witnesses[rows] = episodes.goal, episodes.witness
        self.lost[rows] = False

    def _sample(self, options: Mapping[str, Any], generators: Sequence[np.random.Generator]) -> Episodes:
        settings, task = self.settings, self.settings.task
        margin = settings.singular_margin
        if "equilibrium" in options or "inputs" in options:
            start = self._start_from(options)
            is_stable = options.get("equilibrium", self._free_home).is_stable
            episodes = task.sample_goals(
                start if is_stable else self._home, self._stride, margin, generators, self._threads
            )
            if not is_stable:  # its goal is stable none the less
                there = start.repeated(len(generators))
                episodes = replace(episodes, x=there.x, inputs=there.inputs, load=there.load)
        else:
            home = self._home_under(options["load"]) if "load" in options else self._home
            episodes = task.sample_episodes(home, self._stride, margin, generators, self._threads)
        if "goal" in options:
            episodes.goal[:] = self._goal_from(options["goal"])
        return episodes

    def _goal_from(self, pose: ArrayLike) -> Array:
        mechanism = self.settings.mechanism
        goal = self.settings.task.goal_from_pose(finite_vector("option goal", pose, mechanism.dof))
        if goal not in goal_box(mechanism):
            raise ValueError(f"option goal must be a pose within the reach of the rods, got {pose!r}")
        return goal

    def _start_from(self, options: Mapping[str, Any]) -> Episodes:
        mechanism = self.settings.mechanism
        start = options.get("equilibrium", self._free_home)
        if not isinstance(start, Equilibrium) or start.mechanism != mechanism:
            raise ValueError(f"option equilibrium must be an Equilibrium of {mechanism.name!r}, got {start!r}")
        if not start.is_stable and self.settings.on_instability != "continue":
            raise ValueError(f"option equilibrium must be stable, got index {start.index}")
        if not start.within_limits:
            raise ValueError(f"option equilibrium must be within the actuators' limits, got {start.inputs.tolist()}")
        if start.residual > _RESIDUAL_TOLERANCE:
            raise ValueError(f"option equilibrium must be one, got residual {start.residual}")
        load = self.settings.load if "equilibrium" not in options else start.load
        load = mechanism.check_load(options["load"]) if "load" in options else load
        loaded = _tracked(start, start.inputs, load, "load")
        return self._episode_at(_tracked(loaded, options.get("inputs", start.inputs), load, "inputs"))

    def _home_under(self, load: ArrayLike) -> Episodes:
        home = self._free_home
        return self._episode_at(_tracked(home, home.inputs, self.settings.mechanism.check_load(load), "load"))

    def _episode_at(self, start: Equilibrium) -> Episodes:
        inputs = start.inputs / self._units.inputs
        goal = self.settings.task.goal_from_pose(start.pose)
        values = (np.array(start.state), inputs, start.load / self._units.load, goal, inputs)
        return Episodes(*(value[None] for value in values))


def _tracked(start: Equilibrium, inputs: ArrayLike, load: Array, name: str) -> Equilibrium:
    """Return the equilibrium at `inputs` under `load` on the branch of `start`; raise if the way ends before."""
    if np.array_equal(inputs, start.inputs) and np.array_equal(load, start.load):
        return start
    step = BranchTracker(start.mechanism, start).step(inputs, load)
    if step.event is not Event.NONE:
        value = load.tolist() if name == "load" else np.asarray(inputs).tolist()
        raise ValueError(
            f"{name} must be reachable from home on stable equilibria, got {value}: "
            f"{step.event} after {step.fraction:.3f} of the way. {step.event.message}"
        )
    return step.equilibrium
