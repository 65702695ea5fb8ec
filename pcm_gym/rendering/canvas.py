"""A magnified picture to draw on: places in m of the world, sizes in pixels of the style."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from PIL import Image, ImageDraw

from pcm_gym.arrays import Array
from pcm_gym.rendering.camera import Camera
from pcm_gym.rendering.style import Paint

_DASH_POINTS = 5
_DASH_MIN = 6.0  # shorter dashes and gaps, in pixels of the magnified picture, would blur into a line
_HEAD_LENGTH, _HEAD_ASPECT = 4.5, 0.42  # of an arrow: in widths of its line, and half its breadth by its length
_HALO = 2.2  # width of an arrow's halo by that of its line


@dataclass(frozen=True, eq=False)
class Canvas:
    """Shapes on a picture; a frame is antialiased by drawing it magnified and averaging.

    Attributes
    ----------
    image : PIL.Image.Image
        The magnified picture, RGB.
    camera : Camera
        Its view.
    unit : float
        Its pixels per pixel of the style.
    """

    image: Image.Image
    camera: Camera
    unit: float

    @property
    def pen(self) -> ImageDraw.ImageDraw:
        """What draws on the picture; paints with an opacity blend."""
        return ImageDraw.Draw(self.image, "RGBA")

    def polyline(self, points: ArrayLike, paint: Paint, width: float, *, closed: bool = False) -> None:
        """Draw a line through `points` (n, 2)."""
        corners = _corners(self.camera.pixels(points))
        self.pen.line(corners + corners[:2] if closed else corners, paint, self._width(width))

    def dashes(self, points: ArrayLike, paint: Paint, width: float, pattern: tuple[float, float]) -> None:
        """Draw a dashed line through `points` (n, 2); dash and gap of the `pattern` are in pixels of the style."""
        corners = self.camera.pixels(points)
        lengths = _arc_lengths(corners)
        dash, gap = (max(self.unit * part, _DASH_MIN) for part in pattern)
        starts = np.arange(0.0, lengths[-1], dash + gap)
        places = np.minimum(starts[:, None] + np.linspace(0.0, dash, _DASH_POINTS), lengths[-1])
        pieces = np.stack([np.interp(places, lengths, column) for column in corners.T], axis=-1)
        is_near = np.all((pieces[:, 0] > -dash) & (pieces[:, 0] < np.add(self.image.size, dash)), axis=-1)
        pen, thickness = self.pen, self._width(width)
        for piece in pieces[is_near]:
            pen.line(_corners(piece), paint, thickness)

    def arrow(self, points: ArrayLike, paint: Paint, width: float, halo: Paint) -> None:
        """Draw a line through `points` (n, 2) that ends in a head, set off by a halo from what is below."""
        corners = self.camera.pixels(points)
        tip, head = corners[-1], _HEAD_LENGTH * width * self.unit
        shaft = corners[np.hypot(*(corners - tip).T) > head]
        along = tip - shaft[-1]
        along /= np.hypot(*along)
        across = _HEAD_ASPECT * head * np.array([-along[1], along[0]])
        neck = tip - head * along
        line, triangle = _corners(np.vstack([shaft, neck])), _corners(np.array([tip, neck + across, neck - across]))
        self.pen.line(line, halo, self._width(_HALO * width))
        self.pen.polygon(triangle, halo, halo, self._width(width))
        self.pen.line(line, paint, self._width(width))
        self.pen.polygon(triangle, paint)

    def polygon(self, points: ArrayLike, paint: Paint) -> None:
        """Fill the polygon with the corners `points` (n, 2)."""
        self.pen.polygon(_corners(self.camera.pixels(points)), paint)

    def ribbon(self, points: ArrayLike, paints: Sequence[Paint], width: float) -> None:
        """Draw a smooth line through `points` (n, 2), each of its n - 1 pieces in its own paint, without gaps."""
        middle = self.camera.pixels(points)
        along = np.gradient(middle, axis=0)
        along *= 0.5 * width * self.unit / np.maximum(np.hypot(along[:, :1], along[:, 1:]), 1e-9)
        across = along[:, ::-1] * (-1.0, 1.0)
        left, right = middle + across, middle - across
        pieces = np.rint(np.hstack([left[:-1], left[1:], right[1:], right[:-1]])).astype(int).tolist()
        pen = self.pen
        for piece, paint in zip(pieces, paints, strict=True):
            pen.polygon(piece, paint)

    def disc(self, centre: ArrayLike, radius: float, fill: Paint | None, edge: Paint, edge_width: float) -> None:
        """Draw a disc, or without `fill` a ring, whose radius is in pixels of the style."""
        column, row = self.camera.pixels(centre)
        reach = radius * self.unit
        box = (column - reach, row - reach, column + reach, row + reach)
        self.pen.ellipse(box, fill, edge, self._width(edge_width))

    def box(self, centre: ArrayLike, angle: float, along: tuple[float, float], width: float, paint: Paint) -> None:
        """Fill a rectangle turned by `angle`; `along` is its extent from the centre, in pixels of the style."""
        c, s = math.cos(angle), math.sin(angle)
        half = 0.5 * width
        local = np.array([(along[0], half), (along[1], half), (along[1], -half), (along[0], -half)])
        corners = self.camera.pixels(centre) + self.unit * local @ np.array([[c, -s], [-s, -c]])
        self.pen.polygon(_corners(corners), paint)

    def metres(self, length: float) -> float:
        """Return the world length, in m, of `length` pixels of the style."""
        return length * self.unit / self.camera.scale

    def _width(self, width: float) -> int:
        return max(1, round(width * self.unit))


def _arc_lengths(corners: Array) -> Array:
    steps = np.hypot(*np.diff(corners, axis=0).T)
    return np.concatenate([[0.0], np.cumsum(steps)])


def _corners(pixels: Array) -> list[int]:
    corners: list[int] = np.rint(pixels).astype(int).ravel().tolist()
    return corners
