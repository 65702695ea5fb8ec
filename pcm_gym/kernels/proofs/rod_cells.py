"""Rigorous models of the unit rod over a tree of cells, and what a leg adds to the equations over a cell.

The counterpart of `cells` for proofs: remainders are bounds, from `rod_enclosure`, and all rounding is covered. Cells
are boxes in the polar chart (rho, b), divided in b by a grid that is graded towards tension.
"""

import math
from typing import NamedTuple

import numpy as np

from pcm_gym.arrays import Array, Integers
from pcm_gym.kernels.enumeration.cells import cell_of_leaf, grid_angle, node_offset
from pcm_gym.kernels.numerics.compilation import kernel
from pcm_gym.kernels.numerics.slices import slices
from pcm_gym.kernels.proofs.rod_enclosure import enclose_rod_at, enclose_turnable
from pcm_gym.kernels.proofs.taylor_models import Model, affine, along_s, along_t
from pcm_gym.kernels.statics.closure import AXIS_X, AXIS_Y, BASE_X, BASE_Y, CLAMP_ANGLE, LENGTH, STIFFNESS, TURN

# A cell is a box of loads: centre and half width of rho and of b.
RHO, RHO_HALF, B, B_HALF = range(4)
# Affine model of a quantity over a cell, and how far the quantity may be from the centre.
CENTER, ALONG, ACROSS, REMAINDER, SPREAD = range(5)
# The quantities of the unit rod, of one kind or the other: with its clamp in a given direction force and tip, (x, y)
# each; with a clamp that may be turned p . f, p x f and |p|^2 (see `Turnable`), and zero. Of a leg: what it adds to the
# equations.
ROWS = 4
PLACED, TURNABLE = range(2)
# There are 2^4 bands of rho, each with its own division of b.
BAND_LEVEL = 4
# Covers the rounding errors of what is computed from a model outside of the Taylor arithmetic, and those of the
# mechanism's data, relative to the absolute values that go into it.
SLACK = 1e-14
# Leaves whose models are computed in one call of compiled code.
_LEAVES_AT_ONCE = 1 << 13


class UnitCells(NamedTuple):
    """Rigorous models of the unit rod over a tree of cells, for all mechanisms."""

    levels: int
    rho_max: float
    kind: int
    boxes: Array  # (nodes, 4)
    models: Array  # (nodes, 4, 4): [quantity; centre, along, across, remainder]


@kernel
def _set_affine(model: Model, out: Array) -> None:
    out[CENTER], out[ALONG], out[ACROSS], out[REMAINDER] = affine(model)
    if not math.isfinite(out[REMAINDER] + out[CENTER] + out[ALONG] + out[ACROSS]):
        out[:] = 0.0
        out[REMAINDER] = math.inf


@kernel
def set_unit_models(box: Array, kind: int, out: Array) -> None:
    """Fill the affine models (4, 4) of the unit rod over a box of loads; a remainder is inf where nothing is known."""
    rho, b = along_s(box[RHO], box[RHO_HALF], 0.0), along_t(box[B], box[B_HALF], 0.0)
    if kind == PLACED:
        rod = enclose_rod_at(rho, b)
        _set_affine(rod.force_x, out[0])
        _set_affine(rod.force_y, out[1])
        _set_affine(rod.tip_x, out[2])
        _set_affine(rod.tip_y, out[3])
        return
    own = enclose_turnable(rho, b)
    _set_affine(own.dot, out[0])
    _set_affine(own.cross, out[1])
    _set_affine(own.square, out[2])
    out[3] = 0.0


@kernel
def _set_interval(low: float, high: float, out: Array) -> None:
    """Put centre and half width of an interval into `out` (2,), outward."""
    out[0] = 0.5 * (low + high)
    out[1] = max(high - out[0], out[0] - low) * (1.0 + SLACK)


def make_unit_cells(levels: int, rho_max: float, kind: int) -> UnitCells:
    """Return the unit rod's models, those of one kind, for rho in [0, rho_max] and every b."""
    nodes = node_offset(levels + 1)
    cells = UnitCells(levels, rho_max, kind, np.empty((nodes, 4)), np.empty((nodes, ROWS, 4)))
    grid = np.empty((2**BAND_LEVEL, 2**levels + 1))
    _fill_grid(rho_max, grid)
    for first, last in slices(2 * 4**levels, _LEAVES_AT_ONCE):
        _fill_leaves(cells, grid, first, last)
    for level in range(levels - 1, -1, -1):
        _fill_level(cells, level)
    return cells


@kernel
def _fill_grid(rho_max: float, grid: Array) -> None:
    """Fill in the division of b in each band of rho, (bands, 2^levels + 1): graded for the band's middle.

    So cells are boxes; a node above the bands holds cells that are not aligned, and has only bounds.
    """
    bands, count = grid.shape[0], grid.shape[1] - 1
    for band in range(bands):
        for j in range(count + 1):
            grid[band, j] = grid_angle(rho_max * (band + 0.5) / bands, j / count)
        grid[band, 0], grid[band, count] = 0.0, 3.1415926535897936  # the next number above pi


