"""Distances to goals and the rewards that follow from them, over a batch."""

import math
from typing import NamedTuple

import numpy as np

from pcm_gym.arrays import Array, Integers, Mask
from pcm_gym.kernels.numerics.compilation import formula, kernel

# Half of the dense reward falls like 1 / (1 + e / FAR) with the distance e, half like exp(-e / NEAR).
FAR, NEAR = 1.0, 0.05


class GoalProgress(NamedTuple):
    """The goals of a batch and what has been made of them, one row per environment."""

    goals: Array  # (n, p, g): those of successive steps, over and over
    elapsed: Integers  # (n,): steps since the reset
    held: Integers  # (n,): states that are at their goal: in a row up to the present one, or of all steps


class Scale(NamedTuple):
    """What differences from a goal count."""

    weights: Array  # (g,): of the squares of the differences
    tolerance: float  # distance that counts as reached
    is_sparse: bool  # which reward
    counts_all: bool  # whether all states at their goal count, not those in a row


class _Aims(NamedTuple):
    """What becomes of the goals of some rows."""

    desired: Array  # (m, g): the present ones
    rewards: Array  # (m,)


@formula
def _reward(distance: float, scale: Scale) -> float:
    """Return the reward at a distance: 1 or 0, or the mean of a far and a near term, each 1 at the goal."""
    if scale.is_sparse:
        return 1.0 if distance <= scale.tolerance else 0.0
    return 0.5 / (1.0 + distance / FAR) + 0.5 * math.exp(-distance / NEAR)


@formula
def _distance(achieved: Array, desired: Array, row: int, weights: Array) -> float:
    squared = 0.0
    for j in range(achieved.shape[1]):
        difference = achieved[row, j] - desired[row, j]
        squared += weights[j] * difference * difference
    return math.sqrt(squared)


def score_goals(achieved: Array, desired: Array, scale: Scale) -> tuple[Array, Array]:
    """Return the rewards (n,) of achieved for desired goals (n, g), and their distances (n,)."""
    rewards, distances = np.empty(len(achieved)), np.empty(len(achieved))
    _set_scores(achieved, desired, scale, rewards, distances)
    return rewards, distances


@kernel
def _set_scores(achieved: Array, desired: Array, scale: Scale, rewards: Array, distances: Array) -> None:
    for row in range(achieved.shape[0]):
        distances[row] = _distance(achieved, desired, row, scale.weights)
        rewards[row] = _reward(distances[row], scale)


def update_goals(
    achieved: Array, rows: Integers, has_stepped: Mask, is_stable: Mask, progress: GoalProgress, scale: Scale
) -> tuple[Array, Array]:
    """Return the present goals (m, g) of some rows and the rewards (m,) of what is achieved (m, g).

    There is one entry for each row. In those that have stepped time goes on, and what is held is counted anew; a state
    that is not stable holds nothing.
    """
    aims = _Aims(np.empty((len(rows), progress.goals.shape[2])), np.empty(len(rows)))
    _update(achieved, rows, has_stepped, is_stable, progress, scale, aims)
    return aims.desired, aims.rewards


@kernel
def _update(
    achieved: Array,
    rows: Integers,
    has_stepped: Mask,
    is_stable: Mask,
    progress: GoalProgress,
    scale: Scale,
    aims: _Aims,
) -> None:
    distances = np.empty(rows.shape[0])
    _set_next_goals(rows, has_stepped, progress, aims.desired)
    _set_scores(achieved, aims.desired, scale, aims.rewards, distances)
    count_held(rows, has_stepped, (distances <= scale.tolerance) & is_stable, scale.counts_all, progress)


def next_goals(rows: Integers, has_stepped: Mask, progress: GoalProgress) -> Array:
    """Let time go on in the rows that have stepped; return the present goals (m, g) of all."""
    desired = np.empty((len(rows), progress.goals.shape[2]))
    _set_next_goals(rows, has_stepped, progress, desired)
    return desired


@kernel
def _set_next_goals(rows: Integers, has_stepped: Mask, progress: GoalProgress, desired: Array) -> None:
    period = progress.goals.shape[1]
    for k in range(rows.shape[0]):
        row = rows[k]
        progress.elapsed[row] += has_stepped[k]
        phase = progress.elapsed[row] % period if period > 1 else 0
        for j in range(desired.shape[1]):
            desired[k, j] = progress.goals[row, phase, j]


@kernel
def count_held(rows: Integers, has_stepped: Mask, is_held: Mask, counts_all: bool, progress: GoalProgress) -> None:
    """Count the states that are held at their goal, in a row or all of them, in the rows that have stepped."""
    for k in range(rows.shape[0]):
        if has_stepped[k]:
            before = progress.held[rows[k]]
            progress.held[rows[k]] = before + 1 if is_held[k] else (before if counts_all else 0)


@kernel
def set_pose_seen(pose: Array, out: Array) -> None:
    """Fill the first numbers of `out` with a pose (d,) as agents see it: (x, y), and (cos phi, sin phi)."""
    out[0], out[1] = pose[0], pose[1]
    if pose.shape[0] == 3:
        out[2], out[3] = math.cos(pose[2]), math.sin(pose[2])


def poses_seen(x: Array, leg_count: int) -> Array:
    """Return the poses of states (n, 2 legs + d) as agents see them, (n, 2 or 4)."""
    seen = np.empty((len(x), 4 if x.shape[1] - 2 * leg_count == 3 else 2))
    _set_poses_seen(x, 2 * leg_count, seen)
    return seen


@kernel
def _set_poses_seen(x: Array, pose: int, seen: Array) -> None:
    for row in range(x.shape[0]):
        set_pose_seen(x[row, pose:], seen[row])
