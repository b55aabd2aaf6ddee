"""The readers of 2D keypoints by name; format and layout recognised from the files."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from imocap_core.body.layouts import layout_names
from imocap_core.io.array_files import read_object
from imocap_core.io.npz import array_names, load_arrays
from imocap_core.io.readers import json_people, mediapipe
from imocap_core.io.readers.estimates import POINTS_2D
from imocap_core.io.readers.keypoint_arrays import LAYOUT as SAM3D_LAYOUT
from imocap_core.io.readers.keypoint_arrays import (
    WITH_HANDS,
    people_last,
    read_cpn_npz,
    read_keypoints_npz,
    read_sam3d_keypoints,
)
from imocap_core.io.readers.people import (
    JSON_LINES,
    LAYOUT_OF_COUNT,
    TABLES,
    DetectedPeople,
    cleaned,
    frame_files,
    read_csv,
    read_json,
)

LOOKED_AT = 60  # entries of a list, or files of a folder
FORMS = {  # by whose entries the layout is told
    "openpose": json_people.OPENPOSE,
    "easymocap": json_people.EASYMOCAP,
    "alphapose": json_people.COCO,
    "pictures": json_people.PICTURES,
    "coco": json_people.COCO,
    "mmpose": json_people.MMPOSE,
    "ultralytics": json_people.ULTRALYTICS,
}
_LAYOUTS = {"mediapipe": "mediapipe33", "sam3d_body": SAM3D_LAYOUT}  # that the format tells
_LAYOUT_NAMES = {"coco": "coco17", "h36m": "h36m17"}  # in VideoPose3D's metadata

Person = Float[np.ndarray, "K 3"]  # x, y (pixels), confidence
Guess = tuple[str | None, str | None, list[Person]]


def _guess_file(path: Path) -> Guess:
    """(format, layout, people): layout None where only the number of points tells it; people: some
    who have a detected point. ValueError when the file cannot be read or used."""
    suffix = path.suffix.lower()
    if suffix == ".npz":
        return _guess_npz(path)
    if suffix == ".npy":
        return _guess_npy(path)
    if suffix in TABLES:
        return _guess_csv(path)
    if suffix in (".json", *JSON_LINES):
        return _guess_json(path)
    return None, None, []


def _guess_json(path: Path) -> Guess:
    content = read_json(path)
    if isinstance(content, dict) and "people" in content:
        raise ValueError(
            f"{path}: is one frame of OpenPose's output; name the folder with all frames"
        )
    entries = json_people.list_in(content)
    by_picture = isinstance(entries, dict) and not set(json_people.LISTS) & set(entries)
    entries = list(entries.values()) if by_picture else entries
    entries = entries[:LOOKED_AT] if isinstance(entries, list) else []
    places = [f"{path}: [{n}]" for n in range(len(entries))]
    kind = next((kind for entry in entries if (kind := _kind_of(entry))), None)
    if by_picture:
        kind = "pictures" if kind in ("openpose", "pictures") else None
    return _guess_entries(kind, entries, places)


def _kind_of(entry: Any) -> str | None:
    """The format (of `FORMS`, or mediapipe, or sam3d_body) that a frame, or a person, is of."""
    fields: dict[str, Any] = entry if isinstance(entry, dict) else {}
    people = json_people.people_of(entry)
    people = people if isinstance(people, list) else []
    persons = [
        p for p in (fields, *people, *(json_people.people_in(entry) or ())) if isinstance(p, dict)
    ]
    of_result = "image_id" in fields
    boxed = bool({"box", "idx"} & set(fields)) or isinstance(fields.get("image_id"), str)
    kinds = {
        "mediapipe": mediapipe.is_landmarks(people) or any(map(mediapipe.is_landmarks, people)),
        "ultralytics": any(map(json_people.is_person, people)),
        "mmpose": "instances" in fields or any("keypoint_scores" in p for p in persons),
        "sam3d_body": any(POINTS_2D in p for p in persons),
        "openpose": json_people.people_in(entry) is not None,
        "easymocap": isinstance(fields.get("annots"), list),
        "pictures": isinstance(fields.get("bodies"), list),
        "alphapose": of_result and boxed,
        "coco": of_result,
    }
    named = bool({*mediapipe.PICTURE, *mediapipe.WORLD} & set(fields))
    return next((k for k, fits in kinds.items() if fits), "mediapipe" if named else None)


def _guess_entries(kind: str | None, entries: Sequence[Any], places: Sequence[str]) -> Guess:
    """With the people of some entries. ValueError when none of these is as it should be."""
    if kind is None or kind in _LAYOUTS:
        return kind, _LAYOUTS.get(kind or ""), []
    people: list[Person] = []
    faults: list[ValueError] = []
    for number, (entry, where) in enumerate(zip(entries, places, strict=True)):
        try:
            _, of_entry = FORMS[kind].people(entry, number, where)
        except ValueError as fault:
            faults.append(fault)
            continue
        people += [person for values, _ in of_entry for person in _detected(values)]
    if faults and not people:
        raise faults[0]
    whole_body = any(isinstance(entry, dict) and "foot_kpts" in entry for entry in entries)
    layout = "wholebody133" if whole_body else None
    return "alphapose" if kind == "pictures" else kind, layout, people


def _guess_labels(files: Sequence[Path]) -> Guess:
    """The same of some of Ultralytics' label files."""
    for row, _ in (row for file in files for row in json_people.rows_of(file)):
        for count in (17, 26, 133):
            person = json_people.points_in(row, count)
            if person is not None:
                return "ultralytics", None, [person]
    return None, None, []


