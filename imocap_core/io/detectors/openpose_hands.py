"""OpenPose's hands: `hand_left_keypoints_2d` and `hand_right_keypoints_2d` of one person."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

FIELDS = ("hand_left_keypoints_2d", "hand_right_keypoints_2d")
POINTS = 21
Array = NDArray[np.float64]


def read_openpose_hands(
    folder: Path, frames: NDArray[np.int64], body_xy_px: Array
) -> tuple[Array, Array] | None:
    """The hands of one person, told by the body: pixels (T, 2, 21, 2), confidence (T, 2, 21).

    Args:
        folder: one JSON file a frame, which `read_openpose` has read.
        frames: (T,) source frame numbers.
        body_xy_px: (T, K, 2) the person's body as `read_openpose` gave it, NaN where unseen.

    Returns:
        Left hand first; NaN and 0 for what was not found. None when no frame has any hand.

    Raises:
        ValueError: file, field, expected, got.
    """
    files = {int(re.findall(r"\d+", file.stem)[-1]): file for file in folder.glob("*.json")}
    found = np.full((len(frames), 2, POINTS, 3), (np.nan, np.nan, 0.0))
    for t, frame in enumerate(frames.tolist()):
        if frame not in files or not np.isfinite(body_xy_px[t]).any():
            continue
        people = json.loads(files[frame].read_text(encoding="utf-8"))["people"]
        k = _nearest(people, body_xy_px[t])
        if k is not None:
            found[t] = [_hand(files[frame], k, people[k], field) for field in FIELDS]
    if not (found[..., 2] > 0).any():
        return None
    return found[..., :2], found[..., 2]


def _nearest(people: list[Any], body: Array) -> int | None:
    """Whose body this is: the person whose points are nearest to it in the median."""
    best, least = None, np.inf
    for k, person in enumerate(people):
        values = person.get("pose_keypoints_2d") or []
        if len(values) != 3 * len(body):
            continue
        points = np.array(values, dtype=np.float64).reshape(-1, 3)
        both = (points[:, 2] > 0) & np.isfinite(body).all(axis=1)
        if both.any():
            away = float(np.median(np.linalg.norm(points[both, :2] - body[both], axis=1)))
            if away < least:
                best, least = k, away
    return best


def _hand(file: Path, k: int, person: dict[str, Any], field: str) -> Array:
    """(21, 3); a person without the field, or with an empty list, has no such hand."""
    values = person.get(field) or []
    where = f"{file}: people[{k}].{field}"
    nothing = np.full((POINTS, 3), (np.nan, np.nan, 0.0))
    if not isinstance(values, list) or len(values) not in (0, 3 * POINTS):
        got = len(values) if isinstance(values, list) else type(values).__name__
        raise ValueError(
            f"{where}: expected {3 * POINTS} numbers (x, y, confidence of 21 points) or none, "
            f"got {got}; run the detector again"
        )
    if not values:
        return nothing
    try:
        hand = np.array(values, dtype=np.float64).reshape(POINTS, 3)
    except (TypeError, ValueError):
        raise ValueError(f"{where}: expected numbers only, got {values!r:.60}") from None
    unseen = ~np.isfinite(hand).all(axis=1) | (hand[:, 2] <= 0)
    return np.where(unseen[:, None], nothing, hand)
