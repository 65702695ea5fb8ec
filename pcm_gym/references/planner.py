"""The controller that plans: on the true mechanism, or on the one that it believes in."""

from collections.abc import Iterator

import numpy as np

from pcm_gym.arrays import Array, Integers, Mask
from pcm_gym.kernels.charts.motions import forward_jacobians, meet_poses
from pcm_gym.kernels.statics.states import States
from pcm_gym.mechanism import Mechanism
from pcm_gym.references.plans import Plans
from pcm_gym.references.resolved_rate import ResolvedRateController, damped_solutions, shortened
from pcm_gym.references.shielded import shielded
from pcm_gym.references.view import View
from pcm_gym.solving import Equilibrium, MotionPlanner
from pcm_gym.solving.limits import LimitName
from pcm_gym.solving.motion_goals import Goal, carried_over

# An episode is off its plan where its clamps are more than so many steps from it, or its pose so far from the planned
# one, in mean rod lengths and rad. It is planned anew at most every so many steps.
_STEPS_OFF, _POSE_OFF, _PATIENCE = 2.5, 0.15, 5
# What feedback on the pose makes of an error where actuators are not ideal, and damps the Jacobian with; within this
# part of the distance that counts as being at the goal it rests.
_GAIN, _DAMPING, _AT_REST = 0.3, 0.05, 0.25
# Commands within this part of a step are where they were to go: actions have single precision. Where they may have been
# replaced by safe ones it is this part.
_ARRIVED, _NEARLY_ARRIVED = 1e-4, 0.25
# Steps for which the path of a moving goal is followed ahead, and the longest of them, in steps of the agent.
_STEPS_AHEAD, _LONGEST_AHEAD = 256, 3.0


