"""What is not there, or not any more, or should be: other equilibria, the trail, the goal and its path."""

import math
from collections.abc import Sequence

import numpy as np

from pcm_gym.arrays import Array
from pcm_gym.mechanism import Mechanism
from pcm_gym.rendering.canvas import Canvas
from pcm_gym.rendering.polylines import platform_points
from pcm_gym.rendering.style import Style
from pcm_gym.solving import Equilibrium

_POINTS = 40
_MOST_TICKS = 200


def draw_ghosts(canvas: Canvas, style: Style, ghosts: Sequence[Equilibrium]) -> None:
    """Draw other equilibria: stable ones in solid lines with a dot at the end-effector, others dashed with a ring.

    Many unstable ones are fainter than few.
    """
    unstable_count = sum(not ghost.is_stable for ghost in ghosts)
    opacity = min(1.0, math.sqrt(style.ghost_crowd / max(1, unstable_count)))
    unstable_paint = (*style.ghost, round(255 * style.ghost_opacity * opacity))
    for ghost in sorted(ghosts, key=lambda ghost: ghost.is_stable):
        lines = list(ghost.shape(_POINTS))
        if ghost.mechanism.dof == 3:
            outline = platform_points(ghost.mechanism, ghost.pose)
            lines.append(np.vstack([outline, outline[:1]]))
        for line in lines:
            if ghost.is_stable:
                canvas.polyline(line, style.ghost, style.ghost_width)
            else:
                canvas.dashes(line, unstable_paint, style.ghost_width, style.ghost_dashes)
        place, radius = ghost.pose[:2], style.hinge_radius - 1.0
        if ghost.is_stable:
            canvas.disc(place, radius, style.ghost, style.ghost, 1.0)
        else:
            canvas.disc(place, radius, None, unstable_paint, style.ghost_width)


def draw_target(canvas: Canvas, style: Style, target: Equilibrium) -> None:
    """Draw the equilibrium to go to: its rods as a line of the goal's colour in a pale band."""
    rods = target.shape(_POINTS)
    for rod in rods:
        canvas.polyline(rod, style.target_band, style.target_band_width)
    if target.mechanism.dof == 3:
        draw_goal_platform(canvas, style, target.mechanism, target.pose)
    for rod in rods:
        canvas.polyline(rod, style.goal, style.outline_width)
    for tip in rods[:, -1]:
        canvas.disc(tip, style.hinge_radius, style.background, style.goal, style.outline_width)


def draw_path(canvas: Canvas, style: Style, mechanism: Mechanism, path: Array) -> None:
    """Draw the path of a goal, (n, d); for a platform with ticks in the direction of the mark on it.

    The path is closed if it ends where it begins.
    """
    if len(path) < 2:
        return
    places = path[:, :2]
    is_closed = len(path) > 2 and math.dist(places[0], places[-1]) < canvas.metres(0.5)
    canvas.polyline(places[:-1] if is_closed else places, style.path, style.path_width, closed=is_closed)
    if mechanism.dof == 3:
        marks = _evenly(path, canvas.metres(style.tick_spacing), is_closed=is_closed)
        x, y = mechanism.legs[0].attachment
        angles = marks[:, 2] + math.atan2(y, x)
        ends = marks[:, :2] + canvas.metres(style.tick_length) * np.stack([np.cos(angles), np.sin(angles)], axis=1)
        for place, end in zip(marks[:, :2], ends, strict=True):
            canvas.polyline([place, end], style.path, style.path_width)
            canvas.disc(place, style.path_width, style.path, style.path, 0.5)


def draw_goal_platform(canvas: Canvas, style: Style, mechanism: Mechanism, pose: Array) -> None:
    """Draw the ghost of the platform at the goal pose."""
    outline = platform_points(mechanism, pose)
    canvas.polygon(outline, (*style.goal, 26))
    canvas.polyline(outline, style.goal, style.outline_width, closed=True)
    canvas.polyline([pose[:2], outline[0]], style.goal, style.outline_width)


def draw_goal(canvas: Canvas, style: Style, pose: Array, success_distance: float | None) -> None:
    """Draw a cross at the goal and the circle of success around it."""
    place, arm = pose[:2], canvas.metres(style.goal_arm)
    if success_distance is not None:
        radius = success_distance * canvas.camera.scale / canvas.unit
        canvas.disc(place, radius, (*style.goal, 42), style.goal, 1.2)
    for direction in ((arm, arm), (arm, -arm)):
        canvas.polyline([place - direction, place + direction], style.goal, 2.2)


def draw_trail(canvas: Canvas, style: Style, trail: Array) -> None:
    """Draw the way of the end-effector, `trail` (n, 2), oldest first and faintest."""
    if len(trail) < 2:
        return
    opacities = np.linspace(0.12, 0.9, len(trail) - 1)
    canvas.ribbon(trail, [style.mix(style.trail, float(opacity)) for opacity in opacities], style.trail_width)


def _evenly(path: Array, spacing: float, *, is_closed: bool) -> Array:
    """Return poses about `spacing` apart along the path; of a closed one the last is the first and is left out."""
    poses = np.column_stack([path[:, :2], np.unwrap(path[:, 2])])
    lengths = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(poses[:, :2], axis=0).T))])
    count = min(max(1, round(lengths[-1] / spacing)), _MOST_TICKS)
    at = np.linspace(0.0, lengths[-1], count + 1)[: count + (not is_closed)]
    return np.stack([np.interp(at, lengths, column) for column in poses.T], axis=1)