@kernel
def _fill_leaves(cells: UnitCells, grid: Array, first: int, last: int) -> None:
    """Fill in the boxes and models of the leaves from `first` to `last`."""
    levels, rho_max = cells.levels, cells.rho_max
    count, bands, start = 2**levels, 2**BAND_LEVEL, node_offset(levels)
    for leaf in range(first, last):
        side, i, j = cell_of_leaf(leaf, levels)
        box, band = cells.boxes[start + leaf], i * bands // count
        _set_interval(rho_max * (i / count), rho_max * ((i + 1) / count), box[RHO : RHO + 2])
        _set_interval(grid[band, j], grid[band, j + 1], box[B : B + 2])
        if side == 1:
            box[B] = -box[B]
        set_unit_models(box, cells.kind, cells.models[start + leaf])


@kernel
def _fill_level(cells: UnitCells, level: int) -> None:
    """Fill in the boxes and models of a level's nodes from those below."""
    for node in range(2 * 4**level):
        _set_node(cells, node_offset(level) + node, node_offset(level + 1) + 4 * node, level >= BAND_LEVEL)


@kernel
def _set_node(cells: UnitCells, node: int, first_child: int, is_box: bool) -> None:
    """Enclose the children's boxes and models in the node's."""
    box, children = cells.boxes[node], cells.boxes[first_child : first_child + 4]
    for k in (RHO, B):
        low = high = children[0, k]
        for child in range(4):
            low = min(low, children[child, k] - children[child, k + 1])
            high = max(high, children[child, k] + children[child, k + 1])
        _set_interval(low, high, box[k : k + 2])
    for row in range(ROWS):
        out, models = cells.models[node, row], cells.models[first_child : first_child + 4, row]
        out[:] = 0.0
        if is_box:
            for child in range(4):
                out[ALONG] += 0.25 * models[child, ALONG] * box[RHO_HALF] / children[child, RHO_HALF]
                out[ACROSS] += 0.25 * models[child, ACROSS] * box[B_HALF] / children[child, B_HALF]
        low, high = math.inf, -math.inf
        for child in range(4):
            s = (children[child, RHO] - box[RHO]) / box[RHO_HALF]
            t = (children[child, B] - box[B]) / box[B_HALF]
            gap = models[child, CENTER] - s * out[ALONG] - t * out[ACROSS]
            reach = (
                abs(models[child, ALONG] - out[ALONG] * children[child, RHO_HALF] / box[RHO_HALF])
                + abs(models[child, ACROSS] - out[ACROSS] * children[child, B_HALF] / box[B_HALF])
                + models[child, REMAINDER]
                + SLACK * (abs(models[child, CENTER]) + abs(out[ALONG]) + abs(out[ACROSS]))
            )
            low, high = min(low, gap - reach), max(high, gap + reach)
        if not high - low < math.inf:
            out[:] = 0.0
            out[REMAINDER] = math.inf
            continue
        out[CENTER] = 0.5 * (low + high)
        out[REMAINDER] = max(high - out[CENTER], out[CENTER] - low) + SLACK * abs(out[CENTER])


class Frames(NamedTuple):
    """How the quantities of the unit rods enter the equations, (2, ...) by leg."""

    kinds: Integers  # (2,): which quantities
    sources: Integers  # (2, 4): of each row the first of the two quantities that enter it
    factors: Array  # (2, 4, 2): what they are multiplied by
    sizes: Array  # (2, 4): what the factors' rounding errors are relative to
    offsets: Array  # (2, 4): added to each row
    slacks: Array  # (2, 4): bound on the error of the offset
    relative_slack: Array  # (1,): of what is multiplied


def _new_frames() -> Frames:
    return Frames(
        np.full(2, PLACED),
        np.zeros((2, ROWS), dtype=np.int64),
        np.zeros((2, ROWS, 2)),
        np.zeros((2, ROWS)),
        np.zeros((2, ROWS)),
        np.zeros((2, ROWS)),
        np.array([SLACK]),
    )


@kernel
def _set_pair(frames: Frames, leg: int, source: int, size: float, direction: tuple[float, float]) -> None:
    """Let the two quantities from `source` on enter two rows, those numbered alike, turned and scaled."""
    c, s = direction
    for row in range(source, source + 2):
        frames.sources[leg, row], frames.sizes[leg, row] = source, abs(size)
    frames.factors[leg, source, 0], frames.factors[leg, source, 1] = size * c, -size * s
    frames.factors[leg, source + 1, 0], frames.factors[leg, source + 1, 1] = size * s, size * c


def make_frames(legs: Array, inputs: Array, load: Array) -> Frames:
    """Return the frames for a mechanism of two legs: force of both less the load, tip of the first less the second."""
    frames = _new_frames()
    _fill_frames(legs, inputs, load, frames)
    return frames


