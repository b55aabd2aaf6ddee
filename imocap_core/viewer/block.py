"""The viewer's bytes: arrays one after another in a block, and entries in JSON that find them."""

from __future__ import annotations

import base64
from typing import Any

import numpy as np
from jaxtyping import Int16
from numpy.typing import ArrayLike

ALIGNED = 8
Entry = dict[str, Any]


class Block:
    """Collects arrays; `add` returns what web/data.js turns into a typed array."""

    def __init__(self) -> None:
        self._parts: list[bytes] = []
        self._size = 0

    def add(self, values: ArrayLike, kind: str) -> Entry:
        """Append an array as little-endian f4, i2, i4, u1, u2 or u4, flat; its entry.

        ValueError when a whole number does not fit the kind.
        """
        given = np.asarray(values).ravel()
        array = given.astype(f"<{kind}")
        if array.dtype.kind in "iu" and not np.array_equal(array, given):
            limits = np.iinfo(array.dtype)
            raise ValueError(
                f"values: expected whole numbers from {limits.min} to {limits.max} for {kind}, "
                f"got {given.min()} to {given.max()}"
            )
        padding = -self._size % ALIGNED
        self._parts += [bytes(padding), array.tobytes()]
        offset = self._size + padding
        self._size = offset + array.nbytes
        return {"$": kind, "at": offset, "count": len(array)}

    def base64(self) -> str:
        """Everything, as text for the page."""
        return base64.b64encode(b"".join(self._parts)).decode("ascii")


def quantised(values: ArrayLike) -> tuple[Int16[np.ndarray, "..."], float]:
    """Finite numbers as 16-bit integers, and the number that 32767 represents.

    The error is at most scale / 65534.
    """
    array = np.asarray(values, dtype=np.float64)
    if not np.isfinite(array).all():
        raise ValueError("values: expected finite numbers, got some that are not")
    scale = float(np.abs(array).max(initial=1e-9))
    return np.round(array / scale * 32767).astype(np.int16), scale
