"""Colours and line widths of the frames."""

from dataclasses import dataclass

import numpy as np

Colour = tuple[int, int, int]
Paint = tuple[int, int, int] | tuple[int, int, int, int]  # the fourth is the opacity, 255 for solid


@dataclass(frozen=True)
class Style:
    """How frames look; sizes are pixels of a frame of 480 x 480 and grow with the frame.

    Blue and orange tell the sign of the bending moment to any eye; red is kept for lost stability alone.
    """

    background: Colour = (250, 250, 248)
    grid: Colour = (236, 237, 238)
    metal: Colour = (84, 92, 104)
    metal_light: Colour = (206, 211, 218)
    ink: Colour = (52, 58, 68)
    platform: Paint = (120, 134, 158, 105)
    goal: Colour = (0, 140, 104)
    trail: Colour = (148, 112, 190)
    ghost: Colour = (158, 166, 180)
    target_band: Colour = (196, 228, 216)
    path: Colour = (122, 190, 168)
    workspace: Paint = (96, 142, 196, 26)
    workspace_border: Colour = (176, 196, 220)
    notice: Colour = (84, 92, 104)
    alarm: Colour = (214, 24, 38)
    moment_negative: tuple[Colour, ...] = ((0, 158, 240), (28, 112, 182))  # outermost first
    moment_zero: Colour = (62, 68, 82)
    moment_positive: tuple[Colour, ...] = ((196, 116, 24), (255, 162, 0))  # outermost last

    rod_width: float = 4.0
    halo_width: float = 7.0
    trail_width: float = 1.6
    outline_width: float = 1.6
    ghost_width: float = 1.4
    ghost_opacity: float = 0.75  # of an unstable one
    ghost_crowd: float = 8.0  # number of unstable ones above which they grow fainter
    ghost_dashes: tuple[float, float] = (5.0, 4.0)  # dash and gap
    target_band_width: float = 7.0
    path_width: float = 1.6
    tick_spacing: float = 34.0
    tick_length: float = 9.0
    border_line_width: float = 1.2
    load_width: float = 2.2
    force_lengths: tuple[float, float] = (18.0, 70.0)  # of the weakest and of the strongest
    moment_radius: float = 20.0
    moment_turns: tuple[float, float] = (1.0, 4.8)  # likewise, rad
    motor_radius: float = 10.0
    clamp_length: float = 15.0
    clamp_width: float = 9.0
    hinge_radius: float = 3.4
    goal_arm: float = 6.5
    border_width: float = 6.0
    font_size: float = 13.0
    label_size: float = 17.0
    legend_width: float = 124.0
    legend_size: float = 11.0
    legend_rim: float = 5.0

    moment_range: float = 3.0  # the moment with full colour, in units of EI / L

    def mix(self, colour: Colour, opacity: float) -> Colour:
        """Return `colour` over the background, solid."""
        red, green, blue = (
            round(opacity * part + (1.0 - opacity) * ground)
            for part, ground in zip(colour, self.background, strict=True)
        )
        return red, green, blue

    def moment_colours(self, count: int = 129) -> list[Colour]:
        """Return `count` colours from the most negative moment to the most positive."""
        anchors = np.array([*self.moment_negative, self.moment_zero, *self.moment_positive], dtype=np.float64)
        at = np.linspace(0.0, len(anchors) - 1.0, count)
        table = np.stack([np.interp(at, np.arange(len(anchors)), column) for column in anchors.T], axis=1)
        return [(int(red), int(green), int(blue)) for red, green, blue in np.rint(table)]