@kernel
def _fill_frames(legs: Array, inputs: Array, load: Array, frames: Frames) -> None:
    _set_load(load, frames)
    for leg in range(2):
        turned = legs[leg, TURN] * inputs[leg]
        angle = legs[leg, CLAMP_ANGLE] + turned
        direction = math.cos(angle), math.sin(angle)
        # the angle's own rounding turns everything
        frames.relative_slack[0] += SLACK * (abs(legs[leg, CLAMP_ANGLE]) + abs(turned))
        length, sign = legs[leg, LENGTH], 1.0 - 2.0 * leg
        _set_pair(frames, leg, 0, legs[leg, STIFFNESS] / (length * length), direction)
        _set_pair(frames, leg, 2, sign * length, direction)
        for k, base, axis in ((0, BASE_X, AXIS_X), (1, BASE_Y, AXIS_Y)):
            slide = legs[leg, axis] * inputs[leg]
            frames.offsets[leg, 2 + k] = sign * (legs[leg, base] + slide)
            frames.slacks[leg, 2 + k] = SLACK * (abs(legs[leg, base]) + abs(inputs[leg]))


@kernel
def _set_load(load: Array, frames: Frames) -> None:
    for k in range(2):
        frames.offsets[0, k], frames.slacks[0, k] = -load[k], SLACK * abs(load[k])


def make_inverse_frames(legs: Array, pose: Array, load: Array) -> Frames:
    """Return the frames for two legs at a pose: force of both less the load, and how far each leg misses its hinge."""
    frames = _new_frames()
    _fill_inverse_frames(legs, pose, load, frames)
    return frames


@kernel
def _fill_inverse_frames(legs: Array, pose: Array, load: Array, frames: Frames) -> None:
    """Fill the frames for the inverse problem.

    A slider closes where the tip is on the line that its axis leads through the hinge. A motor closes where |p| is the
    distance of the hinge from it, and turns p, and f with it, into the direction of the hinge.
    """
    _set_load(load, frames)
    for leg in range(2):
        length, row = legs[leg, LENGTH], 2 + leg
        force = legs[leg, STIFFNESS] / (length * length)
        away_x, away_y = pose[0] - legs[leg, BASE_X], pose[1] - legs[leg, BASE_Y]
        rounding = SLACK * (abs(pose[0]) + abs(pose[1]) + abs(legs[leg, BASE_X]) + abs(legs[leg, BASE_Y]))
        frames.sources[leg, 2:] = 2
        if legs[leg, TURN] != 0.0:
            frames.kinds[leg] = TURNABLE
            away = math.hypot(away_x, away_y)
            frames.relative_slack[0] += 2.0 * rounding / away
            _set_pair(frames, leg, 0, force * length / away, (away_x / away, away_y / away))
            frames.sources[leg, 2:] = 2
            frames.factors[leg, row, 0], frames.sizes[leg, row] = 1.0, 1.0
            frames.offsets[leg, row] = -(away / length) * (away / length)
            frames.slacks[leg, row] = (2.0 * away + rounding) * rounding / (length * length) + SLACK * away * away
            continue
        angle = legs[leg, CLAMP_ANGLE]
        c, s, x, y = math.cos(angle), math.sin(angle), legs[leg, AXIS_X], legs[leg, AXIS_Y]
        frames.relative_slack[0] += SLACK * abs(angle)
        _set_pair(frames, leg, 0, force, (c, s))
        frames.factors[leg, row, 0], frames.factors[leg, row, 1] = length * (x * s - y * c), length * (x * c + y * s)
        frames.sizes[leg, row] = length * (abs(x) + abs(y))
        frames.offsets[leg, row] = y * away_x - x * away_y
        frames.slacks[leg, row] = (abs(x) + abs(y)) * rounding


@kernel
def set_contribution(frames: Frames, leg: int, models: Array, out: Array) -> None:
    """Fill `out` (4, 5) with what a leg adds to the equations, from the unit rod's models (4, 4)."""
    for row in range(ROWS):
        source, target = frames.sources[leg, row], out[row]
        x, y = models[source], models[source + 1]
        by_x, by_y = frames.factors[leg, row, 0], frames.factors[leg, row, 1]
        target[CENTER] = frames.offsets[leg, row] + (by_x * x[CENTER] + by_y * y[CENTER])
        target[ALONG] = by_x * x[ALONG] + by_y * y[ALONG]
        target[ACROSS] = by_x * x[ACROSS] + by_y * y[ACROSS]
        size = abs(x[CENTER]) + abs(x[ALONG]) + abs(x[ACROSS]) + abs(y[CENTER]) + abs(y[ALONG]) + abs(y[ACROSS])
        if frames.sizes[leg, row] == 0.0:  # the other leg's equation
            target[REMAINDER] = 0.0
        else:
            remainder = abs(by_x) * x[REMAINDER] + abs(by_y) * y[REMAINDER]
            size += x[REMAINDER] + y[REMAINDER]
            rounding = frames.relative_slack[0] * frames.sizes[leg, row] * size + frames.slacks[leg, row]
            target[REMAINDER] = (remainder + rounding) * (1.0 + SLACK)
        spread = abs(target[ALONG]) + abs(target[ACROSS]) + target[REMAINDER]
        target[SPREAD] = spread * (1.0 + SLACK) + SLACK * abs(target[CENTER])
