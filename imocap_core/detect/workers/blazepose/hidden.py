"""Joints that are hidden behind another person."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from .landmarks import SIZE, Landmarks

IN_MASK = 0.5
STILL_VISIBLE = 0.1  # share of the visibility that a hidden joint keeps


def with_hidden(bodies: Sequence[Landmarks]) -> list[Landmarks]:
    """The bodies, with less visibility where a joint lies on another's pixels and not its own."""
    return [
        replace(body, visibility=np.where(hidden(body, bodies), STILL_VISIBLE, 1) * body.visibility)
        for body in bodies
    ]


def hidden(body: Landmarks, people: Sequence[Landmarks]) -> np.ndarray:
    """Which of a body's joints (33,) lie on the pixels of other people, and not on its own."""
    others = [share_there(other, body.xy_px) for other in people if other is not body]
    if not others:
        return np.zeros(len(body.xy_px), bool)
    covered = np.max(others, axis=0) > IN_MASK
    return np.asarray(covered & (share_there(body, body.xy_px) < IN_MASK))


def share_there(body: Landmarks, points: np.ndarray) -> np.ndarray:
    """A body's mask at points (N, 2) of the picture, 0 outside its crop."""
    crop = body.crop
    cells = np.linalg.solve(crop.axes, (points - (crop.x, crop.y)).T).T + 0.5
    columns, rows = np.floor(cells * SIZE).astype(int).T
    inside = (columns >= 0) & (columns < SIZE) & (rows >= 0) & (rows < SIZE)
    share = body.mask[rows.clip(0, SIZE - 1), columns.clip(0, SIZE - 1)]
    return np.asarray(np.where(inside, share, 0.0))
