"""Rasters of inputs or poses, and regions on them with their areas and boundaries."""

import itertools
import math
from dataclasses import dataclass

import contourpy
import numpy as np
from numpy.typing import ArrayLike

from pcm_gym.arrays import Array, Integers, Mask
from pcm_gym.kernels.numerics.rasters import ON_THE_EDGE
from pcm_gym.mechanism.validation import (
    finite_array,
    finite_vector,
    instance_of,
    sequence_of,
    truth_array,
    whole_array,
)

# Most cells of a raster, and places beyond which points are equally far away.
_LARGEST, _FARTHEST = 1 << 40, 1e15


@dataclass(frozen=True, eq=False)
class Raster:
    """A regular grid of cells, each around its node.

    Attributes
    ----------
    shape : tuple of int
        Cells along each of d axes. Cells are numbered in C order.
    first_node : array (d,)
        Node of the first cell, in m or rad.
    pitch : array (d,)
        Distance of neighbouring nodes along each axis, in m or rad.
    is_closed : tuple of bool
        Whether the last cell along an axis is followed by the first: a full turn of a platform.
    """

    shape: tuple[int, ...]
    first_node: Array
    pitch: Array
    is_closed: tuple[bool, ...]

    def __post_init__(self) -> None:
        shape = tuple(whole_array("shape", self.shape, ("d",), 1, _LARGEST).tolist())
        if not shape or math.prod(shape) > _LARGEST:
            raise ValueError(f"shape must have an axis, and at most {_LARGEST} cells, got {shape}")
        axes = sequence_of("is_closed", self.is_closed, bool | np.bool_)
        if len(axes) != len(shape):
            raise ValueError(f"is_closed must have {len(shape)} values, one for each axis, got {axes}")
        pitch = finite_vector("pitch", self.pitch, len(shape))
        if not (pitch > 0.0).all():
            raise ValueError(f"pitch must be greater than 0, got {pitch.tolist()}")
        first_node = finite_vector("first_node", self.first_node, len(shape))
        self.__dict__.update(shape=shape, first_node=first_node, pitch=pitch, is_closed=tuple(map(bool, axes)))

    @classmethod
    def over(cls, lower: ArrayLike, upper: ArrayLike, shape: tuple[int, ...], is_closed: tuple[bool, ...]) -> "Raster":
        """Return the raster whose cells fill the box from `lower` to `upper`."""
        whole_array("shape", shape, ("d",), 1, _LARGEST)
        lower, upper = finite_vector("lower", lower, len(shape)), finite_vector("upper", upper, len(shape))
        pitch = (upper - lower) / shape
        return cls(shape, lower + 0.5 * pitch, pitch, is_closed)

    @property
    def size(self) -> int:
        """Number of cells."""
        return math.prod(self.shape)

    @property
    def cell_area(self) -> float:
        """Area of a cell, its volume with three axes."""
        return float(self.pitch.prod())

    @property
    def axes(self) -> tuple[Array, ...]:
        """Coordinates of the nodes along each axis."""
        return tuple(
            first + step * np.arange(count)
            for first, step, count in zip(self.first_node, self.pitch, self.shape, strict=True)
        )

    @property
    def all_nodes(self) -> Array:
        """The nodes of all cells, (cells, d)."""
        return self.nodes(np.arange(self.size))

    def nodes(self, cells: ArrayLike) -> Array:
        """Return the nodes (n, d) of cells (n,)."""
        checked = whole_array("cells", cells, ("n",), 0, self.size - 1)
        places = np.stack(np.unravel_index(checked, self.shape), axis=-1)
        nodes: Array = self.first_node + places * self.pitch
        return nodes

    def cells_of(self, points: ArrayLike) -> Integers:
        """Return the cells (n,) in which points (n, d) lie, -1 for those beyond the raster.

        On an edge, but for rounding, they are in the next one, and at the end of the raster in the last one.
        """
        ratios = self._places(finite_array("points", points, ("n", len(self.shape)))) + 0.5
        places = np.floor(ratios + ON_THE_EDGE)
        return self._cells(places - ((places == self.shape) & (ratios <= np.add(self.shape, ON_THE_EDGE))))

    def cells_around(self, point: ArrayLike) -> Integers:
        """Return the cells, up to 2^d, between whose nodes a point (d,) lies."""
        below = np.floor(self._places(finite_vector("point", point, len(self.shape))))
        cells = self._cells(below + np.array(list(itertools.product((0, 1), repeat=len(self.shape)))))
        return np.unique(cells[cells >= 0])

    def _places(self, points: Array) -> Array:
        """Return where points (..., d) are among the nodes, which are at 0, 1, ..., along each axis."""
        with np.errstate(over="ignore"):
            return np.asarray(np.clip((points - self.first_node) / self.pitch, -_FARTHEST, _FARTHEST))

    def _cells(self, numbers: Array) -> Integers:
        places = numbers.astype(np.int64)
        places = np.where(self.is_closed, places % self.shape, places)
        is_within = np.all((places >= 0) & (places < self.shape), axis=-1)
        cells = np.ravel_multi_index(tuple(np.where(is_within[..., None], places, 0).T), self.shape)
        return np.where(is_within, cells, -1)


@dataclass(frozen=True, eq=False)
class Region:
    """A set of cells of a raster.

    Attributes
    ----------
    raster : Raster
    mask : array of bool, of the raster's shape
    """

    raster: Raster
    mask: Mask

    def __post_init__(self) -> None:
        shape = instance_of("raster", self.raster, Raster).shape
        object.__setattr__(self, "mask", truth_array("mask", self.mask, shape))

    @property
    def area(self) -> float:
        """Area of the cells, in the units of the raster's axes; the volume with three axes."""
        return int(self.mask.sum()) * self.raster.cell_area

    @property
    def area_error(self) -> float:
        """Two standard deviations of `area`, if the border crosses each of its cells anywhere alike."""
        return 2.0 * math.sqrt(int(self._border.sum()) / 12.0) * self.raster.cell_area

    @property
    def _border(self) -> Mask:
        inner = self.mask
        for axis, is_closed in enumerate(self.raster.is_closed):
            width = [(1, 1) if other == axis else (0, 0) for other in range(self.mask.ndim)]
            padded = np.pad(self.mask, width, mode="wrap" if is_closed else "constant")
            count = self.mask.shape[axis]
            inner = inner & padded.take(range(count), axis) & padded.take(range(2, count + 2), axis)
        return self.mask & ~inner

    @property
    def boundaries(self) -> tuple[Array, ...]:
        """Closed polylines (n, 2) around the region and its holes, halfway between nodes in and out of it.

        Raises
        ------
        ValueError
            If the raster has three axes.
        """
        if self.mask.ndim != 2:
            raise ValueError("boundaries are polylines in the plane; take a planar region of a platform: workspace()")
        x, y = (
            np.r_[axis[0] - step, axis, axis[-1] + step]
            for axis, step in zip(self.raster.axes, self.raster.pitch, strict=True)
        )
        levels = np.pad(self.mask, 1).astype(np.float64).T
        generator = contourpy.contour_generator(x=x, y=y, z=levels, line_type=contourpy.LineType.Separate)
        return tuple(np.asarray(line) for line in generator.lines(0.5))

    def contains(self, points: ArrayLike) -> Mask:
        """Return which of the points (n, d) lie in cells of the region."""
        cells = self.raster.cells_of(points)
        return (cells >= 0) & self.mask.reshape(-1)[cells]

    def __repr__(self) -> str:
        """Return the area and of how many cells it is made."""
        return f"Region({self.area:.6g} +- {self.area_error:.2g}, {int(self.mask.sum())} cells)"
