"""A magnified picture to draw on: places in m of the world, sizes in pixels of the style."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from PIL import Image, ImageDraw

from pcm_gym.rendering.camera import Camera
from pcm_gym.rendering.style import Paint

Array = NDArray[np.float64]


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
        """Draw a disc whose radius is in pixels of the style."""
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


def _corners(pixels: Array) -> list[int]:
    corners: list[int] = np.rint(pixels).astype(int).ravel().tolist()
    return corners
