"""Frames of a mechanism: one equilibrium, and what is around and ahead of it, as an array of pixels."""

from collections.abc import Sequence
from typing import TypedDict, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray
from PIL import Image

from pcm_gym.mechanism import Mechanism
from pcm_gym.rendering import parts
from pcm_gym.rendering.backdrop import draw_grid, draw_workspace
from pcm_gym.rendering.camera import Bounds, Camera, reach_bounds
from pcm_gym.rendering.canvas import Canvas
from pcm_gym.rendering.ghosts import draw_ghosts, draw_goal, draw_goal_platform, draw_path, draw_target, draw_trail
from pcm_gym.rendering.lettering import make_legend, write_caption, write_label
from pcm_gym.rendering.polylines import Polylines, equilibrium_polylines
from pcm_gym.rendering.style import Colour, Style
from pcm_gym.solving import Equilibrium, Region

_MAGNIFICATION = 3  # pixels drawn per pixel of the frame, each way
_MARGIN = 18.0  # around the mechanism's reach, in pixels of the style: room for an actuator
_STYLE_SIZE = 480.0
_SIZE_MIN = 64
_INSET, _INSET_MIN = 13.0, 6  # of the words from the picture's sides, in pixels of the style and of the frame
_LEGEND_SIZE_MIN = 300  # a smaller frame has no room for the legend
_POINTS = 60

Frame = NDArray[np.uint8]


