"""Drawing mechanisms: the parts that the figures have in common."""

import math
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Polygon

from docs.figures import style
from pcm_gym import Equilibrium, Mechanism
from pcm_gym.arrays import Array
from pcm_gym.rendering.polylines import equilibrium_polylines

_POINTS = 120
# Sizes of the parts, in mean rod lengths.
_MOTOR_RADIUS, _CLAMP_LENGTH, _CLAMP_WIDTH, _RAIL_END = 0.045, 0.075, 0.04, 0.03


def draw_actuators(axes: Axes, mechanism: Mechanism) -> None:
    """Draw what does not move: motors as discs, rails between their limits."""
    length = mechanism.units.length
    for leg in mechanism.legs:
        base = np.array(leg.actuator.base)
        if leg.actuator.rail_angle is None:
            radius = _MOTOR_RADIUS * length
            axes.add_patch(
                Circle((base[0], base[1]), radius, facecolor=style.METAL_LIGHT, edgecolor="none", zorder=1.5)
            )
            continue
        axis = np.array(leg.actuator.axis)
        stop = _RAIL_END * length * np.array([-axis[1], axis[0]])
        lower, upper = (base + limit * axis for limit in leg.actuator.limits)
        for ends in ((lower, upper), (lower - stop, lower + stop), (upper - stop, upper + stop)):
            axes.plot(*np.transpose(ends), color=style.METAL_LIGHT, linewidth=2.5, zorder=1.5)


def draw_rods(
    axes: Axes, equilibrium: Equilibrium, width: float = 1.8, opacity: float = 1.0, colour: str | None = None
) -> None:
    """Draw the rods alone: blue and solid where stable, red and dashed where not, or solid in a colour."""
    colour, dashes = look(equilibrium.is_stable) if colour is None else (colour, "-")
    for rod in equilibrium.shape(_POINTS):
        axes.plot(*rod.T, color=colour, linestyle=dashes, linewidth=width, alpha=opacity, zorder=3)


def draw_equilibrium(axes: Axes, equilibrium: Equilibrium, colour: str | None = None) -> None:
    """Draw actuators, rods, clamps and hinges; see `draw_rods` for the colour."""
    draw_actuators(axes, equilibrium.mechanism)
    draw_rods(axes, equilibrium, colour=colour)
    lines = equilibrium_polylines(equilibrium, 2)
    for base, angle in zip(lines.clamps, lines.clamp_angles, strict=True):
        _draw_clamp(axes, base, float(angle), equilibrium.mechanism.units.length)
    for hinge in lines.hinges:
        axes.plot(*hinge, marker="o", markersize=4.0, color="white", markeredgecolor=style.INK, zorder=5)


def mark(axes: Axes, x: float, y: float, *, is_stable: bool) -> None:
    """Mark an equilibrium in any plane: a disc where stable, a cross where not."""
    axes.plot(x, y, **_marker(is_stable), zorder=6)


def draw_force(axes: Axes, point: Array, force: Array, scale: float, colour: str) -> None:
    """Draw a force as an arrow from the point at which it acts."""
    axes.annotate(
        "",
        xy=tuple(point + scale * force),
        xytext=tuple(point),
        arrowprops={"arrowstyle": "-|>", "color": colour, "linewidth": 1.0, "shrinkA": 2.5, "shrinkB": 0.0},
        zorder=4,
    )


def look(is_stable: bool) -> tuple[str, str | tuple[float, tuple[float, ...]]]:
    """Colour and line style of stable and of unstable equilibria."""
    return (style.STABLE, "-") if is_stable else (style.UNSTABLE, (0.0, (3.5, 1.4)))


def stability_legend(*, marks: bool = False) -> list[Line2D]:
    """Entries of a legend for both."""
    handles = []
    for is_stable, label in ((True, "stable"), (False, "unstable")):
        colour, dashes = look(is_stable)
        line = _marker(is_stable) if marks else {"color": colour, "linestyle": dashes}
        handles.append(Line2D([], [], label=label, **line))
    return handles


def verdict(equilibrium: Equilibrium) -> str:
    """Stable, or the number of unstable directions."""
    return "stable" if equilibrium.is_stable else f"index {equilibrium.index}"


def _marker(is_stable: bool) -> dict[str, Any]:
    kind = "o" if is_stable else "X"
    return {
        "marker": kind,
        "markersize": 6.0,
        "color": look(is_stable)[0],
        "markeredgecolor": "white",
        "linestyle": "none",
    }


def _draw_clamp(axes: Axes, base: Array, angle: float, length: float) -> None:
    along = np.array([math.cos(angle), math.sin(angle)])
    across = 0.5 * _CLAMP_WIDTH * length * np.array([-along[1], along[0]])
    back, front = base - 0.35 * _CLAMP_LENGTH * length * along, base + 0.65 * _CLAMP_LENGTH * length * along
    corners = np.array([back - across, front - across, front + across, back + across])
    axes.add_patch(Polygon(corners, facecolor=style.METAL, edgecolor="white", linewidth=0.4, zorder=4))
