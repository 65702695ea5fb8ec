"""Frames of several equilibria, tiled into one picture."""

import numpy as np
import pytest

from pcm_gym.rendering import tile_frames


@pytest.mark.parametrize(("count", "columns", "shape"), [(1, None, (1, 1)), (5, None, (2, 3)), (6, 2, (3, 2))])
def test_tiles_keep_their_pixels_and_order(count: int, columns: int | None, shape: tuple[int, int]) -> None:
    frames = list(np.random.default_rng(0).integers(0, 256, (count, 7, 5, 3), dtype=np.uint8))
    kept = [frame.copy() for frame in frames]
    tiled = tile_frames(frames, columns)
    rows, across = shape
    assert tiled.shape == (9 * rows - 2, 7 * across - 2, 3)
    for number, frame in enumerate(kept):
        row, column = divmod(number, across)
        np.testing.assert_array_equal(tiled[9 * row : 9 * row + 7, 7 * column : 7 * column + 5], frame)
        np.testing.assert_array_equal(frames[number], frame)
    assert not any(np.shares_memory(tiled, frame) for frame in frames)


def test_tiles_must_match() -> None:
    frame = np.zeros((4, 4, 3), dtype=np.uint8)
    with pytest.raises(ValueError, match="frames"):
        tile_frames([])
    with pytest.raises(ValueError, match="frames"):
        tile_frames([frame, frame[:3]])
    with pytest.raises(ValueError, match="columns"):
        tile_frames([frame], columns=0)
