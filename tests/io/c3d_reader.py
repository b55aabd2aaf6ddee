"""A plain reader of C3D files, after c3d.org, to check the writer with."""

import struct
from typing import Any

import numpy as np

BLOCK = 512


def read_c3d(content: bytes) -> tuple[dict[str, Any], np.ndarray]:
    """Header and parameters by GROUP:NAME, and the points (T, N, 4)."""
    at, key, points, _, first, last, _ = struct.unpack("<BBHHHHH", content[:12])
    assert key == 80
    scale, data_start, _, fps = struct.unpack("<fHHf", content[12:24])
    values: dict[str, Any] = {"first": first, "last": last, "fps": fps, "scale": scale}
    values |= _parameters(content[(at - 1) * BLOCK :])
    assert values["POINT:DATA_START"] == data_start
    numbers = np.frombuffer(content[(data_start - 1) * BLOCK :], dtype="<f4")
    count = last - first + 1
    return values, numbers[: count * points * 4].reshape(count, points, 4)


def _parameters(section: bytes) -> dict[str, Any]:
    one, key, blocks, kind = section[:4]
    assert (one, key, kind) == (1, 80, 84)
    groups, values, at = {}, {}, 4
    while section[at]:
        length, group = struct.unpack("<bb", section[at : at + 2])
        name = section[at + 2 : at + 2 + length].decode()
        at += 2 + length
        (following,) = struct.unpack("<h", section[at : at + 2])
        if group < 0:
            groups[-group] = name
        else:
            values[f"{groups[group]}:{name}"] = _value(section[at + 2 : at + following])
        at += following
        assert at < blocks * BLOCK
    return values


def _value(content: bytes) -> Any:
    size, dimensions = struct.unpack("<bB", content[:2])
    shape = tuple(content[2 : 2 + dimensions])
    count = int(np.prod(shape, dtype=int))
    data = content[2 + dimensions : 2 + dimensions + count * abs(size)]
    if size == -1:
        width = shape[0]
        texts = [data[k : k + width].decode().rstrip() for k in range(0, len(data), width or 1)]
        return texts[0] if dimensions == 1 else texts
    numbers = np.frombuffer(data, dtype={1: "u1", 2: "<u2", 4: "<f4"}[size])
    return numbers[0] if dimensions == 0 else numbers.reshape(shape[::-1])
