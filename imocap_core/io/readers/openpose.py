"""A folder with one JSON file a frame: OpenPose, with hands, and EasyMocap.

Each file has ``annots``, a list of people with ``keypoints`` [[x, y, confidence], ...] (BODY_25
unless another model was chosen); boxes, ids, hands and faces are not used.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from imocap_core.io.readers.people import (
    DetectedPeople,
    detections,
    must_have_layout,
    numbered_contents,
    numbered_files,
    points,
    read_json,
    type_name,
)

POINTS = {"body25": 25, "body25b": 25, "coco18": 18}  # points of each layout of OpenPose,
POINTS |= {"coco17": 17, "halpe26": 26, "wholebody133": 133}  # and of other tools in its format
_FAULTS_SHOWN = 5


def read_openpose(folder: Path, layout: str) -> DetectedPeople:
    """All people of all frames. ValueError names file, field, expected and got.

    The frame number is the last number in a file's name (``clip_000000000012_keypoints.json`` and
    ``clip.0012.json`` are frame 12); a frame without a file is a frame without people.
    """
    if layout not in POINTS:
        layouts = ", ".join(POINTS)
        raise ValueError(f"{folder}: OpenPose layouts are {layouts}, got {layout!r} in action.yaml")
    if not folder.is_dir():
        raise ValueError(
            f"{folder}: expected a folder with one OpenPose JSON file per frame, found none; "
            "check `keypoints` in action.yaml"
        )
    files = numbered_files(folder)
    people, faults = {}, []
    for number, file in sorted(files.items()):
        try:
            people[number] = _read_frame(file, layout)
        except ValueError as fault:
            faults.append(str(fault))
    if faults:
        more = len(faults) - _FAULTS_SHOWN
        shown = faults[:_FAULTS_SHOWN] + ([f"and {more} more such files"] if more > 0 else [])
        raise ValueError("\n".join(shown))
    return DetectedPeople(np.array(sorted(people), dtype=np.int64), tuple(people.values()))


def _read_frame(file: Path, layout: str) -> Float[np.ndarray, "P K 3"]:
    content = read_json(file)
    people = content.get("people") if isinstance(content, dict) else None
    if not isinstance(people, list):
        raise ValueError(f"{file}: people: expected a list of people, got {type_name(people)}")
    bodies = [_read_person(file, i, person, layout) for i, person in enumerate(people)]
    present = [body for body in bodies if body is not None]
    return np.stack(present) if present else np.zeros((0, POINTS[layout], 3))


def _read_person(file: Path, i: int, person: Any, layout: str) -> Float[np.ndarray, "K 3"] | None:
    """The points, or None for a person without a body (OpenPose then writes an empty list)."""
    where = f"{file}: people[{i}].pose_keypoints_2d"
    values = person.get("pose_keypoints_2d") if isinstance(person, dict) else None
    if not isinstance(values, list):
        raise ValueError(f"{where}: expected a list of numbers, got {type_name(values)}")
    if not values:
        return None
    expected = 3 * POINTS[layout]
    if len(values) != expected:
        fitting = " or ".join(name for name, k in POINTS.items() if 3 * k == len(values))
        advice = f"set layout: {fitting} in action.yaml" if fitting else "check the detector"
        raise ValueError(
            f"{where}: expected {expected} numbers (x, y, confidence of the {POINTS[layout]} "
            f"points of {layout}), got {len(values)}; {advice}"
        )
    try:
        body = np.array(values, dtype=np.float64).reshape(-1, 3)
    except (TypeError, ValueError):
        raise ValueError(f"{where}: expected numbers only, got {values!r:.60}") from None
    missing = ~np.isfinite(body).all(axis=1) | (body[:, 2] <= 0)
    body[missing] = (np.nan, np.nan, 0.0)
    return body


FIELDS = ("hand_left_keypoints_2d", "hand_right_keypoints_2d")
HAND_POINTS = 21


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
    hands = np.full((len(frames), 2, HAND_POINTS, 3), (np.nan, np.nan, 0.0))
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
    nothing = np.full((HAND_POINTS, 3), (np.nan, np.nan, 0.0))
    if not isinstance(values, list) or len(values) not in (0, 3 * HAND_POINTS):
        got = len(values) if isinstance(values, list) else type(values).__name__
        raise ValueError(
            f"{where}: expected {3 * HAND_POINTS} numbers (x, y, confidence of 21 points) or none, "
            f"got {got}; run the detector again"
        )
    if not values:
        return nothing
    try:
        hand = np.array(values, dtype=np.float64).reshape(HAND_POINTS, 3)
    except (TypeError, ValueError):
        raise ValueError(f"{where}: expected numbers only, got {values!r:.60}") from None
    missing = ~np.isfinite(hand).all(axis=1) | (hand[:, 2] <= 0)
    return np.where(missing[:, None], nothing, hand)


LAYOUTS = ("body25", "coco17", "halpe26", "wholebody133")


def read_easymocap(path: Path, layout: str) -> DetectedPeople:
    """All people of all frames. ValueError names file, field, expected and got."""
    must_have_layout(LAYOUTS, layout, "EasyMocap", path)
    if not path.is_dir():
        raise ValueError(f"{path}: expected EasyMocap's folder annots/CAMERA, with a file a frame")
    people = {}
    for number, content, where in numbered_contents(path, "EasyMocap"):
        listed = content.get("annots") if isinstance(content, dict) else None
        if not isinstance(listed, list):
            raise ValueError(f"{where}: annots: expected a list of people, got {type_name(listed)}")
        people[number] = [
            points(
                person.get("keypoints") if isinstance(person, dict) else None,
                layout,
                f"{where}: annots[{n}].keypoints",
            )
            for n, person in enumerate(listed)
        ]
    return detections(people, layout, path)
