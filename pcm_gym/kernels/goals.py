"""Distances to goals and the rewards that follow from them, over a batch."""

import math

import numpy as np
from numpy.typing import NDArray

from pcm_gym.kernels.compilation import kernel

Array = NDArray[np.float64]


@kernel
def goal_distances(achieved: Array, desired: Array, arm: float, distances: Array) -> None:
    """Fill `distances` (n,) with how far poses are from goals (n, 2 or 4).

    Position differences count as they are, differences of (cos phi, sin phi) as seen at the end of `arm`.
    """
    for row in range(achieved.shape[0]):
        squared = 0.0
        for j in range(achieved.shape[1]):
            difference = achieved[row, j] - desired[row, j]
            squared += difference * difference * (1.0 if j < 2 else arm * arm)
        distances[row] = math.sqrt(squared)


@kernel
def dense_rewards(distances: Array, near: float, rewards: Array) -> None:
    """Fill `rewards` with the mean of a term that falls linearly over 1 and one that falls exponentially over `near`."""
    for row in range(distances.shape[0]):
        distance = distances[row]
        rewards[row] = 0.5 * max(0.0, 1.0 - distance) + 0.5 * math.exp(-distance / near)
