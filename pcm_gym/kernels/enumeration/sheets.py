"""The unit rod over the plane of its tip: patches on which the tip force is an affine function of the tip.

The map from a rod's equilibria to its tip covers the plane in sheets that meet in folds. The plane is cut into
overlapping squares around the nodes of a lattice; over each square every sheet is one patch or a few. The table is made
once, in the clamp's frame, and serves every rod by scaling and rotation.

At a fold the force changes like the square root of the distance, in one direction: so the error of a patch is given as
a segment of forces and a small radius about it.
"""

import math
from typing import NamedTuple

import numpy as np

from pcm_gym.arrays import Array, Integers, Mask
from pcm_gym.kernels.enumeration.cells import unit_rod_values
from pcm_gym.kernels.numerics.compilation import kernel
from pcm_gym.kernels.numerics.slices import slices

# Columns of a patch. The box of tips that it covers, seen from its node; affine functions of the tip from its node (its
# value and slopes along x and y): the force, and the place on the unit rod's grid; the error of the force, a segment
# (from -ERROR to ERROR) and the radius about it; the side of the grid; the block of the grid that holds the patch.
X_LOW, X_HIGH, Y_LOW, Y_HIGH = range(4)
FORCE_X, FORCE_Y, RHO_CELL, GRADE_CELL = 4, 7, 10, 13
ERROR_X, ERROR_Y, ERROR_RADIUS, SIDE = range(16, 20)
RHO_LOW, RHO_HIGH, GRADE_LOW, GRADE_HIGH = range(20, 24)
PATCH_COLUMNS = 24

# Columns of a grid node: tip, force, and its place along rho and grade. A fit explains the last four by the tip.
_TIP_X, _TIP_Y, _FORCE_X, _FORCE_Y, _ROW, _COLUMN = range(6)
_EXPLAINED, _NODE_COLUMNS = 2, 6

# Distance between the nodes and half the width of the squares, in rod lengths, at refinement 0.
_SPACING, _HALF_WIDTH = 0.04, 0.06
# The grid has 2^n cells along rho, at least this many per unit of it.
_CELLS_PER_RHO = 28.0
# A patch is halved until the radius of its error is below the first, in EI / L^2, and the segment below the second or
# below what the force changes across the square; or until it is a single cell of the grid.
_LARGEST_RADIUS, _LARGEST_SEGMENT = 2.0, 2.0
# Errors are measured at the grid's nodes and enlarged by this for what is between them.
_ERROR_FACTOR = 1.15
# A cell's tips are within the box of its corners, enlarged by this part of its size.
_BOX_MARGIN = 0.05
# Slopes across patches narrower than this part of the square are held down.
_LEAST_WIDTH = 0.02
# Cells of the grid in one call of compiled code.
_CELLS_AT_ONCE = 1 << 16


class Sheets(NamedTuple):
    """The patches of the unit rod's sheets, lattice node by lattice node."""

    rho_max: float
    size: int  # the grid has this many cells along rho and along the grade, on either side of b = 0
    spacing: float  # between the lattice's nodes
    half_width: float  # of the square around a node
    extent: int  # the nodes are at spacing times -extent ... extent, both ways
    offsets: Integers  # (nodes + 1,): where the patches of each node begin
    patches: Array  # (m, 24)


class _Grid(NamedTuple):
    """The unit rod's grid, flat."""

    size: int
    nodes: Array  # (2 (size + 1)^2, 6)
    first_node: Integers  # (cells,): the cell's others are 1, size + 1 and size + 2 further
    boxes: Array  # (cells, 4): of its tips
    is_turned: Mask  # (cells,): whether the map to the tip turns the cell over; that changes across folds


class _Lattice(NamedTuple):
    """The lattice of the tip's plane."""

    spacing: float
    half_width: float
    extent: int


class _Squares(NamedTuple):
    """The grid's cells by the square that they reach into, one square after the other."""

    places: Integers  # (squares + 1,): where the cells of each square begin
    cells: Integers  # (places[-1],)
    place_of: Integers  # (cells of the grid,): where a cell is among those of the square that is looked at


