"""Distances to goals and the rewards that follow from them, over a batch."""

import math

import numpy as np
from numpy.typing import NDArray

from pcm_gym.kernels.compilation import kernel

Array = NDArray[np.float64]

# Half of the dense reward falls linearly over this distance, half exponentially over this one.
FAR, NEAR = 1.0, 0.05


@kernel
def score_goals(achieved: Array, desired: Array, arm: float, tolerance: float, is_sparse: bool) -> tuple[Array, Array]:
    """Return the rewards (n,) of achieved for desired goals (n, 2 or 4), and their distances (n,).

    Position differences count as they are, differences of (cos phi, sin phi) as seen at the end of `arm`. Sparse: 1
    within `tolerance`, else 0. Dense: the mean of a far and a near term, each 1 at the goal and never negative.
    """
    count = achieved.shape[0]
    rewards, distances = np.empty(count), np.empty(count)
    for row in range(count):
        squared = 0.0
        for j in range(achieved.shape[1]):
            difference = achieved[row, j] - desired[row, j]
            squared += difference * difference * (1.0 if j < 2 else arm * arm)
        distance = math.sqrt(squared)
        distances[row] = distance
        if is_sparse:
            rewards[row] = 1.0 if distance <= tolerance else 0.0
        else:
            rewards[row] = 0.5 * max(0.0, 1.0 - distance / FAR) + 0.5 * math.exp(-distance / NEAR)
    return rewards, distances


@kernel
def goals_of(x: Array, leg_count: int) -> Array:
    """Return the goals (n, 2 or 4) met by states (n, 2 legs + d): position, and (cos phi, sin phi) of a platform."""
    pose = 2 * leg_count
    is_platform = x.shape[1] - pose == 3
    goals = np.empty((x.shape[0], 4 if is_platform else 2))
    for row in range(x.shape[0]):
        goals[row, 0], goals[row, 1] = x[row, pose], x[row, pose + 1]
        if is_platform:
            goals[row, 2], goals[row, 3] = math.cos(x[row, pose + 2]), math.sin(x[row, pose + 2])
    return goals
