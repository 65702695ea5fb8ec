"""A policy as a file: a NumPy archive (npz) of plain arrays, what they mean and the card as JSON inside."""

import hashlib
import json
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pcm_gym.mechanism.validation import shown
from pcm_gym.policies.network import Layer, Network, Normaliser

FORMAT = "pcm_gym policy"
VERSION = 1

# Networks of policies take some 50 kB; what unpacks to more than this, in bytes, is none.
LARGEST = 1 << 28

Arrays = dict[str, NDArray[Any]]


class PolicyError(ValueError):
    """A policy that there is not, or a file that cannot be read as one; the message says why."""


class PolicyNotFoundError(PolicyError, FileNotFoundError):
    """There is no such file."""


def write_policy(path: Path, network: Network, card: Mapping[str, Any]) -> None:
    """Write a policy; `path` gets no other ending than it has.

    Raises
    ------
    TypeError, ValueError
        If the card is not what JSON can hold.
    """
    arrays = _packed(network)
    content = {**card, "digest": digest_of(network)}
    arrays |= {
        "format": np.array(FORMAT),
        "version": np.array(VERSION),
        "card": np.array(json.dumps(content, allow_nan=False, sort_keys=True)),
    }
    with path.open("wb") as file:
        np.savez_compressed(file, allow_pickle=False, **arrays)


def read_policy(path: Path) -> tuple[Network, dict[str, Any]]:
    """Return the network and the card of the policy in a file.

    Raises
    ------
    PolicyError
        If it is not a policy, is of another version, is damaged, or its numbers are not those that its card is of;
        `PolicyNotFoundError` if there is no such file.
    """
    arrays = _arrays(path)
    if shown(arrays.get("format")) != shown(np.array(FORMAT)):
        raise PolicyError(f"{path} is not a policy: it has no entry 'format' that says {FORMAT!r}")
    version = arrays.get("version", np.array(-1))
    if not np.array_equal(version, VERSION):
        raise PolicyError(f"{path} is a policy of version {version}; this is version {VERSION}: export it again")
    try:
        network, card = _unpacked(arrays), json.loads(str(arrays["card"]))
        recorded = card["digest"]
    except KeyError as error:
        raise PolicyError(f"{path} is a damaged policy: it has no entry {error}") from error
    except Exception as error:  # whatever wrong types and shapes of entries lead to
        raise PolicyError(f"{path} is a damaged policy: {error}") from error
    if recorded != digest_of(network):
        raise PolicyError(f"{path} is a damaged policy: its numbers are not those that its card is of")
    return network, card


def digest_of(network: Network) -> str:
    """Return the SHA-256 of all numbers of a network and of what they mean, as hexadecimal digits."""
    digest = hashlib.sha256()
    for name, array in sorted(_packed(network).items()):
        digest.update(f"{name} {array.dtype.str} {array.shape}".encode())
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


def _arrays(path: Path) -> Arrays:
    try:
        with path.open("rb") as file, zipfile.ZipFile(file) as archive:
            size = sum(entry.file_size for entry in archive.infolist())
        if size > LARGEST:
            raise PolicyError(f"{path} is not a policy: it holds {size} bytes, and a policy at most {LARGEST}")
        with path.open("rb") as file, np.lib.npyio.NpzFile(file) as archive:
            return {name: archive[name] for name in archive.files}
    except PolicyError:
        raise
    except FileNotFoundError as error:
        raise PolicyNotFoundError(f"{path} cannot be read: {error.strerror}") from error
    except Exception as error:  # whatever a file's bytes lead zipfile, zlib and NumPy to
        raise PolicyError(f"{path} is not a policy: {error}") from error


def _packed(network: Network) -> Arrays:
    meaning = {
        "keys": network.keys,
        "sizes": network.sizes,
        "features": network.features,
        "activation": network.activation,
        "output": network.output,
        "fine": network.fine,
    }
    arrays: Arrays = {"network": np.array(json.dumps(meaning, sort_keys=True))}
    for number, layer in enumerate(network.layers):
        arrays |= {f"weights_{number}": layer.weights, f"bias_{number}": layer.bias}
    if network.normaliser is not None:
        own = network.normaliser
        arrays |= {"mean": own.mean, "deviation": own.deviation, "clip": np.array(own.clip)}
    return arrays


def _unpacked(arrays: Arrays) -> Network:
    meaning = json.loads(str(arrays["network"]))
    count = sum(name.startswith("weights_") for name in arrays)
    layers = tuple(
        Layer(_numbers(arrays[f"weights_{n}"], np.float32), _numbers(arrays[f"bias_{n}"], np.float32))
        for n in range(count)
    )
    normaliser = None
    if "mean" in arrays:
        mean, deviation = (_numbers(arrays[name], np.float64) for name in ("mean", "deviation"))
        normaliser = Normaliser(mean, deviation, float(arrays["clip"]))
    keys, sizes = tuple(meaning.pop("keys")), tuple(int(size) for size in meaning.pop("sizes"))
    return Network(keys=keys, sizes=sizes, layers=layers, normaliser=normaliser, **meaning)


def _numbers(array: NDArray[Any], dtype: type[np.floating[Any]]) -> NDArray[Any]:
    """Return the array if it is of that type; its numbers are not changed by reading."""
    if array.dtype != dtype:
        raise ValueError(f"an array must be of type {np.dtype(dtype)}, got {array.dtype}")
    return np.ascontiguousarray(array)
