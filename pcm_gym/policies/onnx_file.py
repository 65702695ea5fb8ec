"""A policy as an ONNX model, for runtimes that are not NumPy; needs the extra ``onnx``."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from pcm_gym.policies.network import ACHIEVED, DESIRED, OBSERVATION, Network

try:
    import onnx
    from onnx import TensorProto, helper, numpy_helper
except ImportError as error:
    raise ImportError("ONNX models need onnx, which is not installed: pip install 'pcm_gym[onnx]'") from error

# Of the operators, and of the file: old enough for the runtimes in use.
_OPERATORS, _FORMAT = 18, 9
_ACTIVATIONS = {"tanh": "Tanh", "relu": "Relu", "elu": "Elu"}
ACTION = "action"


def write_onnx(path: Path, network: Network, card: Mapping[str, Any]) -> None:
    """Write a model that takes an observation's entries, each (n, k), and returns actions (n, legs)."""
    graph = _Graph()
    last = graph.output(network, graph.layers(network, graph.features(network, graph.observed(network))))
    width = network.layers[-1].bias.size
    model = helper.make_model(
        helper.make_graph(
            [*graph.nodes, helper.make_node("Identity", [last], [ACTION])],
            "policy",
            [_value(key, size) for key, size in zip(network.keys, network.sizes, strict=True)],
            [_value(ACTION, width)],
            graph.constants,
        ),
        opset_imports=[helper.make_opsetid("", _OPERATORS)],
        ir_version=_FORMAT,
        producer_name="pcm_gym",
    )
    helper.set_model_props(model, {"card": json.dumps(card, allow_nan=False, sort_keys=True)})
    onnx.checker.check_model(model, full_check=True)
    path.write_bytes(model.SerializeToString())


def _value(name: str, size: int) -> Any:
    return helper.make_tensor_value_info(name, TensorProto.FLOAT, ["n", size])


class _Graph:
    """Nodes as they are added, each with a name that no other one has."""

    def __init__(self) -> None:
        self.nodes: list[Any] = []
        self.constants: list[Any] = []

    def add(self, operator: str, *inputs: str, **attributes: Any) -> str:
        """Add a node; return the name of what it puts out."""
        name = f"{operator}_{len(self.nodes)}"
        self.nodes.append(helper.make_node(operator, [*inputs], [name], **attributes))
        return name

    def constant(self, values: Any) -> str:
        """Add numbers, which keep their type."""
        name = f"numbers_{len(self.constants)}"
        self.constants.append(numpy_helper.from_array(np.asarray(values), name))
        return name

    def observed(self, network: Network) -> dict[str, str]:
        """Add the normalisation, in double precision; return the names of the entries."""
        names, own = {key: key for key in network.keys}, network.normaliser
        if own is not None:
            wide = self.add("Cast", OBSERVATION, to=TensorProto.DOUBLE)
            moved = self.add("Sub", wide, self.constant(own.mean))
            scaled = self.add("Div", moved, self.constant(own.deviation))
            cut = self.add("Clip", scaled, self.constant(-own.clip), self.constant(own.clip))
            names[OBSERVATION] = self.add("Cast", cut, to=TensorProto.FLOAT)
        return names

    def features(self, network: Network, names: Mapping[str, str]) -> str:
        """Add what the first layer takes."""
        if network.features == "concatenated":
            return self.add("Concat", *(names[key] for key in network.keys), axis=-1)
        error = self.add("Sub", names[DESIRED], names[ACHIEVED])
        distance = self.add("ReduceL2", error, self.constant(np.array([-1])), keepdims=1)
        direction = self.add("Div", error, self.add("Add", distance, self.constant(np.float32(network.fine))))
        return self.add("Concat", names[OBSERVATION], names[DESIRED], error, direction, axis=-1)

    def layers(self, network: Network, values: str) -> str:
        """Add all layers, the activations between them included."""
        for number, layer in enumerate(network.layers):
            if number:
                values = self._activation(network.activation, values)
            values = self.add("Gemm", values, self.constant(layer.weights), self.constant(layer.bias))
        return values

    def output(self, network: Network, values: str) -> str:
        """Add what keeps actions between -1 and 1."""
        if network.output == "tanh":
            return self.add("Tanh", values)
        return self.add("Clip", values, self.constant(np.float32(-1.0)), self.constant(np.float32(1.0)))

    def _activation(self, name: str, values: str) -> str:
        if name == "silu":
            return self.add("Mul", values, self.add("Sigmoid", values))
        return self.add(_ACTIVATIONS[name], values)
