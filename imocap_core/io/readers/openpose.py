"""A folder with one JSON file a frame: OpenPose, with hands, and EasyMocap.

OpenPose: a folder with one JSON file per frame, each with any number of people. Or one file with
the list of all frames, as DWPose's and other nodes of ComfyUI save it.

OpenPose's hands: `hand_left_keypoints_2d` and `hand_right_keypoints_2d` of one person.

EasyMocap: a folder ``annots/CAMERA`` with one JSON file a frame.

Each file has ``annots``, a list of people with ``keypoints`` [[x, y, confidence], ...], BODY_25
unless another model was chosen.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from imocap_core.io.readers.people import (
    DetectedPeople,
    detections,
    flat_points,
    listed,
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
    if not folder.exists():
        raise ValueError(
            f"{folder}: expected a folder with one OpenPose JSON file per frame, found none (no "
            "such file or folder); check `keypoints` in action.yaml"
        )
    people, faults = {}, []
    for number, (content, where) in _frames(folder).items():
        try:
            people[number] = _read_frame(content, layout, where)
        except ValueError as fault:
            faults.append(str(fault))
    if faults and folder.is_file():
        raise ValueError(faults[0])
    if faults:
        more = len(faults) - _FAULTS_SHOWN
        shown = faults[:_FAULTS_SHOWN] + ([f"and {more} more such files"] if more > 0 else [])
        raise ValueError("\n".join(shown))
    return DetectedPeople(np.array(sorted(people), dtype=np.int64), tuple(people.values()))


def _frames(path: Path) -> dict[int, tuple[Any, str]]:
    """Frame number -> its file or its content, and what messages call it."""
    if path.is_dir():
        return {number: (file, str(file)) for number, file in numbered_files(path).items()}
    frames = listed(
        read_json(path),
        path,
        "a folder with one OpenPose JSON file per frame, or one file with a list of all frames",
        "check `keypoints` in action.yaml",
    )
    return {number: (content, f"{path}: [{number}]") for number, content in enumerate(frames)}


def _people(content: Any, where: str) -> list[Any]:
    """The people of one frame, from its file or as they are."""
    content = read_json(content) if isinstance(content, Path) else content
    people = people_in(content)
    if people is None:
        got = content.get("people") if isinstance(content, dict) else None
        raise ValueError(f"{where}: people: expected a list of people, got {type_name(got)}")
    return people


def people_in(content: Any) -> list[Any] | None:
    """The people of a frame's content, nobody for null; None where it is something else."""
    if not isinstance(content, dict) or "people" not in content:
        return None
    people = [] if content["people"] is None else content["people"]
    return people if isinstance(people, list) else None


def numbers_of(person: Any) -> Any:
    """The numbers of a person's body; OpenPose 1.0 called them otherwise."""
    if not isinstance(person, dict):
        return None
    return person.get("pose_keypoints_2d", person.get("pose_keypoints"))


def _read_frame(content: Any, layout: str, where: str) -> Float[np.ndarray, "P K 3"]:
    bodies = [
        flat_points(values, layout, f"{where}: people[{i}].pose_keypoints_2d")
        for i, person in enumerate(_people(content, where))
        if (values := numbers_of(person)) != []  # OpenPose's of a person without a body
    ]
    return np.stack(bodies) if bodies else np.zeros((0, POINTS[layout], 3))


FIELDS = ("hand_left_keypoints_2d", "hand_right_keypoints_2d")
HAND_POINTS = 21


def read_openpose_hands(
    folder: Path, frames: Int[np.ndarray, " T"], body_xy_px: Float[np.ndarray, "T K 2"]
) -> tuple[Float[np.ndarray, "T 2 21 2"], Float[np.ndarray, "T 2 21"]] | None:
    """The hands of the person whose body is given: pixels and confidence.

    Args:
        folder: the one that `read_openpose` read.
        frames: source frame numbers.
        body_xy_px: the person's body from `read_openpose`, NaN where missing.

    Returns:
        Left hand first; NaN and 0 for missing points. None when no frame has a hand.

    Raises:
        ValueError: file, field, expected, got.
    """
    contents = _frames(folder)
    hands = np.full((len(frames), 2, HAND_POINTS, 3), (np.nan, np.nan, 0.0))
    for t, frame in enumerate(frames.tolist()):
        if frame not in contents or not np.isfinite(body_xy_px[t]).any():
            continue
        content, where = contents[frame]
        people = _people(content, where)
        k = _nearest(people, body_xy_px[t])
        if k is not None:
            hands[t] = [
                _hand(people[k], field, f"{where}: people[{k}].{field}") for field in FIELDS
            ]
    if not (hands[..., 2] > 0).any():
        return None
    return hands[..., :2], hands[..., 2]


def _nearest(people: list[Any], body: Float[np.ndarray, "K 2"]) -> int | None:
    """Index of the person whose points have the smallest median distance to the body's."""
    best, least = None, np.inf
    for k, person in enumerate(people):
        values = numbers_of(person) or []
        if len(values) != 3 * len(body):
            continue
        points = np.array(values, dtype=np.float64).reshape(-1, 3)
        both = (points[:, 2] > 0) & np.isfinite(body).all(axis=1)
        if both.any():
            away = float(np.median(np.linalg.norm(points[both, :2] - body[both], axis=1)))
            if away < least:
                best, least = k, away
    return best


def _hand(person: dict[str, Any], field: str, where: str) -> Float[np.ndarray, "21 3"]:
    """One hand; a person without the field, or with an empty list, has no such hand."""
    values = person.get(field) or []
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
        annots = content.get("annots") if isinstance(content, dict) else None
        people[number] = [
            points(
                person.get("keypoints") if isinstance(person, dict) else None,
                layout,
                f"{where}: annots[{n}].keypoints",
            )
            for n, person in enumerate(listed(annots, f"{where}: annots", "a list of people"))
        ]
    return detections(people, layout, path)
