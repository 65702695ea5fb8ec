"""The parts of a mechanism and its load, each drawn by one function."""

import math

import numpy as np

from pcm_gym.arrays import Array
from pcm_gym.mechanism import Leg, Mechanism
from pcm_gym.rendering.camera import rail_ends
from pcm_gym.rendering.canvas import Canvas
from pcm_gym.rendering.polylines import Polylines
from pcm_gym.rendering.style import Colour, Style

_ARC_POINTS = 40


def draw_rails(canvas: Canvas, style: Style, mechanism: Mechanism) -> None:
    """Draw the rail of each slider between its limits, with a stop at both."""
    for leg in mechanism.legs:
        angle = leg.actuator.rail_angle
        if angle is None:
            continue
        ends = rail_ends(leg)
        canvas.polyline(ends, style.metal_light, 4.0)
        for end in ends:
            canvas.box(end, angle, (-1.5, 1.5), 12.0, style.metal_light)


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


def draw_load(canvas: Canvas, style: Style, mechanism: Mechanism, load: Array, place: Array) -> None:
    """Draw the force as an arrow from the end-effector and the moment as one around it, the stronger the longer.

    Lengths grow as x / (1 + x), where x = 1 is a force EI / L^2 or a moment EI / L: weak loads show, strong ones fit.
    """
    parts = mechanism.units.kernel_from_load(load)
    force = math.hypot(parts[0], parts[1])
    if force > 0.0:
        length = canvas.metres(_between(style.force_lengths, force))
        canvas.arrow([place, place + length / force * parts[:2]], style.ink, style.load_width, style.background)
    moment = float(parts[2]) if mechanism.dof == 3 else 0.0
    if moment != 0.0:
        half_turn = math.copysign(0.5 * _between(style.moment_turns, abs(moment)), moment)
        angles = 0.5 * math.pi + np.linspace(-half_turn, half_turn, _ARC_POINTS)
        radius = canvas.metres(style.moment_radius)
        arc = place + radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)
        canvas.arrow(arc, style.ink, style.load_width, style.background)


def _between(ends: tuple[float, float], size: float) -> float:
    """Return the first of both ends for nothing and nearly the second for very much."""
    return ends[0] + (ends[1] - ends[0]) * size / (1.0 + size)


def _draw_body(canvas: Canvas, style: Style, leg: Leg, base: Array) -> None:
    angle = leg.actuator.rail_angle
    if angle is None:
        canvas.disc(base, style.motor_radius, style.metal_light, style.metal, style.outline_width)
        return
    half = style.motor_radius
    for grown, colour in ((style.outline_width, style.metal), (0.0, style.metal_light)):
        extent = (-half - grown, half + grown)
        canvas.box(base, angle, extent, 1.3 * half + 2.0 * grown, colour)
