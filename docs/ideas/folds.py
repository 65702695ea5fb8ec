"""Folds: the inputs at which a stable equilibrium ends, as curves with cusps."""

import itertools

import numpy as np
from matplotlib.figure import Figure

from docs.figures import style
from docs.ideas import line
from docs.ideas.branches import PLACE
from pcm_gym import forward_singularities
from pcm_gym.arrays import Array

_MARGIN = 0.35  # of the window around a cusp, rad


def draw(grid: int = 8) -> Figure:
    """Draw the limits of stability over the inputs, sought with a grid of so many cells, and one of their cusps."""
    curves = forward_singularities(line.mechanism(), index=0, grid=grid, progress=False)
    figure = style.new_figure(8.0, 3.6)
    whole, near = figure.subplots(1, 2)
    lower, upper = np.degrees([line.mechanism().lower_limits, line.mechanism().upper_limits])
    for curve in curves:
        points = np.degrees(curve.points)
        # an angle with a full turn has no bounds: a curve runs on through its copies
        least, most = (np.floor((lower - points.max(axis=0)) / 360.0), np.ceil((upper - points.min(axis=0)) / 360.0))
        for turns in itertools.product(*(range(int(a), int(b) + 1) for a, b in zip(least, most, strict=True))):
            shown = points + 360.0 * np.array(turns)
            for axes in (whole, near):
                axes.plot(*shown.T, color=style.UNSTABLE, linewidth=0.9)
                axes.plot(*shown[list(curve.cusps)].T, "o", color=style.INK, markersize=3.0)
    whole.plot([line.HELD] * 2, [line.FIRST, line.LAST], color=style.ACCENT, linewidth=1.4)
    whole.set(xlim=(lower[0], upper[0]), ylim=(lower[1], upper[1]), title="where stable equilibria end")
    cusps = np.degrees(np.concatenate([curve.points[list(curve.cusps)] for curve in curves]))
    centre = _nearest(lower + np.remainder(cusps - lower, 360.0), np.array([line.HELD, PLACE]))
    reach = np.degrees(_MARGIN)
    near.set(xlim=(centre[0] - reach, centre[0] + reach), ylim=(centre[1] - reach, centre[1] + reach), title="a cusp")
    for axes in (whole, near):
        axes.set(aspect="equal", xlabel="motor 1 (°)", ylabel="motor 2 (°)")
    return figure


def _nearest(places: Array, place: Array) -> Array:
    found: Array = places[np.linalg.norm(places - place, axis=1).argmin()]
    return found
