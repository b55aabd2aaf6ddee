"""Letterbox bars: black borders of a picture, which all its shots may share."""

from __future__ import annotations

import numpy as np
from jaxtyping import UInt8

DARK = 24  # grey level: no pixel of a bar is brighter
LEAST_AREA = 0.2  # of the picture: what is left is its content, else all of it is dark


def content(gray: UInt8[np.ndarray, "H W"]) -> tuple[slice, slice]:
    """Rows and columns of a picture without its bars; all of them where it is dark everywhere."""
    bright = gray > DARK
    rows, columns = (np.flatnonzero(bright.any(axis=axis)) for axis in (1, 0))
    if not len(rows):
        return slice(0, gray.shape[0]), slice(0, gray.shape[1])
    inside = slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
    area = (inside[0].stop - inside[0].start) * (inside[1].stop - inside[1].start)
    if area < LEAST_AREA * gray.size:
        return slice(0, gray.shape[0]), slice(0, gray.shape[1])
    return inside


def without_bars(gray: UInt8[np.ndarray, "H W"]) -> UInt8[np.ndarray, "H W"]:
    """The picture with its bars as bright as its content on average: they have no contrast."""
    inside = content(gray)
    filled = np.full_like(gray, round(float(gray[inside].mean())))
    filled[inside] = gray[inside]
    return filled
