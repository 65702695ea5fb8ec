"""A policy as a user holds it."""

import copy
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pcm_gym.mechanism.validation import file_path, instance_of, mapping
from pcm_gym.policies.files import read_policy, write_policy
from pcm_gym.policies.network import Network


class Policy:
    """Chooses actions: ``policy(observation)`` for one environment or for a batch, in some tens of microseconds.

    It always does the same for the same observation, up to the rounding of single precision.

    Parameters
    ----------
    network : Network
    card : mapping
        What is known of it, as plain data: how and on what it was trained, and what came of it.
    """

    def __init__(self, network: Network, card: Mapping[str, Any]) -> None:
        self._network = instance_of("network", network, Network)
        self._card = copy.deepcopy(dict(mapping("card", card)))
        self._sizes = dict(zip(network.keys, network.sizes, strict=True))

    @property
    def card(self) -> dict[str, Any]:
        """What is known of it, as plain data; a copy."""
        return copy.deepcopy(self._card)

    @property
    def size(self) -> int:
        """How many numbers its network has."""
        return sum(own.weights.size + own.bias.size for own in self._network.layers)

    def __call__(self, observation: Mapping[str, ArrayLike]) -> NDArray[np.float32]:
        """Return the action (legs,), in [-1, 1], or those of several observations, (n, legs).

        Parameters
        ----------
        observation : mapping of array_like (k,) or (n, k)
            What a goal-based environment of the kind it was trained on returns: `observation`, `achieved_goal` and
            `desired_goal`, of one environment or of n.

        Raises
        ------
        TypeError, ValueError
            If there is an entry missing, or one of another size.
        """
        entries = self._checked(observation)
        return self._network(entries)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write it to a file, which `load_policy` reads."""
        write_policy(file_path("path", path), self._network, self._card)

    def save_onnx(self, path: str | os.PathLike[str]) -> None:
        """Write it as an ONNX model, with its card among the properties; needs the extra ``onnx``.

        The model takes the entries of observations, each (n, k), in single precision, and returns `action`, (n, legs).

        Raises
        ------
        ImportError
            If onnx is not installed.
        """
        target = Path(file_path("path", path))
        from pcm_gym.policies.onnx_file import write_onnx

        write_onnx(target, self._network, self._card)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> "Policy":
        """Read it from a file; no code in it is run.

        Raises
        ------
        PolicyError
            If it is not a policy, or a damaged one; `PolicyNotFoundError` if there is no such file.
        """
        return cls(*read_policy(Path(file_path("path", path))))

    def _checked(self, observation: Mapping[str, ArrayLike]) -> dict[str, NDArray[Any]]:
        entries, leading = {}, None
        for key, size in self._sizes.items():
            try:
                value = np.asarray(observation[key])
            except (KeyError, IndexError, TypeError) as error:
                raise TypeError(f"observation must have the entries {[*self._sizes]}, got no {key!r}") from error
            if value.dtype.kind not in "fiu":
                raise TypeError(f"observation[{key!r}] must be an array of numbers, got {value.dtype}")
            if value.ndim not in (1, 2) or value.shape[-1] != size:
                raise ValueError(f"observation[{key!r}] must be ({size},) or (n, {size}), got {value.shape}")
            if leading is not None and value.shape[:-1] != leading:
                raise ValueError(f"observation[{key!r}] must be of as many environments as the others")
            entries[key], leading = value, value.shape[:-1]
        return entries