def make_sheets(rho_max: float, refinement: int) -> Sheets:
    """Return the patches of all equilibria of the unit rod with rho up to `rho_max`."""
    scale = 0.5**refinement
    spacing, half_width = scale * _SPACING, scale * _HALF_WIDTH
    lattice = _Lattice(spacing, half_width, math.ceil((1.0 + half_width) / spacing))
    grid = _new_grid(max(5, math.ceil(math.log2(_CELLS_PER_RHO * rho_max / scale))), rho_max)
    squares = _cells_by_square(grid, lattice)
    count = len(squares.places) - 1
    offsets, patches = np.zeros(count + 1, dtype=np.int64), np.empty((1 << 12, PATCH_COLUMNS))
    first = 0
    while first < count:
        last = int(np.searchsorted(squares.places, squares.places[first] + _CELLS_AT_ONCE, side="right"))
        last = min(max(last, first + 1), count)
        wanted = offsets[first] + squares.places[last] - squares.places[first]  # at most one patch per cell
        if wanted > len(patches):
            patches = np.concatenate([patches, np.empty((wanted, PATCH_COLUMNS))])
        _add_squares(grid, lattice, squares, first, last, offsets, patches)
        first = last
    return Sheets(rho_max, grid.size, *lattice, offsets, patches[: offsets[-1]].copy())


