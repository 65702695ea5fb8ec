"""Figure 6: one rod over the paper's k and psi, and over the load seen from its tip; the tips that it reaches."""

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.patches import Circle, Patch
from PIL import Image, ImageDraw
from scipy.special import ellipkm1

from docs.figures import style
from docs.figures.drawing import look
from docs.figures.plate import Plate, fixed
from docs.figures.rods import held_index
from pcm_gym.arrays import Array
from pcm_gym.kernels.rods.rod import rod

_MODES = (1, 2, 3)
_UNSTABLE, _STABLE = 1, 2
# Half the side of the pictures of the tips, in lengths of the rod.
_REACH = 1.05
# Taut rods have tip angles b down to exp(-rho).
_LEAST_ANGLE = 1e-7


def make(rho_max: float = 9.0, samples: int = 150, pixels: int = 400) -> Plate:
    """Make the figure from so many samples along each coordinate of the rod's load, with pictures of so many pixels."""
    figure = style.new_figure(8.0, 5.7)
    (plane, rectangle, disc), tips = figure.subplots(2, 3)
    draw_feasible(plane)
    _draw_samples(plane, rectangle)
    _draw_disc(disc, rho_max, samples)
    colours, rows = ListedColormap(["none", style.UNSTABLE_FILL, style.STABLE]), []
    for mode, letter, axes in zip(_MODES, "def", tips, strict=True):
        reached = _reached(mode, rho_max, samples, pixels)
        window = (-_REACH, _REACH, -_REACH, _REACH)
        axes.imshow(
            reached, cmap=colours, vmin=0, vmax=2, origin="lower", extent=window, zorder=0.6, interpolation="nearest"
        )
        axes.arrow(0.0, 0.0, 0.2, 0.0, width=0.012, head_width=0.06, color=style.INK, length_includes_head=True)
        axes.set(aspect="equal", xlabel="x / L", ylabel="y / L", title=f"({letter}) tips reached in mode {mode}")
        axes.label_outer()
        unit_disc = math.pi * (0.5 * pixels / _REACH) ** 2
        shares = ((reached > 0).sum() / unit_disc, (reached == _STABLE).sum() / unit_disc)
        rows.append((str(mode), *(fixed(100.0 * float(share), 0) for share in shares)))
    patches = [Patch(color=style.STABLE, label="stable"), Patch(color=style.UNSTABLE_FILL, label="unstable only")]
    tips[2].legend(handles=patches, loc="lower right", handlelength=1.0, borderaxespad=0.0)
    return Plate(figure, ("mode", "tips reached (% of the disc of radius L)", "by a stable shape (%)"), tuple(rows))


def draw_feasible(axes: Axes) -> None:
    """Draw the region |k| >= |cos(psi / 2)| over psi in degrees."""
    psi_deg = np.linspace(0.0, 360.0, 361)
    least = _least_modulus(psi_deg)
    for sign in (1.0, -1.0):
        axes.fill_between(psi_deg, sign * least, sign, color=style.MODES[0], linewidth=0.0)
        axes.plot(psi_deg, sign * least, color=style.METAL, linewidth=0.8)
    axes.set(xlim=(0, 360), ylim=(-1.05, 1.05), xlabel="ψ (°)", ylabel="k", xticks=range(0, 361, 90))


def _least_modulus(psi_deg: Array) -> Array:
    least: Array = np.abs(np.cos(np.radians(0.5 * psi_deg)))
    return least


def _draw_samples(plane: Axes, rectangle: Axes) -> None:
    """Draw the paper's grid of samples, even in psi and in k relative to its range (Eq. 35), in both planes."""
    psi_deg, relative = np.meshgrid(np.arange(15.0, 360.0, 15.0), np.linspace(0.1, 1.0, 10))
    least = _least_modulus(psi_deg)
    for sign in (1.0, -1.0):
        plane.plot(psi_deg, sign * (least + relative * (1.0 - least)), ".", color=style.STABLE, markersize=1.6)
        rectangle.plot(psi_deg, sign * relative, ".", color=style.STABLE, markersize=1.6)
    rectangle.axhspan(-1.0, 1.0, color=style.MODES[0], linewidth=0.0)
    rectangle.set(
        xlim=(0, 360), ylim=(-1.05, 1.05), xlabel="ψ (°)", ylabel="$k_\\mathrm{rel}$", xticks=range(0, 361, 90)
    )
    plane.set_title("(a) feasible k and ψ")
    rectangle.set_title("(b) k relative to its range")


