"""Frames of a mechanism: one equilibrium, its goal and its trail as an array of pixels."""

from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray
from PIL import Image, ImageDraw, ImageFont

from pcm_gym.mechanism import Mechanism
from pcm_gym.rendering import parts
from pcm_gym.rendering.camera import Bounds, Camera, reach_bounds
from pcm_gym.rendering.canvas import Canvas
from pcm_gym.rendering.polylines import Polylines, equilibrium_polylines
from pcm_gym.rendering.style import Colour, Style
from pcm_gym.solving import Equilibrium

_MAGNIFICATION = 3  # pixels drawn per pixel of the frame, each way
_MARGIN = 18.0  # around the mechanism's reach, in pixels of the style: room for an actuator
_STYLE_SIZE = 480.0
_SIZE_MIN = 64
_LEGEND_SIZE_MIN = 300  # a smaller frame has no room for the legend
_POINTS = 60

Frame = NDArray[np.uint8]


class FrameRenderer:
    """Draws equilibria of one mechanism, all with the same fixed camera.

    Parameters
    ----------
    mechanism : Mechanism
    size : (width, height)
        Of the frames, in pixels; at least 64 each.
    bounds : (x_min, x_max, y_min, y_max), optional
        What the camera shows, in m; by default all that the mechanism can reach within its limits.
    style : Style, optional

    Raises
    ------
    ValueError
        If the size is too small or the bounds are empty.

    Notes
    -----
    A frame of 480 x 480 takes a few milliseconds. Equal arguments give equal frames.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        size: tuple[int, int] = (480, 480),
        bounds: Bounds | None = None,
        style: Style | None = None,
    ) -> None:
        width, height = size
        if min(width, height) < _SIZE_MIN:
            raise ValueError(f"size must be at least {_SIZE_MIN} pixels each way, got {size}")
        if bounds is not None and not (bounds[0] < bounds[1] and bounds[2] < bounds[3]):
            raise ValueError(f"bounds must be (x_min, x_max, y_min, y_max), not empty, got {bounds}")
        self._mechanism = mechanism
        self._style = style or Style()
        self._unit = min(width, height) / _STYLE_SIZE
        shown = reach_bounds(mechanism) if bounds is None else bounds
        self._camera = Camera.fit(shown, (int(width), int(height)), _MARGIN * self._unit)
        self._colours = self._style.moment_colours()
        rods = [leg.rod for leg in mechanism.legs]
        self._moment_max = self._style.moment_range * max(rod.bending_stiffness / rod.length for rod in rods)
        self._backdrop = self._draw_backdrop()
        self._legend = self._draw_legend() if min(width, height) >= _LEGEND_SIZE_MIN else None

    @property
    def camera(self) -> Camera:
        """The view of all frames."""
        return self._camera

    def draw(
        self,
        equilibrium: Equilibrium,
        goal: ArrayLike | None = None,
        success_distance: float | None = None,
        trail: ArrayLike | None = None,
        stability_lost: bool = False,
        caption: str = "",
    ) -> Frame:
        """Return the frame of an equilibrium.

        Parameters
        ----------
        equilibrium : Equilibrium
            Of this renderer's mechanism. An unstable one is drawn in red, framed and labelled.
        goal : array_like (d,), optional
            Pose to reach, m and rad.
        success_distance : float, optional
            Radius of success around the goal, in m.
        trail : array_like (n, 2), optional
            Past positions of the end-effector, oldest first, in m.
        stability_lost : bool
            Whether the motion has just met a fold or bifurcation: red, framed and labelled as such.
        caption : str
            Small text at the lower left.

        Returns
        -------
        array (height, width, 3) of uint8
            A new array.

        Raises
        ------
        ValueError
            If the equilibrium is of another mechanism, or an array has the wrong shape or is not finite.
        """
        mechanism = self._mechanism
        if equilibrium.mechanism != mechanism:
            raise ValueError(f"equilibrium must be of {mechanism.name!r}, got one of {equilibrium.mechanism.name!r}")
        goal_pose = None if goal is None else mechanism.check_pose(goal)
        trail_points = np.empty((0, 2)) if trail is None else _check_trail(trail)
        label = "STABILITY LOST" if stability_lost else "" if equilibrium.is_stable else "UNSTABLE"

        canvas = self._canvas(self._backdrop.copy())
        parts.draw_trail(canvas, self._style, trail_points)
        lines = equilibrium_polylines(equilibrium, _POINTS)
        self._draw_platforms(canvas, lines, goal_pose)
        self._draw_legs(canvas, lines, alarm=bool(label))
        if goal_pose is not None:
            parts.draw_goal(canvas, self._style, goal_pose, success_distance)
        parts.draw_end_effector(canvas, self._style, lines)
        image = canvas.image.reduce(_MAGNIFICATION)
        self._write(image, caption, label)
        return np.array(image)

    def _draw_backdrop(self) -> Image.Image:
        width, height = self._camera.size
        size = (_MAGNIFICATION * width, _MAGNIFICATION * height)
        canvas = self._canvas(Image.new("RGB", size, self._style.background))
        parts.draw_grid(canvas, self._style)
        parts.draw_rails(canvas, self._style, self._mechanism)
        return canvas.image

    def _draw_legend(self) -> Image.Image:
        """Return the colour bar of the bending moment, with its ends."""
        style, unit = self._style, self._unit
        width, bar = round(style.legend_width * unit), max(3, round(5.0 * unit))
        font = _font(style.legend_size * unit)
        colours = np.array(self._colours, dtype=np.uint8)
        entries = np.linspace(0, len(colours) - 1, width).round().astype(int)
        legend = Image.new("RGB", (width, bar + round(1.5 * style.legend_size * unit)), style.background)
        legend.paste(Image.fromarray(np.tile(colours[entries], (bar, 1, 1))), (0, legend.height - bar))
        pen, row = ImageDraw.Draw(legend), legend.height - bar - round(4.0 * unit)
        ends = f"{self._moment_max:.2g}"
        pen.text((0, row), f"-{ends}", style.ink, font, anchor="ls")
        pen.text((width // 2, row), "moment", style.ink, font, anchor="ms")
        pen.text((width, row), ends, style.ink, font, anchor="rs")
        return legend

    def _draw_platforms(self, canvas: Canvas, lines: Polylines, goal: NDArray[np.float64] | None) -> None:
        if self._mechanism.dof != 3:
            return
        if goal is not None:
            parts.draw_goal_platform(canvas, self._style, self._mechanism, goal)
        parts.draw_platform(canvas, self._style, lines)

    def _draw_legs(self, canvas: Canvas, lines: Polylines, *, alarm: bool) -> None:
        style = self._style
        parts.draw_actuators(canvas, style, self._mechanism, lines)
        parts.draw_rods(canvas, style, lines, self._rod_colours(lines.moments, alarm=alarm))
        parts.draw_clamps(canvas, style, lines)

    def _rod_colours(self, moments: NDArray[np.float64], *, alarm: bool) -> list[list[Colour]]:
        if alarm:
            return [[self._style.alarm] * (moments.shape[1] - 1)] * moments.shape[0]
        part = 0.5 * (moments[:, 1:] + moments[:, :-1]) / self._moment_max
        entries = np.rint((np.clip(part, -1.0, 1.0) + 1.0) * 0.5 * (len(self._colours) - 1)).astype(int)
        return [[self._colours[entry] for entry in row] for row in entries.tolist()]

    def _write(self, image: Image.Image, caption: str, label: str) -> None:
        style, (width, height) = self._style, self._camera.size
        pen, inset = ImageDraw.Draw(image), round(13.0 * self._unit)
        if label:
            border = max(2, round(style.border_width * self._unit))
            pen.rectangle((0, 0, width - 1, height - 1), None, style.alarm, border)
            font = _font(style.label_size * self._unit)
            place = (0.5 * width, border + 0.75 * style.label_size * self._unit)
            left, _, right, bottom = pen.textbbox(place, label, font, anchor="mm")
            pad = 0.5 * style.label_size * self._unit
            box = (left - pad, -pad, right + pad, bottom + 0.6 * pad)
            pen.rounded_rectangle(box, 0.6 * pad, style.alarm)
            pen.text(place, label, (255, 255, 255), font, anchor="mm")
        elif self._legend is not None:
            corner = (width - self._legend.width - inset, height - self._legend.height - inset)
            image.paste(self._legend, corner)
        if caption:
            place = (inset, height - inset)
            pen.text(place, caption, style.ink, _font(style.font_size * self._unit), anchor="ls")

    def _canvas(self, image: Image.Image) -> Canvas:
        return Canvas(image, self._camera.magnified(_MAGNIFICATION), _MAGNIFICATION * self._unit)


@lru_cache(maxsize=8)
def _font(size: float) -> ImageFont.ImageFont | ImageFont.FreeTypeFont:
    return ImageFont.load_default(max(8.0, size))


def _check_trail(trail: ArrayLike) -> NDArray[np.float64]:
    points = np.array(trail, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != 2:
        raise ValueError(f"trail must have shape (n, 2), got shape {points.shape}")
    if not np.isfinite(points).all():
        raise ValueError("trail must be finite")
    return points
