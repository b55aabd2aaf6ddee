"""A network in TensorFlow.js's format as a LiteRT model: its convolutions, sums and enlargements.

The format is a TensorFlow graph in JSON, and its weights in a file beside it. Only what feature
pyramids of MobileNets consist of is translated; what comes before the first convolution and after
the last ones is left to the caller.
"""

from __future__ import annotations

import base64
import importlib
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

IDENTIFIER = b"TFL3"
CHANNELS = 3  # of a picture
HALF_PIXEL_CENTRES = 3  # version of the enlargement from which it has them
Node = Mapping[str, Any]


def litert_model(graph: Path, weights: Path, outputs: Sequence[str], size: int) -> bytes:
    """A LiteRT model of float32 pictures (1, size, size, 3), already scaled as the network needs.

    outputs: beginnings of names. Each output is the last convolution whose name, below the graph's
    own, begins so.
    """
    described = json.loads(graph.read_text(encoding="utf-8"))
    nodes = {node["name"]: node for node in described["modelTopology"]["node"]}
    translation = Translation(nodes, weights_of(described, weights.read_bytes()), size)
    heads = [
        [n for n in nodes if f"/{begins}" in f"/{n}" and is_convolution(nodes[n])][-1]
        for begins in outputs
    ]
    return translation.model(heads)


def weights_of(described: Node, content: bytes) -> dict[str, np.ndarray]:
    """The arrays by their names; those stored in half precision as float32."""
    arrays, start = {}, 0
    for entry in (entry for group in described["weightsManifest"] for entry in group["weights"]):
        stored = np.dtype(entry.get("quantization", entry)["dtype"])
        count = int(np.prod(entry["shape"], dtype=int))
        values = np.frombuffer(content, stored, count, start).astype(entry["dtype"])
        arrays[entry["name"]] = values.reshape(entry["shape"])
        start += count * stored.itemsize
    return arrays


def is_convolution(node: Node) -> bool:
    """Whether a node is a convolution, of all channels or of each."""
    return str(node["op"]).lower().lstrip("_").startswith(("fusedconv2d", "conv2d")) or (
        is_depthwise(node)
    )


def is_depthwise(node: Node) -> bool:
    """Whether it is a convolution of each channel."""
    return "depthwiseconv2d" in str(node["op"]).lower()


