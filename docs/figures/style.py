"""One look for all figures: the renderer's colours, the fonts, and how a figure becomes a small file."""

import io
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from PIL import Image

from pcm_gym.rendering.style import Colour, Style

_STYLE = Style()
_DOTS_PER_INCH = 200
_PALETTE_SIZE = 255


def _hex(colour: Colour) -> str:
    red, green, blue = (part / 255.0 for part in colour)
    return mpl.colors.to_hex((red, green, blue))


INK = _hex(_STYLE.ink)
METAL = _hex(_STYLE.metal)
METAL_LIGHT = _hex(_STYLE.metal_light)
GRID = _hex(_STYLE.grid)
STABLE = _hex(_STYLE.moment_negative[1])
UNSTABLE = _hex(_STYLE.alarm)
UNSTABLE_FILL = _hex(_STYLE.mix(_STYLE.alarm, 0.3))
ACCENT = _hex(_STYLE.goal)
LEGS = (_hex(_STYLE.moment_positive[0]), _hex((112, 76, 160)))
# Buckling modes 1, 2, 3, ... as fills, from the plainest to the richest shape; any other count as well.
MODES = ("#e3ecf6", "#b9cfe6", "#8aaed3", "#5c8cbe", "#356a9e")

# Energies, from low to high.
ENERGY = mpl.colors.LinearSegmentedColormap.from_list("energy", ["#4f7fb5", "#dfe9f3", "#fbf3e6", "#eec27f"])

_SETTINGS: Any = {
    "font.family": "DejaVu Sans",
    "font.size": 8.5,
    "mathtext.fontset": "dejavusans",
    "text.color": INK,
    "axes.edgecolor": METAL,
    "axes.labelcolor": INK,
    "axes.titlesize": 8.5,
    "axes.titlelocation": "left",
    "axes.titlepad": 5.0,
    "axes.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": GRID,
    "grid.linewidth": 0.6,
    "xtick.color": METAL,
    "ytick.color": METAL,
    "xtick.labelsize": 7.5,
    "ytick.labelsize": 7.5,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "legend.frameon": False,
    "legend.fontsize": 7.5,
    "lines.solid_capstyle": "round",
    "figure.constrained_layout.use": True,
}


def new_figure(width: float, height: float) -> Figure:
    """Figure of this size in inches; eight inches fill the width of a page."""
    with mpl.rc_context(_SETTINGS):
        return Figure(figsize=(width, height))


def settings() -> Any:
    """Context in which figures are drawn."""
    return mpl.rc_context(_SETTINGS)


def label_metres(axes: Axes) -> None:
    """Equal scales and labels for a picture of the plane."""
    axes.set(aspect="equal", xlabel="x (m)", ylabel="y (m)")
    axes.label_outer()


def save_png(figure: Figure, path: Path) -> None:
    """Write the figure with a palette of its own, which makes the file a third as large; equal figures, equal bytes."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=_DOTS_PER_INCH, facecolor="white")
    picture = Image.open(buffer).convert("RGB")
    picture.quantize(_PALETTE_SIZE, dither=Image.Dither.NONE).save(path, optimize=True)
