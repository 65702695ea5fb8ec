"""Frames of several equilibria are the frames of each."""

import numpy as np
import pytest

from pcm_gym.rendering import FrameRenderer, draw_frames, tile_frames
from pcm_gym.solving import Equilibrium


def test_each_frame_is_drawn_with_its_own_arguments(equilibria: list[Equilibrium]) -> None:
    renderer = FrameRenderer(equilibria[0].mechanism, (100, 80))
    goals, lost = [found.pose for found in equilibria[1:4]], [False, True, False]
    frames = draw_frames(renderer, equilibria[:3], goal=goals, stability_lost=lost)
    assert isinstance(frames, tuple)
    for frame, equilibrium, goal, is_lost in zip(frames, equilibria[:3], goals, lost, strict=True):
        np.testing.assert_array_equal(frame, renderer.draw(equilibrium, goal=goal, stability_lost=is_lost))


def test_no_equilibria_have_no_frames(equilibria: list[Equilibrium]) -> None:
    assert draw_frames(FrameRenderer(equilibria[0].mechanism), []) == ()


def test_a_value_for_each_equilibrium_is_asked_for(equilibria: list[Equilibrium]) -> None:
    renderer = FrameRenderer(equilibria[0].mechanism)
    with pytest.raises(ValueError, match="stability_lost"):
        draw_frames(renderer, equilibria[:2], stability_lost=[True])


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
