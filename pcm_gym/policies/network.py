"""The arithmetic of a policy: observations in, actions out."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pcm_gym.arrays import Array
from pcm_gym.mechanism.validation import one_of, positive_number

Singles = NDArray[np.float32]
Features = Callable[["Network", Mapping[str, Any]], Singles]

OBSERVATION, ACHIEVED, DESIRED = "observation", "achieved_goal", "desired_goal"


def _concatenated(network: "Network", observed: Mapping[str, Any]) -> Singles:
    return np.concatenate([observed[key] for key in network.keys], axis=-1, dtype=np.float32, casting="same_kind")


def _goal_error(network: "Network", observed: Mapping[str, Any]) -> Singles:
    desired: Singles = np.asarray(observed[DESIRED], dtype=np.float32)
    error = desired - np.asarray(observed[ACHIEVED], dtype=np.float32)
    distance = np.sqrt((error * error).sum(axis=-1, keepdims=True))
    direction = error / (distance + np.float32(network.fine))
    return np.concatenate([observed[OBSERVATION], desired, error, direction], axis=-1, dtype=np.float32)


# How what is observed becomes what the first layer takes: all of it side by side, or with the error to the goal.
FEATURES: dict[str, Features] = {"concatenated": _concatenated, "goal_error": _goal_error}

_ZERO, _ONE = np.float32(0.0), np.float32(1.0)


def _elu(values: Singles) -> Singles:
    result: Singles = np.where(values > _ZERO, values, np.expm1(np.minimum(values, _ZERO)))
    return result


def _silu(values: Singles) -> Singles:
    return np.asarray(values / (_ONE + np.exp(-values)), dtype=np.float32)


ACTIVATIONS: dict[str, Callable[[Singles], Singles]] = {
    "tanh": np.tanh,
    "relu": lambda values: np.maximum(values, _ZERO),
    "elu": _elu,
    "silu": _silu,
}
# What keeps actions between -1 and 1.
OUTPUTS: dict[str, Callable[[Singles], Singles]] = {
    "clip": lambda values: np.minimum(np.maximum(values, -_ONE), _ONE),
    "tanh": np.tanh,
}


@dataclass(frozen=True)
class Layer:
    """A linear layer: weights (inputs, outputs) and bias (outputs,)."""

    weights: Singles
    bias: Singles


@dataclass(frozen=True)
class Normaliser:
    """How the entry "observation" is normalised: ``(value - mean) / deviation``, cut to +-`clip`.

    Attributes
    ----------
    mean, deviation : array (k,)
    clip : float
    """

    mean: Array
    deviation: Array
    clip: float

    def __call__(self, observation: Any) -> Singles:
        """Normalised observations, of the same shape."""
        scaled = (observation - self.mean) / self.deviation
        result: Singles = np.minimum(np.maximum(scaled, -self.clip), self.clip).astype(np.float32)
        return result


@dataclass(frozen=True)
class Network:
    """A multilayer perceptron over an observation of a goal-based environment.

    Attributes
    ----------
    keys : tuple of str
        Entries of the observation, in the order in which "concatenated" features have them.
    sizes : tuple of int
        Numbers of elements of these entries.
    features, activation, output : str
        Names in `FEATURES`, `ACTIVATIONS` and `OUTPUTS`.
    fine : float
        For the features "goal_error": distance, in the units of goals, below which its direction fades out.
    layers : tuple of Layer
    normaliser : Normaliser, optional
    """

    keys: tuple[str, ...]
    sizes: tuple[int, ...]
    features: str
    activation: str
    output: str
    fine: float
    layers: tuple[Layer, ...]
    normaliser: Normaliser | None

    def __post_init__(self) -> None:
        one_of("features", self.features, tuple(FEATURES))
        one_of("activation", self.activation, tuple(ACTIVATIONS))
        one_of("output", self.output, tuple(OUTPUTS))
        positive_number("fine", self.fine)
        if {*self.keys} != {OBSERVATION, ACHIEVED, DESIRED} or len(self.keys) != 3 or len(self.sizes) != 3:
            raise ValueError(f"keys must be those of a goal-based environment, with their sizes, got {self.keys}")
        self._check_shapes()

    def _check_shapes(self) -> None:
        size = dict(zip(self.keys, self.sizes, strict=True))
        width = sum(self.sizes) + (2 * size[DESIRED] - size[ACHIEVED]) * (self.features == "goal_error")
        if not self.layers:
            raise ValueError("layers must be at least one")
        for number, layer in enumerate(self.layers):
            if layer.weights.shape != (width, layer.bias.size) or layer.bias.ndim != 1:
                raise ValueError(f"layers[{number}] must take {width} numbers, got weights {layer.weights.shape}")
            if not (np.isfinite(layer.weights).all() and np.isfinite(layer.bias).all()):
                raise ValueError(f"layers[{number}] must be finite")
            width = layer.bias.size
        own = self.normaliser
        if own is not None and not (own.mean.shape == own.deviation.shape == (size[OBSERVATION],)):
            raise ValueError(f"normaliser must have {size[OBSERVATION]} means and deviations, got {own.mean.shape}")
        if own is not None and not (np.isfinite(own.mean).all() and (own.deviation > 0.0).all() and own.clip > 0.0):
            raise ValueError("normaliser must have finite means, positive deviations and a positive clip")

    def __call__(self, observed: Mapping[str, Any]) -> Singles:
        """Actions (legs,) of one observation, or (n, legs) of several, in [-1, 1]."""
        if self.normaliser is not None:
            observed = {**observed, OBSERVATION: self.normaliser(observed[OBSERVATION])}
        values, activation = FEATURES[self.features](self, observed), ACTIVATIONS[self.activation]
        for layer in self.layers[:-1]:
            values = activation(values @ layer.weights + layer.bias)
        last = self.layers[-1]
        return OUTPUTS[self.output](values @ last.weights + last.bias)
