"""An atlas as a file: a NumPy archive (npz) of plain arrays, the mechanism as JSON inside."""

import zipfile
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pcm_gym.mechanism import mechanism_from_json, mechanism_to_json
from pcm_gym.mechanism.validation import shown
from pcm_gym.solving.raster import Raster
from pcm_gym.solving.raster_states import RasterStates

FORMAT = "pcm_gym atlas"
VERSION = 1

# An atlas takes some 10 MB, of a platform some 100 MB; what unpacks to more than this, in bytes, is none.
LARGEST = 1 << 33

Arrays = dict[str, NDArray[Any]]


class AtlasError(ValueError):
    """A file that cannot be read as an atlas; the message says why."""


class AtlasNotFoundError(AtlasError, FileNotFoundError):
    """There is no such file."""


def write_atlas(path: Path, content: Mapping[str, Any]) -> None:
    """Write the fields of an atlas; `path` gets no other ending than it has."""
    arrays: Arrays = {
        "format": np.array(FORMAT),
        "version": np.array(VERSION),
        "mechanism": np.array(mechanism_to_json(content["mechanism"])),
        "load": content["load"],
        "rho_max": np.array(content["rho_max"]),
        "home_branch": np.array(-1 if content["home_branch"] is None else content["home_branch"]),
        "limits": np.array(content["limits"], dtype=np.str_),
    }
    for name in ("over_inputs", "over_poses"):
        arrays |= _packed(name, content[name])
    with path.open("wb") as file:
        np.savez_compressed(file, allow_pickle=False, **arrays)


def read_atlas(path: Path) -> dict[str, Any]:
    """Return the fields of the atlas in a file.

    Raises
    ------
    AtlasError
        If it is not an atlas, is of another version, or its arrays do not fit together; `AtlasNotFoundError` if there
        is no such file.
    """
    try:
        with path.open("rb") as file, zipfile.ZipFile(file) as archive:
            size = sum(entry.file_size for entry in archive.infolist())
        if size > LARGEST:
            raise AtlasError(f"{path} is not an atlas: it holds {size} bytes, and an atlas at most {LARGEST}")
        with path.open("rb") as file, np.lib.npyio.NpzFile(file) as archive:
            arrays = {name: archive[name] for name in archive.files}
    except AtlasError:
        raise
    except FileNotFoundError as error:
        raise AtlasNotFoundError(f"{path} cannot be read: {error.strerror}") from error
    except Exception as error:  # whatever a file's bytes lead zipfile, zlib and NumPy to
        raise AtlasError(f"{path} is not an atlas: {error}") from error
    if shown(arrays.get("format")) != shown(np.array(FORMAT)):
        raise AtlasError(f"{path} is not an atlas: it has no entry 'format' that says {FORMAT!r}")
    version = arrays.get("version", np.array(-1))
    if not np.array_equal(version, VERSION):
        raise AtlasError(f"{path} is an atlas of version {version}; this is version {VERSION}: build it again")
    try:
        return _fields(arrays)
    except KeyError as error:
        raise AtlasError(f"{path} is a damaged atlas: it has no entry {error}") from error
    except Exception as error:  # whatever wrong types and shapes of entries lead to
        raise AtlasError(f"{path} is a damaged atlas: {error}") from error


def _fields(arrays: Arrays) -> dict[str, Any]:
    mechanism = mechanism_from_json(str(arrays["mechanism"]))
    home_branch = int(arrays["home_branch"])
    return {
        "mechanism": mechanism,
        "load": mechanism.check_load(arrays["load"]),
        "rho_max": float(arrays["rho_max"]),
        "home_branch": None if home_branch < 0 else home_branch,
        "over_inputs": _unpacked("over_inputs", arrays),
        "over_poses": _unpacked("over_poses", arrays),
        "limits": tuple(arrays["limits"].tolist()) if "limits" in arrays else (),
    }


def _packed(name: str, sheets: RasterStates) -> Arrays:
    parts = {field.name: getattr(sheets, field.name) for field in fields(sheets) if field.name != "raster"}
    parts |= {f"raster.{field.name}": np.array(getattr(sheets.raster, field.name)) for field in fields(sheets.raster)}
    return {f"{name}.{part}": value for part, value in parts.items()}


def _unpacked(name: str, arrays: Arrays) -> RasterStates:
    raster = Raster(
        tuple(arrays[f"{name}.raster.shape"].tolist()),
        arrays[f"{name}.raster.first_node"],
        arrays[f"{name}.raster.pitch"],
        tuple(arrays[f"{name}.raster.is_closed"].tolist()),
    )
    parts = {field.name: arrays[f"{name}.{field.name}"] for field in fields(RasterStates) if field.name != "raster"}
    return RasterStates(raster, **parts)