def _draw_disc(axes: Axes, rho_max: float, samples: int) -> None:
    """Draw the modes over the load seen from the tip, in polar coordinates (rho, b)."""
    side = np.linspace(-rho_max, rho_max, 2 * samples)
    x, y = np.meshgrid(side, side)
    points = [rod(math.hypot(u, v) * u, math.hypot(u, v) * v) for u, v in zip(x.flat, y.flat, strict=True)]
    half_periods = np.array([point.half_periods for point in points]).reshape(x.shape)
    index = np.array([point.dead_load_index for point in points]).reshape(x.shape)
    rim = axes.add_patch(Circle((0.0, 0.0), rho_max, facecolor="none", edgecolor=style.METAL, linewidth=0.8))
    colour, dashes = look(is_stable=False)
    for contours in (
        axes.contourf(x, y, half_periods, range(len(style.MODES) + 1), colors=style.MODES),
        axes.contour(x, y, half_periods, range(1, len(style.MODES)), colors=style.METAL, linewidths=0.8),
        axes.contour(x, y, index, [0.5], colors=colour, linewidths=1.2, linestyles=[dashes]),
    ):
        contours.set_clip_path(rim)
    # where the rod is pushed along its tip a mode is a half wave wide
    for mode, place in ((1, 2.0), *((mode, -(mode - 0.5) * math.pi) for mode in (2, 3))):
        axes.annotate(str(mode), (place, 0.0), ha="center", va="center", fontsize=8)
    axes.set(aspect="equal", xlabel="ρ cos b", ylabel="−ρ sin b", title="(c) modes by the load at the tip")


def _reached(mode: int, rho_max: float, samples: int, pixels: int) -> Array:
    """Picture of the tips reached in a mode: the cells of a grid that fits the mode, mapped and painted.

    The grid is even in rho / (2 K), whose integer part makes the mode, and in b, with small b on a log scale.
    """
    halves = np.union1d(np.linspace(0.0, math.pi, samples), np.geomspace(_LEAST_ANGLE, math.pi, samples))
    angles = np.concatenate([-halves[:0:-1], halves[1:]])
    tips = np.empty((angles.size, samples, 2))
    is_stable = np.empty((angles.size, samples), dtype=np.bool_)
    is_beyond = np.empty((angles.size, samples), dtype=np.bool_)
    for i, b in enumerate(angles):
        period = 2.0 * float(ellipkm1(math.sin(0.5 * b) ** 2))
        for j, part in enumerate(np.linspace(mode - 1.0, mode, samples)):
            is_beyond[i, j] = period * part >= rho_max
            load = min(period * part, rho_max) ** 2
            point = rod(load * math.cos(b), -load * math.sin(b))
            tips[i, j] = point.tip_x, point.tip_y
            is_stable[i, j] = held_index(point) == 0
    picture = Image.new("L", (pixels, pixels))
    paint = ImageDraw.Draw(picture)
    corners = (tips + _REACH) * (0.5 * pixels / _REACH)
    for wanted, value in ((False, _UNSTABLE), (True, _STABLE)):
        is_painted = (is_stable[1:, 1:] == wanted) & ~(is_beyond[1:, :-1] & is_beyond[:-1, :-1])
        for i, j in zip(*np.nonzero(is_painted), strict=True):
            cell = corners[i : i + 2, j : j + 2].reshape(4, 2)[[0, 1, 3, 2]]
            paint.polygon([(float(u), float(v)) for u, v in cell], fill=value)
    return np.asarray(picture)