def _detected(values: Any) -> Iterator[Person]:
    """The person as floats, if the entries are numbers and a point was detected."""
    try:
        body = np.array(values, dtype=np.float64).reshape(-1, 3)
    except (TypeError, ValueError):
        return
    if body.size and (body[:, 2] > 0).any():
        yield body


def _guess_npz(path: Path) -> Guess:
    names = array_names(path)
    if "positions_2d" in names:
        metadata = read_object(path, "metadata") if "metadata" in names else {}
        layout = metadata.get("layout_name") if isinstance(metadata, dict) else None
        return "cpn_npz", _LAYOUT_NAMES.get(str(layout)), []
    if "keypoints" in names:
        table = load_arrays(path)["keypoints"]
        count = table.shape[-2] if table.ndim in (3, 4) else 0
        return "npz", None, [np.ones((count, 3))] if count else []
    if names & {*mediapipe.PICTURE, *mediapipe.WORLD}:
        return "mediapipe", "mediapipe33", []
    return None, None, []


def _guess_npy(path: Path) -> Guess:
    table = people_last(load_arrays(path)["keypoints"])
    if table.ndim not in (3, 4):
        return None, None, []
    count = table.shape[-2]
    if count not in LAYOUT_OF_COUNT and count >= WITH_HANDS:
        return "npz", "mediapipe33", []
    return "npz", None, [np.ones((count, 3))]


def _guess_csv(path: Path) -> Guess:
    heading = read_csv(path)[0]
    if (points := mediapipe.points_of_csv(path)) is not None:
        return "npz", points[1], list(points[0]["keypoints"][:LOOKED_AT])
    of_mediapipe = mediapipe.landmark_columns(heading) is not None
    return ("mediapipe", "mediapipe33", []) if of_mediapipe else (None, None, [])


TELL = "say which with `format` and `layout` in action.yaml (imocap sync: --format and --layout)"
UNKNOWN = (
    f"the format is unknown: `imocap formats` lists those that are read; {TELL}, or save the "
    "points as an npz with keypoints (frames, people, points, 3)"
)
_MOTION = "is a file of 3D motion, and 2D keypoints are expected, which its detector can save"
_RESULT = (
    "is no detector's file; a monocular estimate is given as `initial`, beside 2D keypoints (SAM "
    "3D Body's may be these, too, with `format: sam3d_body`)"
)
_VIDEO = "is a video; name it as `video` and write `keypoints: detect`"
OTHERS = {  # what files that are not read are, by their suffix
    **dict.fromkeys((".trc", ".c3d", ".bvh", ".mot", ".fbx"), _MOTION),
    **dict.fromkeys((".pkl", ".pickle", ".pt", ".pth", ".joblib"), _RESULT),
    **dict.fromkeys((".mp4", ".mov", ".avi", ".mkv", ".webm"), _VIDEO),
    **dict.fromkeys((".zip", ".gz", ".7z", ".rar", ".tar", ".tgz"), "is packed; unpack it first"),
    **dict.fromkeys((".xlsx", ".xls", ".ods"), "is a spreadsheet; save it as CSV"),
    ".xml": "is an annotation; export it as COCO keypoints (CVAT: COCO Keypoints 1.0)",
}
MIN_MISFIT_RATIO = 2.0  # of the second best layout to the best, to accept the best
COUNTS = {n: (name,) for n, name in LAYOUT_OF_COUNT.items()} | {25: ("body25", "body25b")}
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
        kind, file_layout, people = _guess_file(path)
    if kind is None:
        raise ValueError(f"{path}: {OTHERS.get(path.suffix.lower(), UNKNOWN)}")
    if not (layout or file_layout or people or path.is_dir()):
        raise ValueError(
            f"{path}: the format is {kind}, but the file does not tell the layout; {TELL}"
        )
    return kind, layout or file_layout or _layout_of(path, people)


