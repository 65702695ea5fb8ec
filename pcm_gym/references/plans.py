"""Plans of episodes that run side by side."""

import numpy as np

from pcm_gym.arrays import Array, Integers, Mask
from pcm_gym.mechanism import Mechanism


class Plans:
    """Where episodes are to go, one row each, dimensionless.

    Parameters
    ----------
    count : int
        Number of episodes, n.
    legs, size : int
        Numbers of inputs, and of a state.

    Attributes
    ----------
    inputs, x : array (n, p, legs), (n, p, size)
        Inputs and states step by step; after its last step a plan repeats itself.
    offset : array (n, legs)
        What feedback has added to the inputs.
    last : array (n,)
        Place of the last step; -1 where there is no plan.
    place : array (n,)
        The step that comes next.
    planned : array (n,)
        Step of the episode at which it was planned.
    is_over : array (n,)
        Whether its last step has been taken.
    """

    def __init__(self, count: int, legs: int, size: int) -> None:
        self.inputs: Array = np.zeros((count, 1, legs))
        self.x: Array = np.zeros((count, 1, size))
        self.offset: Array = np.zeros((count, legs))
        self.last: Integers = np.full(count, -1)
        self.place: Integers = np.zeros(count, dtype=np.int64)
        self.planned: Integers = np.zeros(count, dtype=np.int64)
        self.is_over: Mask = np.zeros(count, dtype=np.bool_)

    def are_of(self, count: int, mechanism: Mechanism) -> bool:
        """Return whether they have room for so many episodes of a mechanism."""
        return (self.x.shape[0], self.x.shape[2]) == (count, mechanism.state_size)

    @property
    def here(self) -> Array:
        """Inputs at the steps that come next, (n, legs)."""
        here: Array = self.inputs[np.arange(len(self.place)), self.place]
        return here

    @property
    def end(self) -> Array:
        """Inputs at the ends, (n, legs)."""
        return self.inputs[:, -1]

    def drop(self, rows: Integers, elapsed: Integers) -> None:
        """Forget the plans of some rows; others are made for them at these steps of all episodes, (n,)."""
        self.last[rows], self.place[rows], self.planned[rows] = -1, 0, elapsed[rows]
        self.offset[rows], self.is_over[rows] = 0.0, False

    def put(self, row: int, inputs: Array, x: Array) -> None:
        """Put a plan (m, ...) into a row."""
        missing = len(inputs) - self.inputs.shape[1]
        if missing > 0:
            self.inputs, self.x = (np.pad(own, ((0, 0), (0, missing), (0, 0)), "edge") for own in (self.inputs, self.x))
        self.last[row], self.place[row] = len(inputs) - 1, 0
        for own, values in ((self.inputs, inputs), (self.x, x)):
            own[row, : len(values)], own[row, len(values) :] = values, values[-1]
