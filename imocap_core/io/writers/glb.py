"""Binary glTF 2.0 (GLB) container: a JSON tree and one block of numbers that it refers to."""

from __future__ import annotations

import json
import struct
from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Shaped

MAGIC, VERSION = b"glTF", 2
JSON_CHUNK, BINARY_CHUNK = b"JSON", b"BIN\0"
COMPONENTS = {"float32": 5126, "uint32": 5125, "uint16": 5123, "uint8": 5121}
KINDS = {(): "SCALAR", (2,): "VEC2", (3,): "VEC3", (4,): "VEC4", (4, 4): "MAT4"}
VERTICES, INDICES = 34962, 34963  # purpose of a buffer view


class Numbers:
    """The binary block, to which arrays are appended; each is an accessor, named by its index."""

    def __init__(self) -> None:
        self.data = bytearray()
        self.views: list[dict[str, Any]] = []
        self.accessors: list[dict[str, Any]] = []

    def add(
        self, array: Shaped[np.ndarray, "N ..."], *, bounds: bool = False, target: int | None = None
    ) -> int:
        """Append (N,), (N, 2|3|4) or (N, 4, 4) (row-major matrices); returns the accessor's index.

        bounds: write minimum and maximum, which glTF requires for positions and times. ValueError
        for another type or shape.
        """
        name, shape = array.dtype.name, array.shape[1:]
        if name not in COMPONENTS or shape not in KINDS or not len(array):
            raise ValueError(
                f"array: expected one or more of {', '.join(COMPONENTS)} in rows of "
                f"{', '.join(KINDS.values())}, got {name} {array.shape}"
            )
        columns = array.swapaxes(1, 2) if shape == (4, 4) else array  # glTF: column by column
        self.data += bytes(-len(self.data) % 4)
        view: dict[str, Any] = {"buffer": 0, "byteOffset": len(self.data)}
        little = np.ascontiguousarray(columns, dtype=array.dtype.newbyteorder("<"))
        self.data += little.tobytes()
        view["byteLength"] = little.nbytes
        if target is not None:
            view["target"] = target
        self.views.append(view)
        accessor: dict[str, Any] = {
            "bufferView": len(self.views) - 1,
            "componentType": COMPONENTS[name],
            "count": len(array),
            "type": KINDS[shape],
        }
        if bounds:
            rows = little.reshape(len(array), -1)
            accessor["min"] = rows.min(0).tolist()
            accessor["max"] = rows.max(0).tolist()
        self.accessors.append(accessor)
        return len(self.accessors) - 1


def glb_bytes(tree: Mapping[str, Any], numbers: Numbers) -> bytes:
    """The file: a header, the JSON chunk, the binary chunk, each padded to four bytes."""
    block = bytes(numbers.data) + bytes(-len(numbers.data) % 4)
    whole = dict(tree)
    whole["accessors"], whole["bufferViews"] = numbers.accessors, numbers.views
    whole["buffers"] = [{"byteLength": len(numbers.data)}]
    text = json.dumps(whole, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I", len(text)) + JSON_CHUNK + text
    chunks += struct.pack("<I", len(block)) + BINARY_CHUNK + block
    return MAGIC + struct.pack("<II", VERSION, 12 + len(chunks)) + chunks
