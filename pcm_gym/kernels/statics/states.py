"""The dynamic state of mechanisms, row by row, and when two states are one."""

import math
from typing import NamedTuple

from pcm_gym.arrays import Array
from pcm_gym.kernels.numerics.compilation import kernel

# States that differ by less, relative to 1 + their size, are one.
SAME_STATE = 1e-5


class States(NamedTuple):
    """The dynamic state of a batch, one row per environment; everything else follows from it."""

    x: Array  # (n, size)
    inputs: Array  # (n, legs)
    load: Array  # (n, d)


class Point(NamedTuple):
    """One row of `States`: a state at inputs and under a load, to be moved in place."""

    x: Array  # (size,)
    inputs: Array  # (legs,)
    load: Array  # (d,)


@kernel
def are_same(x: Array, other: Array, leg_count: int) -> bool:
    """Return whether two states at the same inputs, or with the same inputs at the same pose, are one."""
    for j in range(2 * leg_count + 2):
        if not abs(x[j] - other[j]) <= SAME_STATE * (1.0 + abs(x[j])):
            return False
    # a platform's angle is known up to full turns
    return x.shape[0] - 2 * leg_count == 2 or abs(math.sin(0.5 * (x[-1] - other[-1]))) <= SAME_STATE
