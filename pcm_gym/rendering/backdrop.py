"""What lies behind every frame and never changes: the grid and the map of the workspace."""

import math

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from pcm_gym.rendering.canvas import Canvas
from pcm_gym.rendering.style import Style
from pcm_gym.solving import Region


def draw_grid(canvas: Canvas, style: Style) -> None:
    """Draw lines 1, 2 or 5 times a power of ten apart, about eight across the picture."""
    x_min, x_max, y_min, y_max = canvas.camera.bounds
    step = _round_step((x_max - x_min) / 8.0)
    for x in step * np.arange(math.ceil(x_min / step), math.floor(x_max / step) + 1):
        canvas.polyline([(x, y_min), (x, y_max)], style.grid, 1.0)
    for y in step * np.arange(math.ceil(y_min / step), math.floor(y_max / step) + 1):
        canvas.polyline([(x_min, y), (x_max, y)], style.grid, 1.0)


def draw_workspace(canvas: Canvas, style: Style, workspace: Region) -> None:
    """Tint the pixels whose centres lie in the region, and draw its border."""
    *colour, opacity = style.workspace
    canvas.image.paste(tuple(colour), mask=Image.fromarray(np.uint8(opacity) * _inside(canvas, workspace)))
    for border in workspace.boundaries:
        canvas.polyline(border, style.workspace_border, style.border_line_width)


def _inside(canvas: Canvas, region: Region) -> NDArray[np.bool_]:
    """Return which pixels (height, width) have their centres in cells of the region."""
    raster, (width, height) = region.raster, canvas.image.size
    diagonal = np.arange(max(width, height)) + 0.5
    points = canvas.camera.points(np.stack([diagonal, diagonal], axis=1))
    # the raster's axes are the picture's: a pixel's cell follows from its column and its row; beyond them is a rim
    places = np.rint((points - raster.first_node) / raster.pitch) + 1.0
    cells = np.clip(places, 0.0, np.array(raster.shape) + 1.0).astype(np.int64)
    inside: NDArray[np.bool_] = np.pad(region.mask, 1)[np.ix_(cells[:width, 0], cells[:height, 1])].T
    return inside


def _round_step(wanted: float) -> float:
    power: float = 10.0 ** math.floor(math.log10(wanted))
    return power * next(factor for factor in (1.0, 2.0, 5.0, 10.0) if factor * power >= wanted)
