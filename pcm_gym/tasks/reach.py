"""Reach: bring the end-effector to a goal pose and keep it there, on stable equilibria only."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pcm_gym.kernels.goals import goals_of, score_goals
from pcm_gym.kernels.threads import pieces_of, run_all
from pcm_gym.kernels.transition import States, wander
from pcm_gym.mechanism import Mechanism, Revolute
from pcm_gym.mechanism.validation import one_of, positive_number

Array = NDArray[np.float64]
RewardType = Literal["dense", "sparse"]

# Walks that make a start from home, how many steps each may take at most, and how many of the agent's each one spans.
_START_WALKS, _START_STEPS, _START_STRIDE = 2, 10, 4.0
# Steps of the walk from start to goal.
_GOAL_STEPS_MIN, _GOAL_STEPS_MAX = 5, 15
_ATTEMPTS = 32
# Starts and goals keep this many times the margin below which a state counts as nearly singular, and this many of the
# agent's steps from the actuators' limits.
_MARGIN_RESERVE, _LIMIT_RESERVE = 2.0, 2.0


@dataclass(frozen=True)
class Episodes:
    """Starts and goals, dimensionless as in the kernels, one row per episode; at the inputs `witness` a goal is met."""

    x: Array  # (n, 2 legs + d)
    inputs: Array  # (n, legs)
    load: Array  # (n, d)
    goal: Array  # (n, 2 or 4)
    witness: Array  # (n, legs)

    def repeated(self, count: int) -> "Episodes":
        """Return `count` copies, one row each, of the first one."""
        arrays = (self.x, self.inputs, self.load, self.goal, self.witness)
        return Episodes(*(np.repeat(array[:1], count, axis=0) for array in arrays))


@dataclass(frozen=True)
class ReachTask:
    """The goals, rewards and success of reaching, as functions over a batch.

    Attributes
    ----------
    mechanism : Mechanism
    reward_type : "dense" or "sparse"
        Sparse: 1 within `success_distance`, else 0. Dense: (max(0, 1 - e) + exp(-e / 0.05)) / 2 with the distance e
        in mean rod lengths. Both are never negative, so that ending an episode early never pays.
    success_distance : float
        Goal distance in m that counts as reached; for a platform the turn counts as the path of its hinges.
    """

    mechanism: Mechanism
    reward_type: RewardType = "dense"
    success_distance: float = 0.02

    def __post_init__(self) -> None:
        one_of("reward_type", self.reward_type, ("dense", "sparse"))
        positive_number("success_distance", self.success_distance)

    @cached_property
    def _arm(self) -> float:
        """Root mean square distance of the hinges from the end-effector's origin, in mean rod lengths."""
        squares = [x * x + y * y for x, y in (leg.attachment for leg in self.mechanism.legs)]
        return math.sqrt(math.fsum(squares) / len(squares)) / self.mechanism.units.length

    def goals_from_features(self, features: Array) -> Array:
        """Return what of the features (n, m) is the achieved goal, (n, 2) or (n, 4), as a new array."""
        return features[:, : 2 * (self.mechanism.dof - 1)].copy()

    def goal_from_pose(self, pose: Array) -> Array:
        """Return the goal, (2,) or (4,), of a pose in the mechanism's units."""
        position = pose[:2] / self.mechanism.units.length
        if self.mechanism.dof == 2:
            return position
        return np.array([position[0], position[1], math.cos(pose[2]), math.sin(pose[2])])

    def pose_from_goal(self, goal: Array) -> Array:
        """Return the pose (d,) in the mechanism's units that a goal, (2,) or (4,), stands for."""
        position = goal[:2] * self.mechanism.units.length
        if self.mechanism.dof == 2:
            return position
        return np.array([position[0], position[1], math.atan2(goal[3], goal[2])])

    @property
    def tolerance(self) -> float:
        """Goal distance in mean rod lengths that counts as reached."""
        return self.success_distance / self.mechanism.units.length

    def score(self, achieved: Array, desired: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Return rewards and successes, (n,) each, of achieved for desired goals (n, 2 or 4)."""
        rewards, distances = score_goals(achieved, desired, self._arm, self.tolerance, self.reward_type == "sparse")
        return rewards, distances <= self.tolerance

    def compute_reward(self, achieved_goal: ArrayLike, desired_goal: ArrayLike) -> float | Array:
        """Return the reward of one achieved for one desired goal, (g,), or those of many, (n, g)."""
        achieved = np.asarray(achieved_goal, dtype=np.float64)
        desired = np.asarray(desired_goal, dtype=np.float64)
        rewards, _ = self.score(np.atleast_2d(achieved), np.atleast_2d(desired))
        return float(rewards[0]) if achieved.ndim == 1 else rewards

    def sample_episodes(
        self,
        home: Episodes,
        stride: Array,
        least_margin: float,
        generators: Sequence[np.random.Generator],
        threads: int = 1,
    ) -> Episodes:
        """Return a new episode for each generator: a start walked to from the first `home`, and a goal from there.

        The walks keep to stable states whose margin is at least twice `least_margin`. That to the goal takes steps
        of at most `stride` (dimensionless), the agent's own, so the goal can be reached without cost. An episode
        depends on its generator alone.
        """
        start, reserve = home.repeated(len(generators)), _MARGIN_RESERVE * least_margin
        states = States(start.x, start.inputs, start.load)
        draws = self._draw(generators, _START_WALKS)
        for walk in range(_START_WALKS):
            self._walk(states, draws[:, walk], (0, _START_STEPS), stride, reserve, threads, _START_STRIDE)
        return self._with_goals(start, stride, least_margin, generators, threads)

    def sample_goals(
        self,
        start: Episodes,
        stride: Array,
        least_margin: float,
        generators: Sequence[np.random.Generator],
        threads: int = 1,
    ) -> Episodes:
        """Return episodes that begin where the first `start` does, each with a new goal away from there."""
        return self._with_goals(start.repeated(len(generators)), stride, least_margin, generators, threads)

    def _with_goals(
        self,
        start: Episodes,
        stride: Array,
        least_margin: float,
        generators: Sequence[np.random.Generator],
        threads: int,
    ) -> Episodes:
        here = goals_of(start.x, self.mechanism.leg_count)
        goal, witness = here.copy(), start.inputs.copy()
        rows = np.arange(len(generators))
        for _ in range(_ATTEMPTS):
            states = States(start.x[rows], start.inputs[rows], start.load[rows])
            draws = self._draw([generators[row] for row in rows.tolist()], 1)[:, 0]
            self._walk(
                states, draws, (_GOAL_STEPS_MIN, _GOAL_STEPS_MAX), stride, _MARGIN_RESERVE * least_margin, threads
            )
            goal[rows], witness[rows] = goals_of(states.x, self.mechanism.leg_count), states.inputs
            rows = rows[self.score(goal[rows], here[rows])[1]]
            if not len(rows):
                break
        return Episodes(start.x, start.inputs, start.load, goal, witness)

    def _draw(self, generators: Sequence[np.random.Generator], walks: int) -> Array:
        """Return numbers from [0, 1), (n, walks, 1 + legs): what decides a walk's length and target."""
        count = 1 + self.mechanism.leg_count
        return np.array([generator.random(walks * count) for generator in generators]).reshape(-1, walks, count)

    def _walk(
        self,
        states: States,
        draws: Array,
        steps_range: tuple[int, int],
        stride: Array,
        least_margin: float,
        threads: int,
        pace: float = 1.0,
    ) -> None:
        """Walk a number of steps of `pace` strides towards inputs drawn evenly from within the limits, in place."""
        mechanism = self.mechanism
        lower, upper = mechanism.lower_limits / mechanism.units.inputs, mechanism.upper_limits / mechanism.units.inputs
        reserve = np.minimum(_LIMIT_RESERVE * stride, 0.25 * (upper - lower))
        targets = lower + reserve + draws[:, 1:] * (upper - lower - 2.0 * reserve)
        least, most = steps_range
        steps = least + (draws[:, 0] * (most - least + 1)).astype(np.int64)

        def walk(first: int, last: int) -> None:
            rows = States(*(array[first:last] for array in states))
            wander(mechanism.leg_table, rows, targets[first:last], pace * stride, steps[first:last], least_margin)

        run_all(pieces_of(walk, len(steps), threads), threads)


def default_max_action(mechanism: Mechanism) -> Array:
    """Return the increment of each input for an action of 1: 0.1 rad, or 0.03 of the mean rod length."""
    is_angle = [isinstance(leg.actuator, Revolute) for leg in mechanism.legs]
    return np.where(is_angle, 0.1, 0.03 * mechanism.units.length)
