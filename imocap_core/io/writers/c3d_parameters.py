"""The parameter section of a C3D file (c3d.org): groups of named, typed arrays.

Little-endian ("Intel") throughout. Names and group names are upper case, at most 127 characters;
a dimension is at most 255, so that longer lists of labels continue in LABELS2, LABELS3.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

BLOCK = 512
INTEL = 84
MOST = 255  # of a dimension
Value = str | int | float | Sequence[str] | np.ndarray
"""Text, a 16-bit integer, a float, a list of texts, or an array of floats or 16-bit integers
(first dimension fastest, as C3D has it)."""


@dataclass(frozen=True)
class Group:
    """A group of parameters: by name, in the order of the file."""

    description: str
    parameters: Mapping[str, Value]


def parameter_section(groups: Mapping[str, Group]) -> bytes:
    """All groups as whole blocks of 512 bytes; ValueError where they need more than 255."""
    records = b""
    for number, (name, group) in enumerate(groups.items(), start=1):
        records += _record(-number, name, b"", group.description)
        for parameter, value in group.parameters.items():
            records += _record(number, parameter, _encoded(value), "")
    records += b"\0\0"
    count = -(-(4 + len(records)) // BLOCK)
    if count > MOST:
        raise ValueError(f"C3D parameters: expected at most {MOST} blocks, got {count}")
    return (bytes([1, 80, count, INTEL]) + records).ljust(count * BLOCK, b"\0")


def long_list(name: str, texts: Sequence[str]) -> dict[str, Value]:
    """A list of texts as one parameter for every 255 of them: NAME, NAME2, NAME3."""
    parts = [texts[first : first + MOST] for first in range(0, len(texts), MOST)] or [texts]
    return {name + (str(k) if k > 1 else ""): part for k, part in enumerate(parts, start=1)}


def _record(group: int, name: str, value: bytes, description: str) -> bytes:
    """A group (negative number) or a parameter: its name, the way to the next, its content."""
    content = value + bytes([len(_ascii(description))]) + _ascii(description)
    label = _ascii(name)
    return (
        struct.pack("<bb", len(label), group)
        + label
        + struct.pack("<h", 2 + len(content))
        + content
    )


def _encoded(value: Value) -> bytes:
    """Type (bytes of an element, -1 for text), dimensions, data."""
    if isinstance(value, str):
        return struct.pack("<bBB", -1, 1, len(_ascii(value))) + _ascii(value)
    if isinstance(value, int):
        return struct.pack("<bBH", 2, 0, value)
    if isinstance(value, float):
        return struct.pack("<bBf", 4, 0, value)
    if isinstance(value, np.ndarray):
        kind, size = ("<f4", 4) if value.dtype.kind == "f" else ("<u2", 2)
        shape = bytes(value.shape[::-1])
        return struct.pack("<bB", size, value.ndim) + shape + value.astype(kind).tobytes()
    texts = [_ascii(text) for text in value]
    width = max((len(text) for text in texts), default=0)
    data = b"".join(text.ljust(width) for text in texts)
    return struct.pack("<bBBB", -1, 2, width, len(texts)) + data


def _ascii(text: str) -> bytes:
    """At most 127 characters of ASCII."""
    return text.encode("ascii", "replace")[:127]