class Surroundings(TypedDict, total=False):
    """What is drawn behind an equilibrium; `FrameRenderer.draw` tells what each is."""

    trail: ArrayLike | None
    ghosts: Sequence[Equilibrium]
    target: Equilibrium | None
    path: ArrayLike | None


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
    workspace : Region, optional
        Map of the plane behind the mechanism, such as `Atlas.workspace` returns: a tinted area with its border.

    Raises
    ------
    ValueError
        If the size is too small, the bounds are empty or the workspace has three axes.

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
        *,
        workspace: Region | None = None,
    ) -> None:
        width, height = size
        if min(width, height) < _SIZE_MIN:
            raise ValueError(f"size must be at least {_SIZE_MIN} pixels each way, got {size}")
        if bounds is not None and not (bounds[0] < bounds[1] and bounds[2] < bounds[3]):
            raise ValueError(f"bounds must be (x_min, x_max, y_min, y_max), not empty, got {bounds}")
        if workspace is not None and workspace.mask.ndim != 2:
            raise ValueError("workspace must be a region of the plane; for a platform take Atlas.workspace()")
        self._mechanism = mechanism
        self._style = style or Style()
        self._unit = min(width, height) / _STYLE_SIZE
        shown = reach_bounds(mechanism) if bounds is None else bounds
        self._camera = Camera.fit(shown, (int(width), int(height)), _MARGIN * self._unit)
        self._colours = self._style.moment_colours()
        rods = [leg.rod for leg in mechanism.legs]
        self._moment_max = self._style.moment_range * max(rod.bending_stiffness / rod.length for rod in rods)
        self._backdrop = self._draw_backdrop(workspace)
        has_legend = min(width, height) >= _LEGEND_SIZE_MIN
        self._legend = make_legend(self._style, self._unit, self._colours, self._moment_max) if has_legend else None

    @property
    def camera(self) -> Camera:
        """The view of all frames."""
        return self._camera

    def draw(
        self,
        equilibrium: Equilibrium,
        goal: ArrayLike | None = None,
        success_distance: float | None = None,
        *,
        stability_lost: bool = False,
        snapped: bool = False,
        caption: str = "",
        **surroundings: Unpack[Surroundings],
    ) -> Frame:
        """Return the frame of an equilibrium; a load on it is drawn as an arrow.

        Parameters
        ----------
        equilibrium : Equilibrium
            Of this renderer's mechanism. An unstable one is drawn in red, framed and labelled.
        goal : array_like (d,), optional
            Pose to reach, m and rad.
        success_distance : float, optional
            Radius of success around the goal, in m.
        stability_lost : bool
            Whether the motion has just met a fold or bifurcation: red, framed and labelled as such.
        snapped : bool
            Whether the mechanism has just snapped to this equilibrium: labelled as such, calmly. No label if it is
            unstable or `stability_lost`, which have their own.
        caption : str
            Small text at the lower left; cut where there is no room for it.
        trail : array_like (n, 2), optional
            Past positions of the end-effector, oldest first, in m.
        ghosts : sequence of Equilibrium
            Others at the same inputs, faint behind the present one: stable ones solid, unstable ones dashed.
        target : Equilibrium, optional
            The equilibrium to go to, in the goal's colour.
        path : array_like (n, d), optional
            Poses along which the goal moves, m and rad. Closed if it ends where it begins.

        Returns
        -------
        array (height, width, 3) of uint8
            A new array.

        Raises
        ------
        ValueError
            If an equilibrium is of another mechanism, or an array has the wrong shape or is not finite.
        """
        mechanism, style = self._mechanism, self._style
        self._check_mechanism("equilibrium", equilibrium)
        goal_pose = None if goal is None else mechanism.check_pose(goal)
        alarm = "STABILITY LOST" if stability_lost else "" if equilibrium.is_stable else "UNSTABLE"

        canvas = self._canvas(self._backdrop.copy())
        self._draw_surroundings(canvas, **surroundings)
        lines = equilibrium_polylines(equilibrium, _POINTS)
        self._draw_platforms(canvas, lines, goal_pose)
        self._draw_legs(canvas, lines, alarm=bool(alarm))
        if goal_pose is not None:
            draw_goal(canvas, style, goal_pose, success_distance)
        parts.draw_load(canvas, style, mechanism, equilibrium.load, lines.end_effector)
        parts.draw_end_effector(canvas, style, lines)
        image = canvas.image.reduce(_MAGNIFICATION)
        self._write(image, caption, alarm, "SNAPPED" if snapped else "")
        return np.array(image)

    def _check_mechanism(self, name: str, equilibrium: Equilibrium) -> None:
        if equilibrium.mechanism != self._mechanism:
            own, other = self._mechanism.name, equilibrium.mechanism.name
            raise ValueError(f"{name} must be of mechanism {own!r}, got an equilibrium of {other!r}")

    def _draw_backdrop(self, workspace: Region | None) -> Image.Image:
        width, height = self._camera.size
        size = (_MAGNIFICATION * width, _MAGNIFICATION * height)
        canvas = self._canvas(Image.new("RGB", size, self._style.background))
        draw_grid(canvas, self._style)
        if workspace is not None:
            draw_workspace(canvas, self._style, workspace)
        parts.draw_rails(canvas, self._style, self._mechanism)
        return canvas.image

    def _draw_surroundings(
        self,
        canvas: Canvas,
        trail: ArrayLike | None = None,
        ghosts: Sequence[Equilibrium] = (),
        target: Equilibrium | None = None,
        path: ArrayLike | None = None,
    ) -> None:
        for ghost in ghosts:
            self._check_mechanism("ghosts", ghost)
        draw_path(canvas, self._style, self._mechanism, _check_rows("path", path, self._mechanism.dof))
        draw_ghosts(canvas, self._style, ghosts)
        if target is not None:
            self._check_mechanism("target", target)
            draw_target(canvas, self._style, target)
        draw_trail(canvas, self._style, _check_rows("trail", trail, 2))

    def _draw_platforms(self, canvas: Canvas, lines: Polylines, goal: NDArray[np.float64] | None) -> None:
        if self._mechanism.dof != 3:
            return
        if goal is not None:
            draw_goal_platform(canvas, self._style, self._mechanism, goal)
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

    def _write(self, image: Image.Image, caption: str, alarm: str, notice: str) -> None:
        style, unit, (width, height) = self._style, self._unit, self._camera.size
        inset = max(_INSET_MIN, round(_INSET * unit))
        room = width - 2.0 * inset
        if alarm:
            write_label(image, style, unit, alarm, style.alarm, framed=True)
        elif self._legend is not None:
            spare = inset - round(style.legend_rim * unit)
            image.paste(self._legend, (width - self._legend.width - spare, height - self._legend.height - spare))
            room -= self._legend.width
        if notice and not alarm:
            write_label(image, style, unit, notice, style.notice, framed=False)
        if caption:
            write_caption(image, style, unit, caption, inset, room)

    def _canvas(self, image: Image.Image) -> Canvas:
        return Canvas(image, self._camera.magnified(_MAGNIFICATION), _MAGNIFICATION * self._unit)


def _check_rows(name: str, value: ArrayLike | None, size: int) -> NDArray[np.float64]:
    rows = np.empty((0, size)) if value is None else np.array(value, dtype=np.float64)
    if rows.ndim != 2 or rows.shape[1] != size:
        raise ValueError(f"{name} must have shape (n, {size}), got shape {rows.shape}")
    if not np.isfinite(rows).all():
        raise ValueError(f"{name} must be finite")
    return rows
