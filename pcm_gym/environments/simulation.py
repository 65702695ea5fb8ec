"""The one transition under every environment: a batch of mechanisms, their goals, rewards and costs."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from gymnasium import spaces

from pcm_gym.arrays import Array, Integers, Mask
from pcm_gym.environments.episodes import episode_starts
from pcm_gym.environments.motion import Motion, Response
from pcm_gym.environments.rows import Outcome, Rows
from pcm_gym.environments.sensors import Sensors
from pcm_gym.environments.settings import Settings
from pcm_gym.kernels.branches.continuation import ACTUATOR_LIMIT, NONE, SOLVER_FAILURE
from pcm_gym.kernels.numerics.slices import slices
from pcm_gym.kernels.numerics.threads import LARGEST_PIECE, LEAST_ROWS, pieces_of, run_all
from pcm_gym.kernels.stepping.limits import judge_rows
from pcm_gym.kernels.stepping.report import Moves, Report, StepRules, empty_report
from pcm_gym.kernels.stepping.transition import describe_batch, step_batch
from pcm_gym.solving import Equilibrium
from pcm_gym.tasks import Generators, Potential, Scene, box_of


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
        self.limits = settings.mechanism.kernel_limits
        self.sensors = Sensors(settings)
        self._feature_count = len(self.sensors.features.elements)
        self._all, self._every = np.arange(count), np.ones(count, dtype=np.bool_)
        self.scenes = settings.scenes()
        self._discount = settings.shaping or 0.0
        self._potentials = (
            []
            if settings.shaping is None
            else [Potential(scene, settings.task.roadmap(scene)) for scene in self.scenes]
        )
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
            fewest_falls=np.zeros(count, dtype=np.int64),
            potential=np.zeros(count),
            lost=np.zeros(count, dtype=np.bool_),
            commands=states.inputs.copy(),
            drives=states.inputs.copy(),
        )

    def checked_rows(self, saved: Any) -> Rows:
        """Return rows that were saved; raise if they are none of such a simulation."""
        return self.rows.checked(saved, len(self.scenes))

    def restore_rows(self, rows: Rows) -> None:
        """Put rows that were saved in the place of those that there are."""
        for own, array in zip(self.rows, rows, strict=True):
            own[:] = array

    def spaces(self) -> tuple[spaces.Space[Any], spaces.Space[Any]]:
        """Return observation and action space of one row."""
        goal, observation = self.settings.task.goals.box, box_of(self.sensors.layout.elements)
        observed = spaces.Dict({"observation": observation, "achieved_goal": goal, "desired_goal": goal})
        return observed, spaces.Box(-1.0, 1.0, (self.settings.mechanism.leg_count,), np.float32)

    def equilibrium(self, row: int) -> Equilibrium:
        """Return the present equilibrium of one row."""
        rows, units = self.rows, self._units
        mechanism = self.scenes[rows.scene[row]].mechanism
        inputs, load = units.inputs_from_kernel(rows.inputs[row]), units.load_from_kernel(rows.load[row])
        return Equilibrium.unchecked(mechanism, rows.x[row], inputs, load)

    def witness(self, row: int) -> Equilibrium | None:
        """Return an equilibrium that meets the first goal of one row; None where none is known."""
        here, legs = self.equilibrium(row), self.settings.mechanism.leg_count
        inputs, x = self.rows.witness[row, :legs], self.rows.witness[row, legs:]
        if np.isnan(x).any():
            return None
        return Equilibrium.unchecked(here.mechanism, x, self._units.inputs_from_kernel(inputs), here.load)

    def goal(self, row: int) -> Array:
        """Return the present goal of one row."""
        return self.rows.goals_ahead(row)

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
        chosen = Report(report.verdicts[rows], report.features[rows])
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
        states, aims, jobs = motion.states, Moves(moves, self._stride), []
        for scene, members in self._by_scene(motion.scene, rows):

            def step(first: int, last: int, scene: Scene = scene, members: Integers = members) -> None:
                legs, chosen = scene.mechanism.leg_table, members[first:last]
                step_batch(legs, states, chosen, aims, rules, report)
                if scene.limits:
                    judge_rows(legs, states, chosen, scene.structure.bounds, report)

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
        return empty_report(self.count if count is None else count, self._feature_count)

    def _describe(self, rows: Integers, report: Report) -> None:
        for scene, members in self._by_scene(self.rows.scene, rows):
            for first, last in slices(len(members), LARGEST_PIECE):
                describe_batch(scene.mechanism.leg_table, self.rows.states, members[first:last], report)
        lost = rows[self.rows.lost[rows]]
        report.verdicts["is_stable"][lost] = False
        report.features[lost, self.sensors.features["is_stable"]] = 0.0

    def _outcome(self, rows: Integers, report: Report, has_stepped: Mask, generators: Generators) -> Outcome:
        task, state, verdicts = self.settings.task, self.rows, report.verdicts
        is_lost = verdicts["is_lost"]
        state.lost[rows] = np.where(has_stepped, is_lost, state.lost[rows])
        achieved = task.goals._achieved(report.features, state.inputs, rows)
        desired, rewards = task._update_goals(achieved, rows, has_stepped, verdicts["is_stable"], state.progress)
        if self._potentials:
            before = state.potential[rows]
            state.potential[rows] = self._potential(self.motion, rows, state.witness[rows], is_lost)
            rewards = rewards + np.where(has_stepped, self._discount * state.potential[rows] - before, 0.0)
        measured, seen = self.sensors.measure(report.features, rows, generators), achieved
        if self.settings.observe != "all" and measured is not report.features:
            seen = task.goals._achieved(measured, state.inputs, rows)
        verdicts["energy_released"] *= self._units.energy
        progress = state.gone(rows)
        return Outcome(
            {
                "observation": self.sensors.observe(state, rows, measured),
                "achieved_goal": seen,
                "desired_goal": desired,
            },
            rewards,
            is_lost,
            verdicts["event"] == SOLVER_FAILURE,
            task.succeeded(progress, self.settings.hold_steps),
            verdicts,
            task.metrics(achieved, desired) | task.progress_metrics(progress),
            self.settings.limits,
        )

    def shaped(self, rewards: Array, motion: Motion, origin: Integers, is_lost: Mask) -> Array:
        """Return rewards (m,) of steps of the rows `origin` (m,), with the potential's part, where they lead."""
        if not self._potentials:
            return rewards
        after = self._potential(motion, np.arange(len(origin)), self.rows.witness[origin], is_lost)
        return rewards + (self._discount * after - self.rows.potential[origin])

    def _potential(self, motion: Motion, rows: Integers, goals: Array, is_lost: Mask) -> Array:
        """Return the potentials (m,) of some rows of a motion, 0 where stability is lost; see `Potential` for goals."""
        potentials, numbers = np.zeros(len(rows)), motion.scene[rows]
        for number in np.unique(numbers).tolist():
            chosen = np.flatnonzero((numbers == number) & ~is_lost)
            own = rows[chosen]
            potentials[chosen] = self._potentials[number](motion.x[own], motion.inputs[own], goals[chosen])
        return potentials

    def reset_rows(self, rows: Integers, generators: Generators, options: Mapping[str, Any] | None) -> None:
        """Begin new episodes in some rows, each with its generator; see `episode_starts`."""
        task, state = self.settings.task, self.rows
        # all of them are drawn before any row is changed
        for starts in list(episode_starts(self.settings, self.scenes, generators, options, self._threads)):
            begun, start = rows[starts.members], starts.states
            for array, values in zip(state.states, start, strict=True):
                array[begun] = values
            state.scene[begun], state.elapsed[begun], state.lost[begun] = starts.scene, 0, False
            state.goals[begun], state.witness[begun] = starts.goals, starts.witness
            state.fewest_falls[begun] = starts.fewest_falls
            state.commands[begun], state.drives[begun] = start.inputs, start.inputs
            _, at_goal = task._scored(task.goals.of_states(start.x, start.inputs), starts.goals[:, 0])
            state.held[begun] = at_goal & (not task.counts_all)


def _settle(motion: Motion, rows: Integers, response: Response, report: Report) -> None:
    """Let the actuators of some rows be where they have got to, and tell of the limits of their commands.

    The mechanism's own limits are met by none of them; who was stopped on the way forgets what it was told.
    """
    events, is_cut = report.verdicts["event"][rows], response.is_cut[rows]
    is_usual = (events == NONE) | (events == ACTUATOR_LIMIT)
    report.verdicts["event"][rows] = np.where(is_usual, np.where(is_cut, ACTUATOR_LIMIT, NONE), events)
    report.verdicts["at_limit"][rows] = is_cut
    arrived = (report.verdicts["fraction"][rows] == 1.0)[:, None]
    motion.commands[rows] = np.where(arrived, response.commands[rows], motion.inputs[rows])
    motion.drives[rows] = np.where(arrived, response.drives[rows], motion.inputs[rows])
