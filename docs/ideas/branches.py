"""Branches: every equilibrium at every place of a line of inputs."""

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from docs.figures import style
from docs.figures.drawing import draw_equilibrium
from docs.ideas import line

# Where the shapes at the left are shown, degrees.
PLACE = 150.0
_DOT = 2.0
# By index.
_COLOURS, _WORDS = (style.STABLE, style.UNSTABLE, style.METAL_LIGHT), ("stable", "index 1", "index 2 and more")


def draw(places: int = 261) -> Figure:
    """Draw all shapes at one place, and the heights of all end-effectors at so many places of the line."""
    figure = style.new_figure(8.0, 3.4)
    shapes, heights = figure.subplots(1, 2, width_ratios=(1.0, 1.7))
    for own in line.all_at(PLACE):
        draw_equilibrium(shapes, own)
    style.label_metres(shapes)
    shapes.set_title(f"all equilibria, motor 2 at {PLACE:.0f}°")
    for degrees in np.linspace(line.FIRST, line.LAST, places).tolist():
        for own in line.all_at(degrees):
            rank = min(own.index, 2)
            heights.plot(degrees, own.pose[1], ".", color=_COLOURS[rank], markersize=_DOT, zorder=4 - rank)
    heights.axvline(PLACE, color=style.ACCENT, linewidth=0.8)
    heights.set(xlabel="motor 2 (°)", ylabel="height of the end-effector (m)", ylim=(-0.9, 1.2))
    heights.set_title("along a line of inputs")
    keys = [_key(*each) for each in zip(_COLOURS, _WORDS, strict=True)]
    heights.legend(handles=keys, loc="upper left", ncols=3)
    return figure


def _key(colour: str, label: str) -> Line2D:
    return Line2D([], [], marker="o", markersize=3.0, color=colour, linestyle="none", label=label)
