"""A raster of inputs and a raster of poses: cells, nodes and neighbours."""

import math
from typing import NamedTuple

from pcm_gym.arrays import Array, Integers, Mask
from pcm_gym.kernels.numerics.compilation import kernel

# The two rasters.
INPUTS, POSES = range(2)
NOWHERE = -1
# Within this of an edge, in pitches, a point is on it: in the next cell, or at an actuator's limit in the last one.
# Which cell that is must not depend on rounding, nor what grows from it.
ON_THE_EDGE = 1e-9


class Rasters(NamedTuple):
    """Nodes of the rasters of inputs (row 0) and poses (row 1), each in the middle of its cell."""

    shape: Integers  # (2, d)
    first_node: Array  # (2, d)
    pitch: Array  # (2, d)
    # (2, d): whether the last node is followed by the first, a turn away: a platform's angle, a motor's input
    is_closed: Mask


@kernel
def cell_count(rasters: Rasters, space: int) -> int:
    """Return the number of cells of a raster."""
    return int(rasters.shape[space].prod())


@kernel
def nearest_cell(rasters: Rasters, space: int, point: Array) -> int:
    """Return the cell in which a point lies, or -1 beyond the raster."""
    cell = 0
    for axis in range(point.shape[0]):
        count = rasters.shape[space, axis]
        ratio = (point[axis] - rasters.first_node[space, axis]) / rasters.pitch[space, axis] + 0.5
        place = int(math.floor(ratio + ON_THE_EDGE))
        if place == count and ratio <= count + ON_THE_EDGE:
            place -= 1
        if rasters.is_closed[space, axis]:
            place %= count
        if not 0 <= place < count:
            return NOWHERE
        cell = cell * count + place
    return cell


@kernel
def neighbour(rasters: Rasters, space: int, cell: int, axis: int, side: int) -> int:
    """Return the next cell along an axis, to lower values on side 0; -1 beyond the raster."""
    stride = 1
    for other in range(axis + 1, rasters.shape.shape[1]):
        stride *= rasters.shape[space, other]
    count = rasters.shape[space, axis]
    place = (cell // stride) % count
    beside = place + 2 * side - 1
    if rasters.is_closed[space, axis]:
        beside %= count
    return cell + (beside - place) * stride if 0 <= beside < count else NOWHERE


@kernel
def set_node(rasters: Rasters, space: int, cell: int, point: Array) -> None:
    """Fill `point` (d,) with the node of a cell."""
    for axis in range(point.shape[0] - 1, -1, -1):
        count = rasters.shape[space, axis]
        point[axis] = rasters.first_node[space, axis] + (cell % count) * rasters.pitch[space, axis]
        cell //= count
