"""What comes with the package of the catalogue's scenes: home, and the roadmap of stable ways from there.

To work them out takes a second, and a minute of compiling before. A file is found by the mechanism's name, and holds
for the mechanism, the steps and the margin that it tells; all else is worked out. `python -m tests.shipped` writes the
files again, and a test works out all that they hold.
"""

from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pcm_gym.arrays import Array, Integers
from pcm_gym.mechanism import Mechanism
from pcm_gym.solving.equilibrium import Equilibrium
from pcm_gym.solving.raster import Raster
from pcm_gym.solving.roadmap import Roadmap, roadmap_raster

FOLDER = Path(__file__).parent / "shipped"
# Of what the files hold; another one is not read.
_VERSION = 1
# Mechanisms are the same whose numbers differ by rounding alone, as those do that libraries' sines and cosines go into.
_ROUNDING = 1e-14

_Arrays = dict[str, NDArray[Any]]


def shipped_home(mechanism: Mechanism) -> Equilibrium | None:
    """Return the home equilibrium of a mechanism without a load; None if it is none of those that are shipped."""
    kept = _kept(mechanism)
    return None if kept is None else _home(mechanism, kept)


def shipped_roadmap(mechanism: Mechanism, step: Array, least_margin: float) -> Roadmap | None:
    """Return the roadmap from home without a load, for steps (legs,) and a margin; None if it is not shipped."""
    kept = _kept(mechanism)
    if kept is None or not _are_same(kept["scene"], _scene_numbers(mechanism, step, least_margin)):
        return None
    raster = roadmap_raster(mechanism, step)
    roadmap = Roadmap(
        mechanism,
        np.zeros(mechanism.dof),
        least_margin,
        raster,
        kept["states"],
        _inputs(mechanism, raster, kept["cells"]),
        kept["cells"],
        kept["ways"],
        tuple(kept["seeds"].tolist()),
    )
    roadmap.__dict__["pose_densities"] = kept["pose_densities"]
    return roadmap


def write(folder: Path, home: Equilibrium, roadmap: Roadmap, step: Array) -> None:
    """Write the file of a mechanism: its home, and its roadmap for steps (legs,)."""
    mechanism = home.mechanism
    arrays: _Arrays = {
        "version": np.array(_VERSION),
        "mechanism": _mechanism_numbers(mechanism),
        "home": home.state,
        "scene": _scene_numbers(mechanism, step, roadmap.least_margin),
        "states": roadmap.states,
        "cells": roadmap.cells.astype(np.int32),
        "ways": roadmap.ways.astype(np.int32),
        "seeds": np.array(roadmap.seeds),
        "pose_densities": roadmap.pose_densities,
    }
    np.savez_compressed(folder / f"{mechanism.name}.npz", allow_pickle=False, **arrays)


@lru_cache(maxsize=4)
def _kept(mechanism: Mechanism) -> _Arrays | None:
    """Return what is shipped of a mechanism; None if nothing is, or nothing that can be read."""
    path = {found.stem: found for found in FOLDER.glob("*.npz")}.get(mechanism.name)
    if path is None:
        return None
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
            kept = {name: archive[name] for name in archive.files}
        is_own = kept["version"] == _VERSION and _are_same(kept["mechanism"], _mechanism_numbers(mechanism))
    except Exception:  # whatever a damaged file's bytes lead zipfile, zlib and NumPy to
        return None
    return kept if is_own else None


def _home(mechanism: Mechanism, kept: _Arrays) -> Equilibrium:
    inputs = mechanism.check_inputs(np.asarray(mechanism.home_inputs))
    return Equilibrium(mechanism, kept["home"], inputs, np.zeros(mechanism.dof))


def _inputs(mechanism: Mechanism, raster: Raster, cells: Integers) -> Array:
    """Return the inputs (n, legs) in the middle of cells, to the bits that the kernels work out."""
    units = mechanism.units
    first, pitch = units.kernel_from_inputs(raster.first_node), units.kernel_from_inputs(raster.pitch)
    return units.inputs_from_kernel(first + np.stack(np.unravel_index(cells, raster.shape), axis=1) * pitch)


def _mechanism_numbers(mechanism: Mechanism) -> Array:
    """Return all that home depends on, dimensionless; not a number for what the mechanism leaves open."""
    home_pose = np.full(mechanism.dof, np.nan)
    if mechanism.home_pose is not None:
        home_pose = mechanism.units.kernel_from_pose(np.array(mechanism.home_pose))
    home_inputs = mechanism.units.kernel_from_inputs(np.asarray(mechanism.home_inputs))
    return np.concatenate([mechanism.leg_table.ravel(), home_inputs, home_pose])


def _scene_numbers(mechanism: Mechanism, step: Array, least_margin: float) -> Array:
    """Return all else that the roadmap depends on, dimensionless."""
    return np.append(mechanism.units.kernel_from_inputs(step), least_margin)


def _are_same(numbers: NDArray[Any], others: Array) -> bool:
    is_shaped = numbers.shape == others.shape
    return is_shaped and np.allclose(numbers, others, rtol=_ROUNDING, atol=_ROUNDING, equal_nan=True)
