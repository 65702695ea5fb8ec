"""Figures 8 and 9: all solutions of forward and inverse problems, and those with both rods in mode 1."""

from collections.abc import Callable
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from docs.figures import style
from docs.figures.drawing import draw_actuators, draw_equilibrium, draw_rods, mark, stability_legend, verdict
from docs.figures.plate import Plate, fixed, listed
from pcm_gym import Equilibrium, EquilibriumSet, get_mechanism, solve_forward, solve_inverse

# Inputs of the forward problems: rad for 2RFR, m for 2PFR; the pose of the inverse one, m.
_FORWARD = {"2RFR": tuple(np.radians([35.0, 125.0])), "2PFR": (0.2, -0.2)}
_INVERSE = {"2PFR": (0.3, 0.1)}
_FIRST_MODES = (1, 1)
_HEADINGS = ("energy (J)", "modes", "index", "eigenvalues of K (N/m)")


def make_forward(rho_max: float = 9.0) -> Plate:
    """Make figure 8: poses at given inputs, of two mechanisms."""
    sets = {
        name: solve_forward(get_mechanism(f"{name}-paper"), inputs, rho_max=rho_max)
        for name, inputs in _FORWARD.items()
    }
    figure = style.new_figure(8.0, 5.2)
    panels = _draw(figure, sets)
    for line, found in zip(panels, sets.values(), strict=True):
        for own in found:
            mark(line[0], own.pose[0], own.pose[1], is_stable=own.is_stable)
    panels[0, 0].set(xlim=(-0.78, 0.78), ylim=(-0.72, 1.05))
    panels[1, 0].set_ylim(-0.62, 0.9)
    return _plate(figure, sets, "tip x, y (m)", lambda found: found.pose)


def make_inverse(rho_max: float = 9.0) -> Plate:
    """Make figure 9: sliders' places at a given pose."""
    sets = {
        name: solve_inverse(get_mechanism(f"{name}-paper"), pose, rho_max=rho_max) for name, pose in _INVERSE.items()
    }
    figure = style.new_figure(8.0, 3.7)
    panels = _draw(figure, sets)
    for line, found in zip(panels, sets.values(), strict=True):
        for own in found:
            for x, y in own.shape(2)[:, 0]:
                mark(line[0], x, y, is_stable=own.is_stable)
    panels[0, 0].set(xlim=(-0.46, 0.66), ylim=(-1.02, 0.88))
    return _plate(figure, sets, "sliders (m)", lambda found: found.inputs)


def _draw(figure: Figure, sets: dict[str, EquilibriumSet]) -> NDArray[Any]:
    """Draw a row for each set: all of them at the left, then the three with both rods in mode 1."""
    panels = figure.subplots(len(sets), 4, squeeze=False, sharex=True, sharey="row")
    for line, (name, found) in zip(panels, sets.items(), strict=True):
        _draw_all(line[0], found, f"{name}: all {len(found)}, {len(found.stable)} stable")
        for axes, own in zip(line[1:], [own for own in found if own.modes == _FIRST_MODES], strict=False):
            draw_equilibrium(axes, own)
            axes.set_title(f"{fixed(own.energy)} J, {verdict(own)}")
        for axes in line:
            style.label_metres(axes)
    figure.legend(handles=stability_legend(marks=True), loc="outside lower center", ncols=2)
    return panels


def _draw_all(axes: Axes, found: EquilibriumSet, title: str) -> None:
    draw_actuators(axes, found[0].mechanism)
    for own in sorted(found, key=lambda own: own.is_stable):
        draw_rods(axes, own, width=1.0 if own.is_stable else 0.6, opacity=0.9 if own.is_stable else 0.4)
    axes.set_title(title)


def _plate(
    figure: Figure,
    sets: dict[str, EquilibriumSet],
    heading: str,
    coordinates: Callable[[Equilibrium], NDArray[np.float64]],
) -> Plate:
    rows = [
        (
            name,
            fixed(own.energy),
            ", ".join(map(str, own.modes)),
            str(own.index),
            listed(np.linalg.eigvalsh(own.stiffness), 2),
            listed(coordinates(own)),
        )
        for name, found in sets.items()
        for own in found
    ]
    return Plate(figure, ("mechanism", *_HEADINGS, heading), tuple(rows))
