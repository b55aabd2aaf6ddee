"""ONNX models written by hand, of the inputs and outputs that rtmlib's have: protobuf by fields.

Field numbers are those of ONNX's schema (onnx.proto3).
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

FLOAT, INT64 = 1, 7
INT, INTS = 2, 7
INPUT = "input"


def person_model(file: Path, side: int, boxes: np.ndarray) -> Path:
    """Always these boxes (N, 4), as sure of them as the picture (1, 3, side, side) is bright."""
    count = len(boxes)
    constants = {
        "boxes": boxes[None].astype(np.float32),
        "row": np.array([1, 1, 1]),
        "each": np.full((1, count, 1), 1 / 255, np.float32),
    }
    nodes = [
        _node("ReduceMean", [INPUT], "mean", _attribute("axes", [1, 2, 3])),
        _node("Reshape", ["mean", "row"], "one"),
        _node("Mul", ["one", "each"], "scores"),
        _node("Concat", ["boxes", "scores"], "dets", _attribute("axis", 2)),
    ]
    return _write(file, (1, 3, side, side), nodes, constants, {"dets": (1, count, 5)})


def pose_model(file: Path, size: tuple[int, int], points: np.ndarray) -> Path:
    """Always these points (K, 2), shares of the picture (1, 3, height, width) it is given, as two
    peaks each over twice as many places as there are pixels."""
    width, height = size
    shapes = {"simcc_x": (1, len(points), 2 * width), "simcc_y": (1, len(points), 2 * height)}
    constants = {}
    for axis, (name, shape) in enumerate(shapes.items()):
        peaks = np.zeros(shape, np.float32)
        peaks[0, np.arange(len(points)), (points[:, axis] * shape[2]).astype(int)] = 0.75
        constants[f"{name}_peaks"] = peaks
    nodes = [_node("Identity", [f"{name}_peaks"], name) for name in shapes]
    return _write(file, (1, 3, height, width), nodes, constants, shapes)


def _write(
    file: Path,
    given: Sequence[int],
    nodes: Sequence[bytes],
    constants: dict[str, np.ndarray],
    results: dict[str, tuple[int, ...]],
) -> Path:
    graph = b"".join(_bytes(1, node) for node in nodes) + _bytes(2, b"made")
    graph += b"".join(_bytes(5, _tensor(name, value)) for name, value in constants.items())
    graph += _bytes(11, _value(INPUT, given))
    graph += b"".join(_bytes(12, _value(name, shape)) for name, shape in results.items())
    file.write_bytes(_number(1, 8) + _bytes(7, graph) + _bytes(8, _number(2, 13)))
    return file


def _node(kind: str, inputs: Sequence[str], output: str, *attributes: bytes) -> bytes:
    message = b"".join(_bytes(1, name.encode()) for name in inputs) + _bytes(2, output.encode())
    message += _bytes(4, kind.encode())
    return message + b"".join(_bytes(5, attribute) for attribute in attributes)


def _attribute(name: str, value: int | list[int]) -> bytes:
    if isinstance(value, int):
        return _bytes(1, name.encode()) + _number(3, value) + _number(20, INT)
    return _bytes(1, name.encode()) + b"".join(_number(8, v) for v in value) + _number(20, INTS)


def _tensor(name: str, value: np.ndarray) -> bytes:
    message = b"".join(_number(1, side) for side in value.shape)
    message += _number(2, FLOAT if value.dtype == np.float32 else INT64)
    return message + _bytes(8, name.encode()) + _bytes(9, value.tobytes())


def _value(name: str, shape: Sequence[int]) -> bytes:
    sides = b"".join(_bytes(1, _number(1, side)) for side in shape)
    tensor = _number(1, FLOAT) + _bytes(2, sides)
    return _bytes(1, name.encode()) + _bytes(2, _bytes(1, tensor))


def _number(field: int, value: int) -> bytes:
    return _varint(field << 3) + _varint(value)


def _bytes(field: int, value: bytes) -> bytes:
    return _varint(field << 3 | 2) + _varint(len(value)) + value


def _varint(value: int) -> bytes:
    encoded = bytearray()
    while value >= 128:
        encoded.append(value & 127 | 128)
        value >>= 7
    return bytes([*encoded, value])
