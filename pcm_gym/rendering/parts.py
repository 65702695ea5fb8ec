"""The parts of a picture, each drawn by one function."""

import math

import numpy as np
from numpy.typing import NDArray

from pcm_gym.mechanism import Leg, Mechanism, Revolute
from pcm_gym.rendering.camera import rail_ends
from pcm_gym.rendering.canvas import Canvas
from pcm_gym.rendering.polylines import Polylines, platform_points
from pcm_gym.rendering.style import Colour, Style

Array = NDArray[np.float64]


def draw_grid(canvas: Canvas, style: Style) -> None:
    """Draw lines 1, 2 or 5 times a power of ten apart, about eight across the picture."""
    x_min, x_max, y_min, y_max = canvas.camera.bounds
    step = _round_step((x_max - x_min) / 8.0)
    for x in step * np.arange(math.ceil(x_min / step), math.floor(x_max / step) + 1):
        canvas.polyline([(x, y_min), (x, y_max)], style.grid, 1.0)
    for y in step * np.arange(math.ceil(y_min / step), math.floor(y_max / step) + 1):
        canvas.polyline([(x_min, y), (x_max, y)], style.grid, 1.0)


def draw_rails(canvas: Canvas, style: Style, mechanism: Mechanism) -> None:
    """Draw the rail of each slider between its limits, with a stop at both."""
    for leg in mechanism.legs:
        if isinstance(leg.actuator, Revolute):
            continue
        ends = rail_ends(leg)
        canvas.polyline(ends, style.metal_light, 4.0)
        for end in ends:
            canvas.box(end, leg.actuator.axis_angle, (-1.5, 1.5), 12.0, style.metal_light)


def draw_actuators(canvas: Canvas, style: Style, mechanism: Mechanism, lines: Polylines) -> None:
    """Draw a motor as a disc and a slider as its carriage."""
    for leg, base in zip(mechanism.legs, lines.clamps, strict=True):
        _draw_body(canvas, style, leg, base)


def draw_rods(canvas: Canvas, style: Style, lines: Polylines, colours: list[list[Colour]]) -> None:
    """Draw the rods in `colours` (legs, points - 1), each above the one before and set off from it."""
    for points, paints in zip(lines.rods, colours, strict=True):
        canvas.polyline(points, style.background, style.halo_width)
        canvas.ribbon(points, paints, style.rod_width)


def draw_clamps(canvas: Canvas, style: Style, lines: Polylines) -> None:
    """Draw each clamp in the direction in which the rod leaves it, with a pin at the clamped point."""
    for base, angle in zip(lines.clamps, lines.clamp_angles.tolist(), strict=True):
        extent = (-0.3 * style.clamp_length, 0.7 * style.clamp_length)
        canvas.box(base, angle, extent, style.clamp_width, style.metal)
        canvas.disc(base, 2.4, style.background, style.metal, 0.5)


def draw_platform(canvas: Canvas, style: Style, lines: Polylines) -> None:
    """Fill the platform, with a mark from its origin towards its first hinge."""
    canvas.polygon(lines.platform, style.platform)
    canvas.polyline(lines.platform, style.metal, style.outline_width, closed=True)
    canvas.polyline([lines.end_effector, lines.platform[0]], style.metal, style.outline_width)


def draw_end_effector(canvas: Canvas, style: Style, lines: Polylines) -> None:
    """Draw the hinges and the end-effector's origin."""
    for hinge in lines.hinges:
        canvas.disc(hinge, style.hinge_radius, style.background, style.ink, style.outline_width)
    canvas.disc(lines.end_effector, style.hinge_radius + 1.2, style.ink, style.background, 1.2)


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


def _draw_body(canvas: Canvas, style: Style, leg: Leg, base: Array) -> None:
    if isinstance(leg.actuator, Revolute):
        canvas.disc(base, style.motor_radius, style.metal_light, style.metal, style.outline_width)
        return
    half = style.motor_radius
    for grown, colour in ((style.outline_width, style.metal), (0.0, style.metal_light)):
        extent = (-half - grown, half + grown)
        canvas.box(base, leg.actuator.axis_angle, extent, 1.3 * half + 2.0 * grown, colour)


def _round_step(wanted: float) -> float:
    power: float = 10.0 ** math.floor(math.log10(wanted))
    return power * next(factor for factor in (1.0, 2.0, 5.0, 10.0) if factor * power >= wanted)
