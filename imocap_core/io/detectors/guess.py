"""Which detector wrote some keypoints, and which layout they have, by what is in the files."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from imocap_core.body.layouts import layout_names
from imocap_core.io.detectors.guess_file import guess_file
from imocap_core.io.detectors.people import cleaned, read_json

Array = NDArray[np.float64]

FILES_LOOKED_AT = 60
CLEARLY = 2.0  # one layout fits this many times better than the other
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

    layout: what the user says it is; then only the format is looked for.

    Raises:
        ValueError: nothing known is found, or more than one layout fits; the sentence says what to
            give by hand.
    """
    if not path.is_dir():
        kind, found, people = guess_file(path)
        if kind is None or not (layout or found or people):
            what = (
                "not known" if kind is None else f"{kind}, but its layout is not told by the file"
            )
            raise ValueError(f"{path}: the format is {what}; give --format and --layout")
        return kind, layout or found or layout_of(path, people)
    files = sorted(path.glob("*.json"))
    if not files:
        raise ValueError(
            f"{path}: expected a folder with one JSON file a frame, as OpenPose writes it, found "
            "no .json file"
        )
    step = max(1, len(files) // FILES_LOOKED_AT)
    contents = [read_json(file) for file in files[::step]]
    if not all(isinstance(c, dict) and isinstance(c.get("people"), list) for c in contents):
        raise ValueError(
            f"{path}: expected OpenPose's JSON (a list `people` in every file), got something "
            "else; say what it is with --format and --layout"
        )
    return "openpose", layout or layout_of(path, list(_people(contents)))


def layout_of(path: Path, people: Sequence[Array]) -> str:
    """The layout of some people (K, 3), by their number of points and where these are."""
    counts = sorted({len(person) for person in people})
    if not counts:
        raise ValueError(
            f"{path}: nobody was detected in the {FILES_LOOKED_AT} frames looked at, so the layout "
            "can't be told; give it with --layout"
        )
    if len(counts) > 1 or counts[0] not in COUNTS:
        known = ", ".join(f"{n} ({' or '.join(ls)})" for n, ls in COUNTS.items())
        raise ValueError(
            f"{path}: expected {known} points a person, got {', '.join(map(str, counts))}; keep "
            "one detector's output in a folder, and say what it is with --format and --layout"
        )
    fitting = COUNTS[counts[0]]
    if len(fitting) == 1:
        return fitting[0]
    misfits = {name: _misfit(name, np.stack(people)) for name in fitting}
    best, second = sorted(misfits, key=lambda name: misfits[name])
    if not misfits[best] * CLEARLY < misfits[second]:
        raise ValueError(
            f"{path}: 25 points a person are BODY_25 or BODY_25B, and the detections fit both "
            "about as well; say which with --layout body25 or --layout body25b"
        )
    return best


def _misfit(layout: str, people: Array) -> float:
    """How far the points that should lie in the middle of two others are from there, share of the
    person's size; `people` (P, K, 3); infinite where they were never seen together."""
    names = layout_names(layout)
    seen = cleaned(people)[..., :2]
    low, high = np.nanmin(seen, axis=1), np.nanmax(seen, axis=1)
    size = np.linalg.norm(high - low, axis=-1)
    far = []
    for point, a, b in MIDDLES[layout]:
        at, one, other = (seen[:, names.index(name)] for name in (point, a, b))
        far.append(np.linalg.norm(at - (one + other) / 2, axis=-1) / np.maximum(size, 1e-9))
    known = np.concatenate(far)
    known = known[np.isfinite(known)]
    return float(np.median(known)) if len(known) else float("inf")


def _people(contents: Sequence[Any]) -> Iterator[Array]:
    """Each person (K, 3) of some OpenPose files that has a seen point."""
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
