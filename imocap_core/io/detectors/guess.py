"""Format and layout of keypoint files, recognised from their content."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from imocap_core.body.layouts import layout_names
from imocap_core.io.detectors.frame_files import frame_files
from imocap_core.io.detectors.guess_file import Guess, guess_file, guess_frames, guess_labels
from imocap_core.io.detectors.people import cleaned, read_json

Person = Float[np.ndarray, "K 3"]  # x, y (pixels), confidence

FILES_LOOKED_AT = 60
TELL = "say which with `format` and `layout` in action.yaml (imocap sync: --format and --layout)"
MIN_MISFIT_RATIO = 2.0  # of the second best layout to the best, to accept the best
COUNTS = {
    17: ("coco17",),
    18: ("coco18",),
    25: ("body25", "body25b"),
    26: ("halpe26",),
    33: ("mediapipe33",),
    133: ("wholebody133",),
    136: ("halpe136",),
}
# Points that lie (nearly) in the middle of two others, in each layout of 25 points.
MIDDLES: dict[str, tuple[tuple[str, str, str], ...]] = {
    "body25": (("neck", "left_shoulder", "right_shoulder"), ("mid_hip", "left_hip", "right_hip")),
    "body25b": (
        ("upper_neck", "left_shoulder", "right_shoulder"),
        ("nose", "left_eye", "right_eye"),
    ),
}


def guess_detections(path: Path, *, layout: str | None = None) -> tuple[str, str]:
    """(format, layout) of a folder or file of keypoints.

    layout: given by the user; then only the format is recognised.

    Raises:
        ValueError: the format is unknown, or more than one layout fits; the message says which
            options to give.
    """
    if path.is_dir():
        kind, file_layout, people = _guess_folder(path)
    else:
        kind, file_layout, people = guess_file(path)
    if kind is None:
        raise ValueError(
            f"{path}: the format is unknown: docs/formats.md lists those that are read; {TELL}, or "
            f"save the points as an npz with keypoints (frames, people, points, 3)"
        )
    if not (layout or file_layout or people or path.is_dir()):
        raise ValueError(
            f"{path}: the format is {kind}, but the file does not tell the layout; {TELL}"
        )
    return kind, layout or file_layout or layout_of(path, people)


def _guess_folder(path: Path) -> Guess:
    files = frame_files(path)
    labels = frame_files(path, ".txt")
    if not files and labels:
        return guess_labels(labels[:: max(1, len(labels) // FILES_LOOKED_AT)])
    if not files:
        raise ValueError(
            f"{path}: expected a folder with one JSON file per frame, as OpenPose writes it, found "
            "no .json file"
        )
    step = max(1, len(files) // FILES_LOOKED_AT)
    contents = [read_json(file) for file in files[::step]]
    if all(isinstance(c, dict) and isinstance(c.get("people"), list) for c in contents):
        return "openpose", None, list(_people(contents))
    guess = guess_frames(path, contents)
    if guess[0] is None:
        raise ValueError(
            f"{path}: expected OpenPose's JSON (a list `people` in every file), got something "
            f"else; {TELL}"
        )
    return guess


def layout_of(path: Path, people: Sequence[Person]) -> str:
    """The layout of some people, by the number and the positions of their points.

    ValueError when none fits, or several do.
    """
    counts = sorted({len(person) for person in people})
    if not counts:
        raise ValueError(
            f"{path}: nobody was detected in the {FILES_LOOKED_AT} frames read, so the layout is "
            f"unknown; {TELL}"
        )
    if len(counts) > 1 or counts[0] not in COUNTS:
        expected = ", ".join(f"{n} ({' or '.join(ls)})" for n, ls in COUNTS.items())
        raise ValueError(
            f"{path}: expected {expected} points per person, got {', '.join(map(str, counts))}; "
            f"keep one detector's output per folder; {TELL}"
        )
    fitting = COUNTS[counts[0]]
    if len(fitting) == 1:
        return fitting[0]
    misfits = {name: _misfit(name, np.stack(people)) for name in fitting}
    best, second = sorted(misfits, key=lambda name: misfits[name])
    if not misfits[best] * MIN_MISFIT_RATIO < misfits[second]:
        raise ValueError(
            f"{path}: 25 points per person are BODY_25 or BODY_25B, and the detections fit both "
            f"about equally; {TELL}"
        )
    return best


def _misfit(layout: str, people: Float[np.ndarray, "P K 3"]) -> float:
    """Median distance of the layout's middle points from the middle of their neighbours, as a share
    of the person's size; infinite when they were never detected together."""
    names = layout_names(layout)
    xy = cleaned(people)[..., :2]
    low, high = np.nanmin(xy, axis=1), np.nanmax(xy, axis=1)
    size = np.linalg.norm(high - low, axis=-1)
    far = []
    for point, a, b in MIDDLES[layout]:
        middle, left, right = (xy[:, names.index(name)] for name in (point, a, b))
        far.append(np.linalg.norm(middle - (left + right) / 2, axis=-1) / np.maximum(size, 1e-9))
    distances = np.concatenate(far)
    distances = distances[np.isfinite(distances)]
    return float(np.median(distances)) if len(distances) else float("inf")


def _people(contents: Sequence[Any]) -> Iterator[Person]:
    """Each person of some OpenPose files who has a detected point."""
    for content in contents:
        for person in content["people"]:
            values = person.get("pose_keypoints_2d") if isinstance(person, dict) else None
            if isinstance(values, list) and values and len(values) % 3 == 0:
                try:
                    body = np.array(values, dtype=np.float64).reshape(-1, 3)
                except (TypeError, ValueError):
                    continue
                if (body[:, 2] > 0).any():
                    yield body