def _guess_folder(path: Path) -> Guess:
    files = frame_files(path)
    labels = frame_files(path, ".txt")
    if not files and labels:
        return _guess_labels(labels[:: max(1, len(labels) // LOOKED_AT)])
    if not files:
        inside = sorted(f.name for f in path.iterdir() if f.is_dir() and frame_files(f))
        raise ValueError(
            f"{path}: expected a folder with one JSON file per frame, as OpenPose writes it, found "
            + (f"folders of them; name one: {', '.join(inside[:6])}" if inside else "no .json file")
        )
    step = max(1, len(files) // LOOKED_AT)
    contents = [read_json(file) for file in files[::step]]
    nobody = [isinstance(c, list) and _kind_of(c) is None for c in contents]
    kinds = {_kind_of(c) for c, empty in zip(contents, nobody, strict=True) if not empty}
    kind = kinds.pop() if len(kinds) == 1 else None
    if kind in ("ultralytics", "mediapipe", "sam3d_body"):
        raise ValueError(f"{path}: put the frames' lists into one JSON list, in their order")
    if kind is None:
        raise ValueError(
            f"{path}: expected OpenPose's JSON (a list `people` in every file), got something "
            f"else; {TELL}"
        )
    return _guess_entries(kind, contents, [str(file) for file in files[::step]])


def _layout_of(path: Path, people: Sequence[Person]) -> str:
    """The layout of some people, by the number and the positions of their points.

    ValueError when none fits, or several do.
    """
    counts = sorted({len(person) for person in people})
    if not counts:
        raise ValueError(
            f"{path}: nobody was detected in the {LOOKED_AT} frames read, so the layout is "
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


READERS: dict[str, Callable[[Path, str], DetectedPeople]] = {
    "openpose": partial(json_people.read_people, json_people.OPENPOSE),
    "alphapose": json_people.read_alphapose,
    "mmpose": json_people.read_mmpose,
    "coco": json_people.read_coco,
    "easymocap": partial(json_people.read_people, json_people.EASYMOCAP),
    "ultralytics": json_people.read_ultralytics,
    "npz": read_keypoints_npz,
    "sam3d_body": read_sam3d_keypoints,
}
# Layouts whose files may have any form: RTMLib and others write OpenPose's JSON, COCO's results
# or npz.
ANY_FILE = {"halpe26": "halpe26", "wholebody": "wholebody133"}
FORMATS = (*READERS, "mediapipe", "cpn_npz", *ANY_FILE)


def format_and_layout(path: Path, kind: str | None, layout: str | None) -> tuple[str, str]:
    """(format, layout); what is not given is recognised from the files. ValueError when it cannot
    be."""
    if kind in ANY_FILE:
        layout, kind = layout or ANY_FILE[kind], None
    if kind == "sam3d_body":  # of any file's kind, pickles too
        layout = layout or SAM3D_LAYOUT
    if kind is not None and layout is not None:
        return kind, layout
    guessed_kind, guessed_layout = guess_detections(path, layout=layout)
    return kind or guessed_kind, guessed_layout


def read_detections(
    path: Path, kind: str, layout: str, *, size: tuple[int, int], names: Sequence[str]
) -> DetectedPeople:
    """All people of all frames.

    Args:
        kind, layout: as `format_and_layout` returns them.
        size: width and height of the picture, for keypoints in shares of them.
        names: the video's id and file name, for files with several clips.

    Raises:
        ValueError: file, field, expected, got, what to do.
    """
    if kind == "mediapipe":
        return mediapipe.read_mediapipe(path, layout, size)
    if kind == "cpn_npz":
        return read_cpn_npz(path, layout, names)
    if kind not in READERS:
        raise ValueError(f"{path}: format: expected one of {', '.join(FORMATS)}, got {kind!r}")
    return READERS[kind](path, layout)