class PlannerController:
    """Plans a motion to the goal when an episode begins, and follows it; plans again where it has got off.

    Commands go along the plan, however late the clamps follow. At its end feedback on the observed pose brings it to
    the goal. A goal that moves is followed by the inputs that lead the planned mechanism along its path, with the same
    feedback. Where there is no plan it acts as the resolved-rate controller does.

    Parameters
    ----------
    knows_truth : bool
        Whether it plans on the mechanism and load of the episode. Else it plans on the nominal ones, those that others
        deviate from, beginning at its stable equilibrium that is nearest to the true one, and its feedback takes the
        Jacobian of these.
    """

    def __init__(self, knows_truth: bool = True) -> None:
        self._knows_truth = knows_truth
        self._planners: dict[
            tuple[Mechanism, bytes, tuple[bytes, bool, float], tuple[LimitName, ...]], MotionPlanner
        ] = {}
        self._plans = Plans(0, 0, 0)
        self._otherwise = ResolvedRateController()

    def act(self, view: View) -> Array:
        """Actions (n, actuators) along the plans."""
        count, legs = view.action_shape
        if not self._plans.are_of(count, view.mechanism):
            self._plans = Plans(count, legs, view.mechanism.state_size)
        begun = view.under_way & (view.elapsed == 0)
        is_due = view.elapsed >= self._plans.planned + _PATIENCE
        rows = np.flatnonzero(begun | (view.under_way & is_due & self._is_off(view)))
        if len(rows):
            self._plan(view, rows)
        actions, is_planned = self._otherwise.act(view), self._plans.last >= 0
        wanted = self._on_time(view) if _goal_moves(view) else self._in_order(view)
        actions[is_planned] = shortened(wanted / view.simulation.settings.stride)[is_planned]
        if self._knows_truth and not view.simulation.settings.actuators.are_ideal:
            # clamps that follow late cut the corners of a plan
            return shielded(view, actions)
        return actions

    def _is_off(self, view: View) -> Mask:
        """Return which episodes (n,) have no plan, or are not on it."""
        plans, motion, legs = self._plans, view.simulation.motion, view.mechanism.leg_count
        apart = np.abs(plans.inputs - motion.inputs[:, None]).max(axis=2)
        nearest = apart.argmin(axis=1)
        rows, stride = np.arange(len(nearest)), view.simulation.settings.stride
        steps_off = (np.abs(plans.inputs[rows, nearest] - motion.inputs) / stride).max(axis=1)
        off = view.observed_poses - plans.x[rows, nearest, 2 * legs :]
        off[:, 2:] = np.sin(0.5 * off[:, 2:]) * 2.0
        has_ended = _goal_moves(view) & (view.elapsed - plans.planned >= plans.last)
        is_off: Mask = (steps_off > _STEPS_OFF) | (np.abs(off).max(axis=1) > _POSE_OFF) | has_ended
        return is_off | (plans.last < 0)

    def _plan(self, view: View, rows: Integers) -> None:
        self._plans.drop(rows, view.elapsed)
        for planner, members, starts in self._by_planner(view, rows):
            if _goal_moves(view):
                self._trace(view, members, starts)
                continue
            goals = [_goal_of(view, row) for row in members.tolist()]
            for row, motion in zip(members.tolist(), planner.plan_many(starts, goals), strict=True):
                if motion is not None:
                    inputs = motion.mechanism.units.kernel_from_inputs(motion.inputs)
                    self._plans.put(row, inputs, motion.states)

    def _by_planner(self, view: View, rows: Integers) -> Iterator[tuple[MotionPlanner, Integers, list[Equilibrium]]]:
        """Return planners, for each those of some rows whose mechanism it plans for, and where they start from."""
        settings = view.simulation.settings
        begun: dict[tuple[Mechanism, bytes], list[tuple[int, Equilibrium]]] = {}
        for row in rows.tolist():
            start = self._start(view, row)
            if start is not None:
                begun.setdefault((start.mechanism, start.load.tobytes()), []).append((row, start))
        for (mechanism, load), own in begun.items():
            room = (settings.stride.tobytes(), settings.actuators.are_ideal, settings.singular_margin)
            key = (mechanism, load, room, settings.limits)
            if key not in self._planners:
                scene = settings.scene(mechanism, own[0][1].load)
                # where clamps follow late, or not quite, there must be room for that
                margin = scene.margin if settings.actuators.are_ideal else scene.reserve
                step = mechanism.units.inputs_from_kernel(settings.stride)
                self._planners[key] = MotionPlanner(
                    mechanism, own[0][1].load, step, margin, [scene.roadmap], settings.limits
                )
            yield self._planners[key], np.array([row for row, _ in own]), [start for _, start in own]

    def _start(self, view: View, row: int) -> Equilibrium | None:
        """Return where an episode is, as far as is known; None where the nominal mechanism has nothing stable there."""
        here, settings = view.equilibrium(row), view.simulation.settings
        if self._knows_truth:
            return here
        load = settings.load_range.mean(axis=0)
        believed = Equilibrium.unchecked(here.mechanism, here.state, here.inputs, load)
        try:
            return carried_over(believed, settings.mechanism, "start")
        except ValueError:
            return None

    def _trace(self, view: View, rows: Integers, starts: list[Equilibrium]) -> None:
        """Plan the inputs that lead along the path of a goal that moves, step by step of the time."""
        mechanism, values = starts[0].mechanism, [start.kernel_values() for start in starts]
        legs, stride = mechanism.leg_count, view.simulation.settings.stride
        states = States(*(np.array(parts) for parts in zip(*values, strict=True)))
        inputs, x = [states.inputs.copy()], [states.x.copy()]
        for ahead in range(1, _STEPS_AHEAD + 1):
            poses = view.poses_of(view.simulation.rows.goals_ahead(rows, ahead))
            turns = np.round((states.x[:, 2 * legs + 2 :] - poses[:, 2:]) / (2.0 * np.pi))
            poses[:, 2:] += 2.0 * np.pi * turns
            states.x[:, 2 * legs :] = poses
            is_met = meet_poses(mechanism.leg_table, states)
            is_met &= (np.abs(states.inputs - inputs[-1]) / stride).max(axis=1) <= _LONGEST_AHEAD
            # where the path cannot be followed it is awaited
            states.inputs[~is_met], states.x[~is_met] = inputs[-1][~is_met], x[-1][~is_met]
            inputs.append(states.inputs.copy())
            x.append(states.x.copy())
        for place, row in enumerate(rows.tolist()):
            self._plans.put(row, np.array([own[place] for own in inputs]), np.array([own[place] for own in x]))

    def _in_order(self, view: View) -> Array:
        """Return how far commands are to go, (n, legs): from step to step of the plan, then as feedback tells."""
        plans, settings = self._plans, view.simulation.settings
        commands, drives = settings.actuators.told(view.simulation.motion)
        near = _ARRIVED if settings.actuators.are_ideal else _NEARLY_ARRIVED
        has_arrived = (np.abs(plans.here - commands) / settings.stride).max(axis=1) <= near
        is_over = (plans.place >= plans.last) & (has_arrived | plans.is_over)
        plans.is_over[:] = is_over
        # drives whose rate is limited are waited for
        leads = (np.abs(commands - drives) / settings.stride).max(axis=1)
        plans.place[has_arrived & ~is_over & (leads <= 1.0 / settings.actuators.part)] += 1
        return np.where(is_over[:, None], self._feedback(view), plans.here - commands)

    def _on_time(self, view: View) -> Array:
        """Return how far commands are to go, (n, legs), for the clamps to be in the next step where they are to be."""
        plans, simulation = self._plans, view.simulation
        actuators = simulation.settings.actuators
        commands, drives = actuators.told(simulation.motion)
        plans.offset[:] += self._feedback(view)
        before = plans.here
        plans.place[:] = np.clip(view.elapsed - plans.planned + 1, 0, np.maximum(plans.last, 0))
        # the gear has play, and drives go a part of the way only
        aims = plans.here + plans.offset + 0.5 * actuators.backlash * np.sign(plans.here - before)
        return drives + (aims - drives) / actuators.part - commands

    def _feedback(self, view: View) -> Array:
        """Return how far inputs are to go to bring what is observed nearer to the goal, (n, legs)."""
        settings, errors = view.simulation.settings, view.pose_errors
        gain = 1.0 if settings.actuators.are_ideal else _GAIN
        if settings.task.with_inputs:
            return gain * (self._plans.end - view.simulation.motion.inputs)
        is_far = np.linalg.norm(errors, axis=1, keepdims=True) > _AT_REST * settings.task.goals.tolerance
        jacobians = view.jacobians if self._knows_truth else self._believed_jacobians(view)
        return np.where(is_far, gain * damped_solutions(jacobians, errors, _DAMPING), 0.0)

    def _believed_jacobians(self, view: View) -> Array:
        """Return the Jacobians of the nominal mechanism where the plans are, (n, d, legs); 0 without a plan."""
        plans, rows = self._plans, np.flatnonzero(view.under_way & (self._plans.last >= 0))
        found, place = np.zeros((len(plans.last), view.mechanism.dof, view.mechanism.leg_count)), plans.place[rows]
        found[rows] = forward_jacobians(view.mechanism.leg_table, plans.x[rows, place], plans.inputs[rows, place])
        return found


def _goal_moves(view: View) -> bool:
    return view.simulation.settings.task.period > 1


def _goal_of(view: View, row: int) -> Goal:
    """Return the goal of a row as planners take it."""
    goals, goal = view.simulation.settings.task.goals, view.simulation.goal(row)
    if not goals.with_inputs:
        return goals.pose(goal)
    inputs = view.mechanism.units.inputs_from_kernel(goal[-view.mechanism.leg_count :])
    return {"pose": goals.pose(goal), "inputs": inputs}
