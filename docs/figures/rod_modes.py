"""Figure 3: the shapes of one rod in its buckling modes, for given k and psi."""

import math

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from docs.figures import style
from docs.figures.drawing import draw_force, look, stability_legend
from docs.figures.plate import Plate, fixed
from docs.figures.rod_parameters import draw_feasible
from docs.figures.rods import force_of, index_under_dead_load, load_from_parameters, rho_of, shape_of

# Points of the feasible region: name, k, psi in degrees.
_CHOICES = (("A", 0.75, 140.0), ("B", -0.75, 205.0))
_ARROW = 0.16  # lengths of the rod
_HEADINGS = ("choice", "k", "ψ (°)", "mode", "ρ = L √(R / EI)", "index, tip free")


def make(modes: int = 3) -> Plate:
    """Make the figure with this number of modes."""
    figure = style.new_figure(8.0, 3.2)
    plane, *shapes = figure.subplots(1, 3)
    draw_feasible(plane)
    plane.set_title("(a) feasible k and ψ, two choices")
    rows = []
    for axes, letter, (name, modulus, psi_deg) in zip(shapes, "bc", _CHOICES, strict=True):
        plane.plot(psi_deg, modulus, "o", color=style.INK, markersize=5)
        plane.annotate(name, (psi_deg, modulus), xytext=(6, -3), textcoords="offset points", fontweight="bold")
        axes.set_title(f"({letter}) {name}: k = {modulus:g}, ψ = {psi_deg:g}°".replace("-", "−"))
        axes.plot([0.0, 0.0], [-0.06, 0.06], color=style.METAL, linewidth=4.0, solid_capstyle="butt", zorder=4)
        for mode in range(1, modes + 1):
            load = load_from_parameters(modulus, math.radians(psi_deg), mode)
            index = index_under_dead_load(load)
            _draw_rod(axes, load, mode, is_stable=index == 0)
            rows.append((name, fixed(modulus, 2), fixed(psi_deg, 0), str(mode), fixed(rho_of(load)), str(index)))
        axes.set(aspect="equal", xlabel="x / L", ylabel="y / L", xlim=(-0.15, 0.95))
    shapes[0].set_ylim(-0.26, 0.84)
    shapes[1].set_ylim(-0.88, 0.22)
    shapes[1].legend(handles=stability_legend(), loc="lower left")
    return Plate(figure, _HEADINGS, tuple(rows))


def _draw_rod(axes: Axes, load: NDArray[np.float64], mode: int, *, is_stable: bool) -> None:
    colour, dashes = look(is_stable)
    shape, force = shape_of(load), force_of(load)
    axes.plot(*shape.T, color=colour, linestyle=dashes, linewidth=1.8, zorder=3)
    direction = force / np.hypot(*force)
    draw_force(axes, shape[-1], direction, _ARROW, style.INK)
    axes.plot(*shape[-1], "o", markersize=4.0, color="white", markeredgecolor=style.INK, zorder=5)
    away = tuple(-8.0 * direction)
    axes.annotate(str(mode), shape[-1], xytext=away, textcoords="offset points", ha="center", va="center", fontsize=8)
