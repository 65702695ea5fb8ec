"""The picture of a mechanism's home sheets: shapes, inputs and poses."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure

from benchmarks.evidence import HomeSheets
from docs.figures import style
from docs.figures.drawing import draw_equilibrium, draw_rods

# Nodes that are drawn faintly.
_SHAPES = 24


def draw(sheets: HomeSheets) -> Figure:
    """Draw home with other equilibria of the home sheets, how often inputs are covered, and the stress over poses."""
    figure = style.new_figure(8.0, 3.1)
    shapes, inputs, poses = figure.subplots(1, 3)
    _draw_shapes(shapes, sheets)
    _draw_inputs(inputs, sheets)
    _draw_poses(figure, poses, sheets)
    return figure


def _draw_shapes(axes: Axes, sheets: HomeSheets) -> None:
    roadmap = sheets.roadmap
    for node in np.random.default_rng(0).integers(len(roadmap), size=_SHAPES).tolist():
        draw_rods(axes, roadmap.equilibrium(node), width=0.6, opacity=0.3)
    draw_equilibrium(axes, sheets.home)
    if roadmap.mechanism.dof == 3:
        hinges = sheets.home.shape(2)[:, -1]
        axes.plot(*np.vstack([hinges, hinges[:1]]).T, color=style.INK, linewidth=1.0, zorder=2)
    axes.set_title("home, and others")
    axes.set(aspect="equal", xlabel="x (m)", ylabel="y (m)")


def _draw_inputs(axes: Axes, sheets: HomeSheets) -> None:
    raster = sheets.roadmap.raster
    layers, title = sheets.layers.reshape(raster.shape), "sheets over the inputs"
    if layers.ndim == 3:
        layers, title = layers[:, :, raster.shape[2] // 2], "sheets, input 3 in the middle"
    low, high = (
        raster.first_node - 0.5 * raster.pitch,
        raster.first_node + (np.array(raster.shape) - 0.5) * raster.pitch,
    )
    most = max(int(layers.max()), 1)
    colours = ListedColormap(["white", *style.MODES[:most]])
    extent = (low[0], high[0], low[1], high[1])
    image = axes.imshow(
        layers.T, cmap=colours, vmin=-0.5, vmax=most + 0.5, origin="lower", extent=extent, aspect="auto"
    )
    axes.figure.colorbar(image, ax=axes, ticks=range(most + 1))
    unit = sheets.roadmap.mechanism.legs[0].actuator.unit
    axes.plot(*sheets.home.inputs[:2], marker="o", markersize=4.0, color=style.ACCENT)
    axes.set(title=title, xlabel=f"input 1 ({unit})", ylabel=f"input 2 ({unit})")


def _draw_poses(figure: Figure, axes: Axes, sheets: HomeSheets) -> None:
    order = np.argsort(sheets.strength.stress)
    x, y = sheets.poses[order, :2].T
    dots = axes.scatter(x, y, c=sheets.strength.stress[order], s=0.6, cmap="viridis", vmin=0.0, linewidths=0.0)
    figure.colorbar(dots, ax=axes)
    axes.set_title("stress over yield stress")
    axes.set(aspect="equal", xlabel="x (m)", ylabel="y (m)")