@kernel
def _add_squares(
    grid: _Grid, lattice: _Lattice, squares: _Squares, first: int, last: int, offsets: Integers, patches: Array
) -> None:
    """Add the patches of the squares from `first` to `last`, and their offsets."""
    cells, places, width = squares.cells, squares.places, 2 * lattice.extent + 1
    found = offsets[first]
    for square in range(first, last):
        start, stop = places[square], places[square + 1]
        for place in range(start, stop):
            squares.place_of[cells[place]] = place
        while start < stop:
            end = _gather_sheet(grid, cells, start, stop, squares.place_of)
            x = lattice.spacing * (square // width - lattice.extent)
            y = lattice.spacing * (square % width - lattice.extent)
            found = _add_patches(grid, cells[start:end], x, y, lattice.half_width, patches, found)
            start = end
        offsets[square + 1] = found


def _new_grid(levels: int, rho_max: float) -> _Grid:
    size, values = 2**levels, unit_rod_values(levels, rho_max)
    nodes = np.empty((2, size + 1, size + 1, _NODE_COLUMNS))
    nodes[..., :_ROW] = values
    nodes[..., _ROW], nodes[..., _COLUMN] = np.arange(size + 1)[:, np.newaxis], np.arange(size + 1)
    count = 2 * size * size
    grid = _Grid(
        size,
        nodes.reshape(-1, _NODE_COLUMNS),
        np.empty(count, dtype=np.int64),
        np.empty((count, 4)),
        np.empty(count, dtype=np.bool_),
    )
    for first, last in slices(count, _CELLS_AT_ONCE):
        _fill_cells(grid, first, last)
    return grid


@kernel
def _fill_cells(grid: _Grid, first_cell: int, last_cell: int) -> None:
    size, width, nodes, boxes = grid.size, grid.size + 1, grid.nodes, grid.boxes
    for cell in range(first_cell, last_cell):
        side, i, j = cell // (size * size), cell // size % size, cell % size
        first = side * width * width + i * width + j
        grid.first_node[cell] = first
        corners = nodes[first, :2], nodes[first + 1, :2], nodes[first + width, :2], nodes[first + width + 1, :2]
        for k in range(2):
            low = min(corners[0][k], corners[1][k], corners[2][k], corners[3][k])
            high = max(corners[0][k], corners[1][k], corners[2][k], corners[3][k])
            margin = _BOX_MARGIN * (high - low)
            boxes[cell, 2 * k], boxes[cell, 2 * k + 1] = low - margin, high + margin
        diagonal, other = corners[3] - corners[0], corners[2] - corners[1]
        grid.is_turned[cell] = diagonal[0] * other[1] < diagonal[1] * other[0]


def _cells_by_square(grid: _Grid, lattice: _Lattice) -> _Squares:
    """Return the cells that reach into the square of each lattice node."""
    cell_count, square_count = len(grid.boxes), (2 * lattice.extent + 1) ** 2
    places, no_cells = np.zeros(square_count + 1, dtype=np.int64), np.empty(0, dtype=np.int64)
    for first, last in slices(cell_count, _CELLS_AT_ONCE):
        _enter_cells(grid.boxes, lattice, first, last, places[1:], no_cells)
    places = np.cumsum(places)
    cells, next_place = np.empty(places[-1], dtype=np.int64), places[:-1].copy()
    for first, last in slices(cell_count, _CELLS_AT_ONCE):
        _enter_cells(grid.boxes, lattice, first, last, next_place, cells)
    return _Squares(places, cells, np.zeros(cell_count, dtype=np.int64))


@kernel
def _enter_cells(
    boxes: Array, lattice: _Lattice, first_cell: int, last_cell: int, next_place: Integers, cells: Integers
) -> None:
    """Put these cells into `cells`, at the next places of the squares that they reach into, or count them."""
    extent, spacing, half_width = lattice.extent, lattice.spacing, lattice.half_width
    width, is_filling = 2 * extent + 1, cells.shape[0] > 0
    for cell in range(first_cell, last_cell):
        first_a = max(-extent, math.ceil((boxes[cell, X_LOW] - half_width) / spacing)) + extent
        last_a = min(extent, math.floor((boxes[cell, X_HIGH] + half_width) / spacing)) + extent
        first_b = max(-extent, math.ceil((boxes[cell, Y_LOW] - half_width) / spacing)) + extent
        last_b = min(extent, math.floor((boxes[cell, Y_HIGH] + half_width) / spacing)) + extent
        for a in range(first_a, last_a + 1):
            for square in range(a * width + first_b, a * width + last_b + 1):
                if is_filling:
                    cells[next_place[square]] = cell
                next_place[square] += 1


@kernel
def _gather_sheet(grid: _Grid, cells: Integers, start: int, stop: int, place_of: Integers) -> int:
    """Bring the cells of one sheet, those connected with the cell at `start`, together; return where they end.

    `place_of` tells where in `cells` a cell is, and holds where `cells` agrees.
    """
    size, is_turned = grid.size, grid.is_turned
    end = start + 1
    current = start
    while current < end:
        cell = cells[current]
        i, j = cell // size % size, cell % size
        for step in range(4):
            if (i == 0, i == size - 1, j == 0, j == size - 1)[step]:
                continue
            other = cell + (-size, size, -1, 1)[step]
            place = place_of[other]
            if end <= place < stop and cells[place] == other and is_turned[other] == is_turned[cell]:
                displaced = cells[end]
                cells[end], cells[place] = other, displaced
                place_of[other], place_of[displaced] = end, place
                end += 1
        current += 1
    return end


@kernel
def _add_patches(
    grid: _Grid, cells: Integers, x: float, y: float, half_width: float, patches: Array, found: int
) -> int:
    """Cut the cells of a sheet into patches that are affine enough; add them to `patches`; return their number."""
    stack = np.empty((64, 2), dtype=np.int64)  # halvings, along one way or the other
    stack[0] = 0, cells.shape[0]
    top = 1
    while top > 0:
        top -= 1
        start, end = stack[top]
        patch = patches[found]
        _fit_patch(grid, cells[start:end], x, y, (_LEAST_WIDTH * half_width) ** 2, patch)
        middle = end if _is_affine(patch, half_width) else start + _halve(grid.size, cells[start:end])
        if middle == end:
            found += 1
        else:
            stack[top] = start, middle
            stack[top + 1] = middle, end
            top += 2
    return found


@kernel
def _is_affine(patch: Array, half_width: float) -> bool:
    if patch[ERROR_RADIUS] > _LARGEST_RADIUS:
        return False
    change_x = abs(patch[FORCE_X + 1]) + abs(patch[FORCE_X + 2])
    change_y = abs(patch[FORCE_Y + 1]) + abs(patch[FORCE_Y + 2])
    segment = math.hypot(patch[ERROR_X], patch[ERROR_Y])
    return bool(segment <= max(_LARGEST_SEGMENT, half_width * max(change_x, change_y)))


@kernel
def _halve(size: int, cells: Integers) -> int:
    """Sort cells into two halves along the longer way of their block; return where the second begins.

    A single cell, which cannot be halved, is left whole.
    """
    i_low = j_low = size
    i_high = j_high = 0
    for cell in cells:
        i, j = cell // size % size, cell % size
        i_low, i_high = min(i_low, i), max(i_high, i)
        j_low, j_high = min(j_low, j), max(j_high, j)
    is_along = i_high - i_low >= j_high - j_low
    middle = (i_low + i_high) // 2 if is_along else (j_low + j_high) // 2
    place, second = 0, len(cells)
    while place < second:
        if (cells[place] // size % size if is_along else cells[place] % size) <= middle:
            place += 1
        else:
            second -= 1
            cells[place], cells[second] = cells[second], cells[place]
    return second


@kernel
def _fit_patch(grid: _Grid, cells: Integers, x: float, y: float, least_square: float, patch: Array) -> None:
    """Fill `patch` with the affine fit over the corners of these cells, least squares, and with its errors."""
    patch[:] = 0.0
    patch[X_LOW] = patch[Y_LOW] = patch[RHO_LOW] = patch[GRADE_LOW] = math.inf
    patch[X_HIGH] = patch[Y_HIGH] = patch[RHO_HIGH] = patch[GRADE_HIGH] = -math.inf
    patch[SIDE] = cells[0] // (grid.size * grid.size)
    nodes, boxes = grid.nodes, grid.boxes
    sums = np.zeros((3, _NODE_COLUMNS))  # of the columns, and of x and y times them
    for cell in cells:
        first = grid.first_node[cell]
        for node in range(first, first + grid.size + 3, grid.size + 2):  # both ends of the diagonal
            for k in range(_NODE_COLUMNS):
                value = nodes[node, k] - (x if k == _TIP_X else y if k == _TIP_Y else 0.0)
                sums[0, k] += value
                sums[1, k] += (nodes[node, _TIP_X] - x) * value
                sums[2, k] += (nodes[node, _TIP_Y] - y) * value
        patch[X_LOW], patch[X_HIGH] = min(patch[X_LOW], boxes[cell, 0] - x), max(patch[X_HIGH], boxes[cell, 1] - x)
        patch[Y_LOW], patch[Y_HIGH] = min(patch[Y_LOW], boxes[cell, 2] - y), max(patch[Y_HIGH], boxes[cell, 3] - y)
        row, column = nodes[first, _ROW], nodes[first, _COLUMN]
        patch[RHO_LOW], patch[RHO_HIGH] = min(patch[RHO_LOW], row), max(patch[RHO_HIGH], row + 1.0)
        patch[GRADE_LOW], patch[GRADE_HIGH] = min(patch[GRADE_LOW], column), max(patch[GRADE_HIGH], column + 1.0)
    sums /= 2.0 * cells.shape[0]
    _solve_fit(sums, least_square, patch)
    _set_errors(grid, cells, x, y, patch)


@kernel
def _solve_fit(sums: Array, least_square: float, patch: Array) -> None:
    mean_x, mean_y = sums[0, _TIP_X], sums[0, _TIP_Y]
    xx, yy = sums[1, _TIP_X] - mean_x * mean_x + least_square, sums[2, _TIP_Y] - mean_y * mean_y + least_square
    xy = sums[1, _TIP_Y] - mean_x * mean_y
    inverse = 1.0 / (xx * yy - xy * xy)
    for k in range(_EXPLAINED, _NODE_COLUMNS):
        mean = sums[0, k]
        along_x, along_y = sums[1, k] - mean_x * mean, sums[2, k] - mean_y * mean
        slope_x, slope_y = (yy * along_x - xy * along_y) * inverse, (xx * along_y - xy * along_x) * inverse
        column = FORCE_X + 3 * (k - _EXPLAINED)
        patch[column] = mean - slope_x * mean_x - slope_y * mean_y
        patch[column + 1], patch[column + 2] = slope_x, slope_y


@kernel
def _force_error(nodes: Array, node: int, x: float, y: float, patch: Array) -> tuple[float, float]:
    away_x, away_y = nodes[node, _TIP_X] - x, nodes[node, _TIP_Y] - y
    return (
        nodes[node, _FORCE_X] - patch[FORCE_X] - patch[FORCE_X + 1] * away_x - patch[FORCE_X + 2] * away_y,
        nodes[node, _FORCE_Y] - patch[FORCE_Y] - patch[FORCE_Y + 1] * away_x - patch[FORCE_Y + 2] * away_y,
    )


@kernel
def _set_errors(grid: _Grid, cells: Integers, x: float, y: float, patch: Array) -> None:
    """Enclose the errors of the force in a segment along their main direction and a radius about it."""
    nodes, size = grid.nodes, grid.size
    xx = xy = yy = 0.0
    for cell in cells:
        error_x, error_y = _force_error(nodes, grid.first_node[cell], x, y, patch)
        xx += error_x * error_x
        xy += error_x * error_y
        yy += error_y * error_y
    angle = 0.5 * math.atan2(2.0 * xy, xx - yy)
    c, s = math.cos(angle), math.sin(angle)
    along = across = 0.0
    for cell in cells:
        first = grid.first_node[cell]
        for node in (first, first + 1, first + size + 1, first + size + 2):
            error_x, error_y = _force_error(nodes, node, x, y, patch)
            along = max(along, abs(c * error_x + s * error_y))
            across = max(across, abs(c * error_y - s * error_x))
    patch[ERROR_X], patch[ERROR_Y] = _ERROR_FACTOR * along * c, _ERROR_FACTOR * along * s
    patch[ERROR_RADIUS] = _ERROR_FACTOR * across