class Translation:
    """The part of a graph that has been translated."""

    def __init__(self, nodes: Mapping[str, Node], weights: Mapping[str, np.ndarray], size: int):
        self._nodes, self._weights, self._size = nodes, weights, size
        self._lite: Any = importlib.import_module("ai_edge_litert.schema_py_generated")
        self._graph = self._lite.SubGraphT()
        self._graph.tensors, self._graph.operators = [], []
        self._buffers = [self._lite.BufferT()]
        self._numbers: dict[str, int] = {}  # of the tensors, by node
        self._operations: list[int] = []

    def model(self, outputs: Sequence[str]) -> bytes:
        """The model whose results are those of the nodes of these names."""
        self._graph.outputs = [self._tensor(name) for name in outputs]
        model = self._lite.ModelT()
        model.version, model.subgraphs, model.buffers = 3, [self._graph], self._buffers
        model.operatorCodes = [self._code(operation) for operation in self._operations]
        builder = importlib.import_module("flatbuffers").Builder(1 << 20)
        builder.Finish(model.Pack(builder), IDENTIFIER)
        return bytes(builder.Output())

    def _code(self, operation: int) -> Any:
        code = self._lite.OperatorCodeT()
        code.builtinCode = code.deprecatedBuiltinCode = operation
        enlarges = operation == self._lite.BuiltinOperator.RESIZE_BILINEAR
        code.version = HALF_PIXEL_CENTRES if enlarges else 1
        return code

    def _tensor(self, name: str) -> int:
        """The number of a node's result; what is not translated is the picture."""
        if name not in self._numbers:
            node = self._nodes[name]
            if is_convolution(node):
                self._numbers[name] = self._convolution(node)
            elif node["op"] == "AddV2":
                self._numbers[name] = self._sum(node)
            elif node["op"] == "ResizeBilinear":
                self._numbers[name] = self._enlargement(node)
            else:
                self._numbers[name] = self._new((1, self._size, self._size, CHANNELS))
                self._graph.inputs = [self._numbers[name]]
        return self._numbers[name]

    def _convolution(self, node: Node) -> int:
        lite, (given, kernel, *offset) = self._lite, inputs_of(node)
        picture, values = self._tensor(given), self._weights[kernel]
        *_, channels, count = values.shape
        kind = lite.BuiltinOperator.CONV_2D
        if is_depthwise(node):
            kind, options = lite.BuiltinOperator.DEPTHWISE_CONV_2D, lite.DepthwiseConv2DOptionsT()
            options.depthMultiplier = count
            values = values.reshape(1, *values.shape[:2], channels * count)
            made = channels * count
        else:
            options, values, made = lite.Conv2DOptionsT(), values.transpose(3, 0, 1, 2), count
        stride = int(node["attr"]["strides"]["list"]["i"][1])
        options.strideH = options.strideW = stride
        options.dilationHFactor = options.dilationWFactor = 1
        is_padded = base64.b64decode(node["attr"]["padding"]["s"]) == b"SAME"
        options.padding = lite.Padding.SAME if is_padded else lite.Padding.VALID
        options.fusedActivationFunction = self._activation(node)
        bias = self._weights[offset[0]] if offset else np.zeros(made, np.float32)
        _, height, width, _ = self._graph.tensors[picture].shape
        lost = 0 if is_padded else values.shape[1] - 1
        shape = [1, *(-(-(side - lost) // stride) for side in (height, width)), made]
        return self._apply(kind, [picture, self._new(values.shape, values),
                                  self._new(bias.shape, bias)], shape, options)  # fmt: skip

    def _activation(self, node: Node) -> int:
        fused = node["attr"].get("fused_ops", {}).get("list", {}).get("s", [])
        names = {base64.b64decode(name) for name in fused}
        kinds = self._lite.ActivationFunctionType
        if b"Relu6" in names:
            return int(kinds.RELU6)
        return int(kinds.RELU if b"Relu" in names else kinds.NONE)

    def _sum(self, node: Node) -> int:
        summands = [self._tensor(name) for name in inputs_of(node)]
        shape = self._graph.tensors[summands[0]].shape
        return self._apply(
            self._lite.BuiltinOperator.ADD, summands, shape, self._lite.AddOptionsT()
        )

    def _enlargement(self, node: Node) -> int:
        """To twice the size."""
        picture = self._tensor(inputs_of(node)[0])
        options = self._lite.ResizeBilinearOptionsT()
        options.halfPixelCenters = node["attr"]["half_pixel_centers"]["b"]
        options.alignCorners = node["attr"]["align_corners"]["b"]
        _, height, width, channels = self._graph.tensors[picture].shape
        size = np.array([2 * height, 2 * width], np.int32)
        return self._apply(
            self._lite.BuiltinOperator.RESIZE_BILINEAR,
            [picture, self._new(size.shape, size)], [1, *size.tolist(), channels], options,
        )  # fmt: skip

    def _apply(self, kind: int, inputs: list[int], shape: Sequence[int], options: Any) -> int:
        """The result of an operation."""
        if kind not in self._operations:
            self._operations.append(kind)
        operator = self._lite.OperatorT()
        operator.opcodeIndex = self._operations.index(kind)
        operator.inputs, operator.outputs = inputs, [self._new(shape)]
        name = type(options).__name__.removesuffix("T")
        operator.builtinOptionsType = getattr(self._lite.BuiltinOptions, name)
        operator.builtinOptions = options
        self._graph.operators.append(operator)
        return int(operator.outputs[0])

    def _new(self, shape: Sequence[int], values: np.ndarray | None = None) -> int:
        """A new tensor: with values a constant one."""
        tensor = self._lite.TensorT()
        tensor.shape, tensor.name = list(shape), f"tensor{len(self._graph.tensors)}"
        is_whole = values is not None and values.dtype.kind == "i"
        tensor.type = self._lite.TensorType.INT32 if is_whole else self._lite.TensorType.FLOAT32
        tensor.buffer = 0  # the empty one
        if values is not None:
            buffer = self._lite.BufferT()
            buffer.data = np.frombuffer(np.ascontiguousarray(values).tobytes(), np.uint8)
            tensor.buffer = len(self._buffers)
            self._buffers.append(buffer)
        self._graph.tensors.append(tensor)
        return len(self._graph.tensors) - 1


def inputs_of(node: Node) -> list[str]:
    """Names of the nodes whose results a node takes."""
    return [name.split(":")[0] for name in node["input"] if not name.startswith("^")]
