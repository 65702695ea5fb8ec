"""Figure 14: the stable workspace of the 2RFR, branch by branch."""

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from docs.figures import style
from docs.figures.drawing import draw_equilibrium
from docs.figures.plate import Plate, fixed
from docs.figures.rods import mode_of
from pcm_gym import Atlas, Region, build_atlas, get_mechanism
from pcm_gym.arrays import Array, Integers

_MODES = ((1, 1), (1, 2), (2, 1), (2, 2))
_MODE_COLOURS = ("#9dbfe0", "#f0c48f", "#c3b0dc", "#9ed3bd")
_SHOWN = 3
# Where the mechanism is shown, m.
_POSE = (0.42, 0.2)
_HEADINGS = ("branch", "area over poses (m²)", "area over inputs (turns²)", "most ways to a pose", "modes", "has home")


def make(pitch: float = 0.005, input_cells: int = 160) -> Plate:
    """Make the figure from an atlas with this pitch, m, and so many cells along each input."""
    atlas = build_atlas(get_mechanism("2RFR-paper"), pitch=pitch, input_cells=input_cells, progress=False)
    figure = style.new_figure(8.0, 5.8)
    panels = figure.subplots(2, _SHOWN, sharex=True, sharey=True)
    modes = _modes(atlas)
    counts = [_counts(atlas, branch.number) for branch in atlas.branches]
    most = max(int(own.max()) for own in counts)
    for branch, upper, lower, letters in zip(atlas.branches, *panels, ("ad", "be", "cf"), strict=False):
        _draw_picture(upper, atlas, _least_energy_modes(atlas, branch.number, modes), _MODE_COLOURS)
        _draw_picture(lower, atlas, counts[branch.number].astype(np.float64), style.MODES[:most])
        for found in [own for own in atlas.at_pose(_POSE) if atlas.branch_of(own) == branch.number][:1]:
            draw_equilibrium(upper, found)
        upper.set_title(f"({letters[0]}) branch {branch.number}: {fixed(branch.workspace.area, 2)} m²")
        lower.set_title(f"({letters[1]}) ways to a pose")
    panels[0, 0].set(xlim=(-0.9, 0.9), ylim=(-1.05, 1.05))
    for axes in panels.flat:
        style.label_metres(axes)
    _add_legends(figure, sorted(set(modes)), most)
    rows = []
    for branch in atlas.branches:
        own = sorted({modes[row] for row in np.flatnonzero(atlas.over_poses.branches == branch.number)})
        turns = fixed(branch.input_region.area / (2.0 * math.pi) ** 2)
        ways, home = str(int(counts[branch.number].max())), "yes" if branch.contains_home else ""
        pairs = "; ".join(f"{i}, {j}" for i, j in own)
        rows.append((str(branch.number), _area(branch.workspace), turns, ways, pairs, home))
    note = f"All branches together cover {_area(atlas.workspace())} m²."
    return Plate(figure, _HEADINGS, tuple(rows), note)


def _area(region: Region) -> str:
    return f"{fixed(region.area, 4)} ± {fixed(region.area_error, 4)}"


def _modes(atlas: Atlas) -> list[tuple[int, int]]:
    """Buckling modes of every equilibrium over the poses."""
    rods = atlas.over_poses.rods.astype(np.float64).reshape(-1, 2, 2)
    return [(mode_of(first), mode_of(second)) for first, second in rods]


def _counts(atlas: Atlas, branch: int) -> Integers:
    """Number of a branch's equilibria at each pose of the raster."""
    sheets = atlas.over_poses
    counts = np.bincount(sheets.cells[sheets.branches == branch], minlength=sheets.raster.size)
    return counts.reshape(sheets.raster.shape)


def _least_energy_modes(atlas: Atlas, branch: int, modes: list[tuple[int, int]]) -> Array:
    """Number in `_MODES`, from 1, of the modes of a branch's equilibrium of least energy at each pose; else 0."""
    sheets = atlas.over_poses
    picture = np.zeros(sheets.raster.size)
    rows = np.flatnonzero(sheets.branches == branch)
    for row in rows[::-1]:  # of each pose the first, of least energy, comes last
        picture[sheets.cells[row]] = 1 + _MODES.index(modes[row])
    return picture.reshape(sheets.raster.shape)


def _draw_picture(axes: Axes, atlas: Atlas, picture: Array, colours: tuple[str, ...]) -> None:
    raster = atlas.over_poses.raster
    low = raster.first_node - 0.5 * raster.pitch
    high = low + raster.shape * raster.pitch
    axes.imshow(
        picture.T,
        cmap=ListedColormap(["none", *colours]),
        vmin=-0.5,
        vmax=len(colours) + 0.5,
        origin="lower",
        extent=(low[0], high[0], low[1], high[1]),
        interpolation="nearest",
        zorder=0.6,
    )


def _add_legends(figure: Figure, pairs: list[tuple[int, int]], most: int) -> None:
    modes = [Patch(color=_MODE_COLOURS[_MODES.index(own)], label=f"modes {own[0]}, {own[1]}") for own in pairs]
    ways = [Patch(color=own, label=f"{n + 1} ways") for n, own in enumerate(style.MODES[:most])]
    ways[0].set_label("1 way")
    figure.legend(handles=[*modes, *ways], loc="outside lower center", ncols=len(modes) + most, handlelength=1.0)
