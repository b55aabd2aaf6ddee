"""OpenPose's hands: `hand_left_keypoints_2d` and `hand_right_keypoints_2d` of one person."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from imocap_core.io.detectors.frame_files import numbered_files
from imocap_core.io.detectors.people import read_json

FIELDS = ("hand_left_keypoints_2d", "hand_right_keypoints_2d")
POINTS = 21


def read_openpose_hands(
    folder: Path, frames: Int[np.ndarray, " T"], body_xy_px: Float[np.ndarray, "T K 2"]
) -> tuple[Float[np.ndarray, "T 2 21 2"], Float[np.ndarray, "T 2 21"]] | None:
    """The hands of the person whose body is given: pixels and confidence.

    Args:
        folder: one JSON file per frame, the one that `read_openpose` read.
        frames: source frame numbers.
        body_xy_px: the person's body from `read_openpose`, NaN where missing.

    Returns:
        Left hand first; NaN and 0 for missing points. None when no frame has a hand.

    Raises:
        ValueError: file, field, expected, got.
    """
    files = numbered_files(folder)
    hands = np.full((len(frames), 2, POINTS, 3), (np.nan, np.nan, 0.0))
    for t, frame in enumerate(frames.tolist()):
        if frame not in files or not np.isfinite(body_xy_px[t]).any():
            continue
        people = read_json(files[frame])["people"]
        k = _nearest(people, body_xy_px[t])
        if k is not None:
            hands[t] = [_hand(files[frame], k, people[k], field) for field in FIELDS]
    if not (hands[..., 2] > 0).any():
        return None
    return hands[..., :2], hands[..., 2]


def _nearest(people: list[Any], body: Float[np.ndarray, "K 2"]) -> int | None:
    """Index of the person whose points have the smallest median distance to the body's."""
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


def _hand(file: Path, k: int, person: dict[str, Any], field: str) -> Float[np.ndarray, "21 3"]:
    """One hand; a person without the field, or with an empty list, has no such hand."""
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
    missing = ~np.isfinite(hand).all(axis=1) | (hand[:, 2] <= 0)
    return np.where(missing[:, None], nothing, hand)
