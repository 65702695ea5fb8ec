"""What training and what tests draw: episodes that differ by construction."""

import math
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from pcm_gym.arrays import Array, Mask
from pcm_gym.mechanism.validation import finite_array, one_of

Split = Literal["train", "test"]
SPLITS: tuple[Split, ...] = get_args(Split)

# Least distance between an episode of one part and one of the other: the root of the sum of the squared distances of
# starts and of goals, in mean rod lengths.
GUARD = 0.02
# Strips across the space of starts and goals, in mean rod lengths: those of the training, a gap, those of the test, and
# a gap.
_TRAINING, _TEST = 0.12, 0.04
_PERIOD = _TRAINING + _TEST + 2.0 * GUARD
# What is told of positions (x, y) at the start and at the goal, a number that no pair of them changes faster than
# itself; directions that neither cancel nor lie along an axis.
_ANGLES = (0.5, 1.1)
_DIRECTION = np.array([part for angle in _ANGLES for part in (math.cos(angle), math.sin(angle))]) / math.sqrt(2.0)


def in_split(split: Split, starts: ArrayLike, goals: ArrayLike) -> Mask:
    """Return which pairs (n,) of what is achieved at the start and of the first goal, (n, g) each, are of a part.

    Starts and goals lie in strips of a space of four dimensions, the positions of both. Between a strip of the one part
    and one of the other there is a gap `GUARD` wide, and what lies in it is of neither.
    """
    one_of("split", split, SPLITS)
    starts = finite_array("starts", starts, ("n", "g"))
    goals = finite_array("goals", goals, starts.shape)
    place: Array = np.concatenate([starts[:, :2], goals[:, :2]], axis=1) @ _DIRECTION % _PERIOD
    first, width = (0.0, _TRAINING) if split == "train" else (_TRAINING + GUARD, _TEST)
    is_inside: Mask = (place >= first) & (place < first + width)
    return is_inside
