"""The stable equilibria at the nodes of a raster."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pcm_gym.arrays import Integers
from pcm_gym.mechanism.validation import finite_array, instance_of, whole_array, whole_number
from pcm_gym.solving.raster import Raster, Region

Singles = NDArray[np.float32]

_TYPES = {"offsets": np.int64, "branches": np.int32}
_MOST_BRANCHES = (1 << 31) - 1


@dataclass(frozen=True, eq=False)
class RasterStates:
    """All stable equilibria within the limits at the nodes of a raster, cell after cell, in each by energy.

    The numbers are in single precision; `Atlas.at_pose` and `Atlas.at_inputs` give equilibria exact to rounding.

    Attributes
    ----------
    raster : Raster
    offsets : array (cells + 1,) of int64
        The equilibria of cell c are the rows ``offsets[c]`` to ``offsets[c + 1]`` of the other arrays.
    branches : array (n,) of int32
        Number of the branch.
    inputs : array (n, legs) of float32
        Actuator inputs, rad or m.
    poses : array (n, d) of float32
        Poses, m and rad.
    rods : array (n, 2 legs) of float32
        The kernels' loads of the rods as their tips see them, dimensionless.
    margins : array (n,) of float32
        Stability margins, dimensionless.
    energies : array (n,) of float32
        Energies, J.
    """

    raster: Raster
    offsets: Integers
    branches: NDArray[np.int32]
    inputs: Singles
    poses: Singles
    rods: Singles
    margins: Singles
    energies: Singles

    def __post_init__(self) -> None:
        dof = len(instance_of("raster", self.raster, Raster).shape)
        count = len(whole_array("branches", self.branches, ("n",), 0, _MOST_BRANCHES))
        shapes: dict[str, tuple[int, ...]] = {"offsets": (self.raster.size + 1,), "branches": (count,)}
        shapes |= {"inputs": (count, dof), "poses": (count, dof), "rods": (count, 2 * dof)}
        shapes |= {"margins": (count,), "energies": (count,)}
        for name, shape in shapes.items():
            given, kind = getattr(self, name), _TYPES.get(name, np.float32)
            is_whole = np.issubdtype(kind, np.integer)
            checked = whole_array(name, given, shape, 0, 1 << 62) if is_whole else finite_array(name, given, shape)
            array = np.asarray(checked, dtype=kind)
            array.setflags(write=False)
            object.__setattr__(self, name, array)
        if self.offsets[0] != 0 or self.offsets[-1] != count or (np.diff(self.offsets) < 0).any():
            raise ValueError(f"offsets must ascend from 0 to {count}")

    def __len__(self) -> int:
        """Return the number of equilibria, over all cells."""
        return len(self.branches)

    @property
    def counts(self) -> Integers:
        """Number of stable equilibria in each cell, of the raster's shape."""
        return np.diff(self.offsets).reshape(self.raster.shape)

    @cached_property
    def cells(self) -> Integers:
        """Cell of each equilibrium, (n,)."""
        return np.repeat(np.arange(self.raster.size), np.diff(self.offsets))

    def rows(self, cells: Integers) -> Integers:
        """Return the rows of the equilibria in these cells."""
        cells = whole_array("cells", cells, ("n",), 0, self.raster.size - 1)
        spans = [np.arange(self.offsets[cell], self.offsets[cell + 1]) for cell in cells]
        return np.concatenate(spans) if spans else np.empty(0, dtype=np.int64)

    def covered(self, branch: int | None = None) -> Region:
        """Return the cells in which there is a stable equilibrium, or one of a branch."""
        if branch is not None:
            whole_number("branch", branch, least=0)
        mask = np.zeros(self.raster.size, dtype=np.bool_)
        mask[self.cells if branch is None else self.cells[self.branches == branch]] = True
        return Region(self.raster, mask.reshape(self.raster.shape))
