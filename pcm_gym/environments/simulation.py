"""The one transition under every environment: a batch of mechanisms, their goals, rewards and costs."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from pcm_gym.arrays import Array, Integers, Mask
from pcm_gym.environments.motion import Motion, Response
from pcm_gym.environments.openings import Generators, open_episodes
from pcm_gym.environments.rows import Outcome, Rows
from pcm_gym.environments.settings import Settings
from pcm_gym.kernels.numerics.threads import LEAST_ROWS, pieces_of, run_all
from pcm_gym.kernels.stepping.features import STABILITY_FEATURES
from pcm_gym.kernels.stepping.goals import pursue
from pcm_gym.kernels.stepping.report import (
    COST_ROWS,
    EVENT,
    FRACTION,
    LIMIT,
    LOST,
    SOLVER,
    VERDICT_ROWS,
    Report,
    StepRules,
)
from pcm_gym.kernels.stepping.transition import describe_batch, step_batch
from pcm_gym.solving import Equilibrium, Event
from pcm_gym.solving.tracking import EVENTS
from pcm_gym.tasks import Scene, box_of, observation_elements

_NO_EVENT, _ACTUATOR_LIMIT = EVENTS.index(Event.NONE), EVENTS.index(Event.ACTUATOR_LIMIT)


class Simulation:
    """Mechanisms that step together, each with its goal.

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
        self.settings = settings
        self.count = count
        self._threads = threads
        self._units = settings.mechanism.units
        self._stride, self._rules = settings.stride, settings.rules
        mechanism, units = settings.mechanism, self._units.inputs
        self.limits = (mechanism.lower_limits / units, mechanism.upper_limits / units)
        elements = observation_elements(settings.mechanism)
        self._feature_count, self._box = len(elements), box_of(elements)
        self._sees_features = settings.elements == elements
        self._all, self._every = np.arange(count), np.ones(count, dtype=np.bool_)
        self.scenes = settings.scenes()
        self.rows = self._rows_at_home()
        self.motion = Motion.of(self.rows)

    def _rows_at_home(self) -> Rows:
        home, goals, count = self.scenes[0].home, self.settings.task.goals, self.count
        states = self.scenes[0].at_equilibrium(home, count)
        period = self.settings.task.period
        return Rows(
            *states,
            scene=np.zeros(count, dtype=np.int64),
            goals=np.tile(goals.of_equilibrium(home), (count, period, 1)),
            witness=np.concatenate([states.inputs, states.x], axis=1),
            elapsed=np.zeros(count, dtype=np.int64),
            held=np.zeros(count, dtype=np.int64),
            lost=np.zeros(count, dtype=np.bool_),
            commands=states.inputs.copy(),
            drives=states.inputs.copy(),
        )

    def equilibrium(self, row: int) -> Equilibrium:
        """Return the present equilibrium of one row."""
        rows, units = self.rows, self._units
        mechanism = self.scenes[rows.scene[row]].mechanism
        return Equilibrium(mechanism, rows.x[row], rows.inputs[row] * units.inputs, rows.load[row] * units.load)

    def witness(self, row: int) -> Equilibrium | None:
        """Return an equilibrium that meets the first goal of one row; None where none is known."""
        here, legs = self.equilibrium(row), self.settings.mechanism.leg_count
        inputs, x = self.rows.witness[row, :legs], self.rows.witness[row, legs:]
        known = not np.isnan(x).any()
        return Equilibrium(here.mechanism, x, inputs * self._units.inputs, here.load) if known else None

    def goal(self, row: int) -> Array:
        """Return the present goal of one row."""
        goals = self.rows.goals[row]
        present: Array = goals[self.rows.elapsed[row] % len(goals)]
        return present

    def step(self, actions: Array, generators: Generators = ()) -> Outcome:
        """Move every row by its action (n, legs), cut to [-1, 1], times the largest increment.

        The generators, one for each row, are the source of noise where the sensors have any.
        """
        report = self._empty_report()
        self._move(self.motion, self._all, actions, self._rules, report)
        return self._outcome(self._all, report, self._every, generators)

    def step_and_reset(self, actions: Array, begun: Mask, generators: Generators) -> Outcome:
        """Begin new episodes in the rows `begun` (n,), without reward, and step the others.

        There is a generator for each row.
        """
        report, rows, stepped = self._empty_report(), np.flatnonzero(begun), np.flatnonzero(~begun)
        begin = partial(self.reset_rows, rows, [generators[row] for row in rows.tolist()], None)
        self._move(self.motion, stepped, actions, self._rules, report, [begin])
        self._describe(rows, report)
        outcome = self._outcome(self._all, report, ~begun, generators)
        outcome.reward[rows] = 0.0
        return outcome

    def foresee(self, motion: Motion, actions: Array, rules: StepRules | None = None) -> Report:
        """Move copies of rows, any number of them, by their actions (m, legs) as a step would; the rows stay.

        What is copied, see `Motion.copied`, is moved in place. Other rules than those of the steps may be asked about.
        """
        report = self._empty_report(len(actions))
        self._move(motion, np.arange(len(actions)), actions, rules or self._rules, report)
        return report

    def observe(self, rows: Integers, generators: Generators = ()) -> Outcome:
        """Return what some rows come to when they stand still, as after a reset: no cost, no event."""
        report = self._empty_report()
        self._describe(rows, report)
        chosen = Report(report.verdicts[:, rows], report.costs[:, rows], report.features[rows])
        return self._outcome(rows, chosen, np.zeros(len(rows), dtype=np.bool_), generators)

    def _move(
        self,
        motion: Motion,
        rows: Integers,
        actions: Array,
        rules: StepRules,
        report: Report,
        beside: Sequence[Callable[[], None]] = (),
    ) -> None:
        """Move some rows by their actions (n, legs), in place, and fill the report; other jobs may be done beside."""
        actuators, threads = self.settings.actuators, self._threads
        if beside and self.count < LEAST_ROWS:
            threads = 1
        response = None if actuators.are_ideal else actuators.respond(actions, motion, self._stride, self.limits)
        moves = actions if response is None else response.moves
        run_all([*beside, *self._step_jobs(motion, rows, moves, rules, report)], threads)
        if response is not None:
            _settle(motion, rows, response, report)

    def _step_jobs(
        self, motion: Motion, rows: Integers, moves: Array, rules: StepRules, report: Report
    ) -> list[Callable[[], None]]:
        states, jobs = motion.states, []
        for scene, members in self._by_scene(motion.scene, rows):

            def step(
                first: int, last: int, legs: Array = scene.mechanism.leg_table, chosen: Integers = members
            ) -> None:
                step_batch(legs, states, chosen[first:last], moves, rules, report)

            jobs += pieces_of(step, len(members), self._threads)
        return jobs

    def _by_scene(self, numbers: Integers, rows: Integers) -> list[tuple[Scene, Integers]]:
        """Return the scenes of some rows, each with its own; the numbers (n,) of the scenes are those of all rows."""
        if len(self.scenes) == 1:
            return [(self.scenes[0], rows)]
        own = numbers[rows]
        return [(self.scenes[number], rows[own == number]) for number in np.unique(own)]

    def _empty_report(self, count: int | None = None) -> Report:
        """Return a report to be filled, on as many rows as the batch has, or on another number of them."""
        count = self.count if count is None else count
        return Report(
            np.empty((VERDICT_ROWS, count)),
            np.empty((COST_ROWS, count)),
            np.empty((count, self._feature_count)),
        )

    def _describe(self, rows: Integers, report: Report) -> None:
        for scene, members in self._by_scene(self.rows.scene, rows):
            describe_batch(scene.mechanism.leg_table, self.rows.states, members, report)
        report.features[rows[self.rows.lost[rows]], -STABILITY_FEATURES] = 0.0

    def _outcome(self, rows: Integers, report: Report, has_stepped: Mask, generators: Generators) -> Outcome:
        goals, state, costs = self.settings.task.goals, self.rows, report.costs
        is_lost, is_unstable = report.verdicts[LOST] > 0.0, report.features[:, -STABILITY_FEATURES] == 0.0
        state.lost[rows] = np.where(has_stepped, is_lost, state.lost[rows])
        achieved = goals.achieved(report.features, state.inputs, rows)
        desired, rewards = pursue(achieved, rows, has_stepped, is_unstable, state.pursuit, goals.scale)
        observed = self._observed(rows, report.features, generators)
        return Outcome(
            {"observation": observed, "achieved_goal": achieved, "desired_goal": desired},
            rewards,
            is_lost,
            costs[SOLVER] > 0.0,
            state.held[rows] >= self.settings.hold_steps,
            costs,
            report.verdicts,
        )

    def _observed(self, rows: Integers, features: Array, generators: Generators) -> Array:
        """Return what is observed of some rows: features (m, f) as the sensors see them, and what else is told."""
        settings = self.settings
        if settings.observation_noise > 0.0:
            features = self._with_noise(features, [generators[row] for row in rows.tolist()])
        if self._sees_features:
            return features
        state, units, parts = self.rows, self._units, [features]
        if settings.always_stable:
            parts = [features[:, :-STABILITY_FEATURES], features[:, 1 - STABILITY_FEATURES :]]
        for steps in settings.task.look_ahead:
            parts.append(state.goals[rows, (state.elapsed[rows] + steps) % state.goals.shape[1]])
        if settings.load_varies and settings.observe_load:
            parts.append(_within(state.load[rows], *(settings.load_range / units.load)))
        if not settings.actuators.are_ideal:
            mechanism = settings.mechanism
            limits = (mechanism.lower_limits / units.inputs, mechanism.upper_limits / units.inputs)
            parts.append(_within(state.commands[rows], *limits))
        return np.concatenate(parts, axis=1)

    def _with_noise(self, features: Array, generators: Generators) -> Array:
        """Return the features (m, f) with noise on all that is measured: on all but the verdicts on stability."""
        measured = features.shape[1] - STABILITY_FEATURES
        noise = np.array([generator.standard_normal(measured) for generator in generators])
        noisy = features.copy()
        noisy[:, :measured] += self.settings.observation_noise * noise
        return np.clip(noisy, self._box.low, self._box.high)

    def reset_rows(self, rows: Integers, generators: Generators, options: Mapping[str, Any] | None) -> None:
        """Begin new episodes in some rows, each with its generator; see `open_episodes`."""
        goals, state = self.settings.task.goals, self.rows
        for opening in open_episodes(self.settings, self.scenes, generators, options, self._threads):
            begun, start = rows[opening.members], opening.states
            for array, values in zip(state.states, start, strict=True):
                array[begun] = values
            state.scene[begun], state.elapsed[begun], state.lost[begun] = opening.scene, 0, False
            state.goals[begun], state.witness[begun] = opening.goals, opening.witness
            state.commands[begun], state.drives[begun] = start.inputs, start.inputs
            _, at_goal = goals.score(goals.of_states(start.x, start.inputs), opening.goals[:, 0])
            state.held[begun] = at_goal


def _settle(motion: Motion, rows: Integers, response: Response, report: Report) -> None:
    """Let the actuators of some rows be where they have got to, and tell of the limits of their commands.

    The mechanism's own limits are met by none of them; who was stopped on the way forgets what it was told.
    """
    events, is_cut = report.verdicts[EVENT, rows], response.is_cut[rows]
    is_usual = (events == _NO_EVENT) | (events == _ACTUATOR_LIMIT)
    report.verdicts[EVENT, rows] = np.where(is_usual, np.where(is_cut, _ACTUATOR_LIMIT, _NO_EVENT), events)
    report.costs[LIMIT, rows] = is_cut
    arrived = (report.verdicts[FRACTION, rows] == 1.0)[:, None]
    motion.commands[rows] = np.where(arrived, response.commands[rows], motion.inputs[rows])
    motion.drives[rows] = np.where(arrived, response.drives[rows], motion.inputs[rows])


def _within(values: Array, lower: Array, upper: Array) -> Array:
    """Return where values (n, k) are between bounds (k,): -1 and 1 at the bounds, 0 between equal ones."""
    half = 0.5 * (upper - lower)
    return (values - 0.5 * (upper + lower)) / np.where(half > 0.0, half, 1.0)
