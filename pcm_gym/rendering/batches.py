"""Frames of many equilibria, tiled into one picture."""

import math
from collections.abc import Sequence

import numpy as np

from pcm_gym.mechanism.validation import whole_number
from pcm_gym.rendering.frame import Frame

_GAP = 2  # pixels between tiles
_GAP_GREY = 200


def tile_frames(frames: Sequence[Frame], columns: int | None = None) -> Frame:
    """Return one picture of frames (height, width, 3) of one size, row by row with thin grey lines between them.

    Parameters
    ----------
    frames : sequence of array (height, width, 3) of uint8
    columns : int, optional
        Frames in a row; by default such that there are about as many rows.

    Raises
    ------
    ValueError
        If there are no frames, or they have not all the same shape.
    """
    shapes = {frame.shape for frame in frames}
    if len(shapes) != 1:
        raise ValueError(f"frames must be one or more of one shape, got shapes {sorted(shapes)}")
    height, width, channels = shapes.pop()
    columns = math.ceil(math.sqrt(len(frames))) if columns is None else whole_number("columns", columns, least=1)
    rows = math.ceil(len(frames) / columns)
    tile_height, tile_width = height + _GAP, width + _GAP
    tiled = np.full((rows * tile_height - _GAP, columns * tile_width - _GAP, channels), _GAP_GREY, dtype=np.uint8)
    for number, frame in enumerate(frames):
        row, column = divmod(number, columns)
        top, left = row * tile_height, column * tile_width
        tiled[top : top + height, left : left + width] = frame
    return tiled
