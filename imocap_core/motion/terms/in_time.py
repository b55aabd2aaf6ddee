"""Neighbouring frames: which exist, and values shifted in time; and a motion in pieces."""

from __future__ import annotations

from collections.abc import Iterator

import torch
from jaxtyping import Bool, Float
from torch import Tensor

PIECE = 256  # frames whose derivatives are held at once: 0.1 GB


def pieces(frames: int) -> Iterator[slice]:
    """The frames of a motion, `PIECE` at a time."""
    for first in range(0, frames, PIECE):
        yield slice(first, min(first + PIECE, frames))


def pairs(valid: Bool[Tensor, "B T"]) -> Bool[Tensor, "B steps"]:
    """Which pairs of neighbouring frames exist (T - 1)."""
    return valid[:, :-1] & valid[:, 1:]


def triples(valid: Bool[Tensor, "B T"]) -> Bool[Tensor, "B bends"]:
    """Which three frames in a row exist (T - 2)."""
    return valid[:, :-2] & valid[:, 1:-1] & valid[:, 2:]


def padded(x: Float[Tensor, "B N *rest"], before: int, after: int) -> Float[Tensor, "B T *rest"]:
    """Values with ``before`` and ``after`` zeros around them in time."""
    return torch.nn.functional.pad(x, [0] * (2 * (x.ndim - 2)) + [before, after])
