"""2D keypoints of people in JSON, an entry a frame or a person: one reader, and a `Form` a format.

OpenPose: a folder with one JSON file per frame, or one file with the list of all frames, as
DWPose's and other nodes of ComfyUI save it. The frame number is the last number in a file's name
(``clip_000000000012_keypoints.json`` and ``clip.0012.json`` are frame 12); a frame without a file
is a frame without people. Its hands are `hand_left_keypoints_2d` and `hand_right_keypoints_2d`.

EasyMocap: a folder ``annots/CAMERA`` with one JSON file a frame. Each has ``annots``, a list of
people with ``keypoints`` [[x, y, confidence], ...], BODY_25 unless another model was chosen.

COCO's results, AlphaPose, MMPose, Ultralytics: docs/formats.md names the files and the fields.
Confidences of heat maps may exceed 1 and then count as 1; an annotation's visibility (0 not
labelled, 1 hidden, 2 visible) as 0, 1 and 1.

AlphaPose's other forms (``--format cmu`` and ``open``) are a dictionary by picture name with
``bodies`` (``joints``) or ``people`` (``pose_keypoints_2d``) of 18 points, and the same as a folder
``sep-json`` with one file a picture.

MMPose's demos count frames from 1, its inferencer from 0: a list that starts at frame 1 and skips
none counts from 1. What the inferencer returns, saved as it is, is a list of frames that are lists
of people, or a ``predictions`` or a list of one such list; of a folder of pictures, one such list a
file.

Ultralytics' JSON has one entry a frame, a list of people (or its text) with ``keypoints`` {x, y,
visible}, pixels or shares of the picture. Its labels are a folder with a file a frame that has
people, ``NAME_1.txt`` of the first frame of a video; each row is a class, a box and x, y
(, confidence) of the points as shares, then possibly a confidence and a track.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from jaxtyping import Float, Int

from imocap_core.body.layouts import layout_names
from imocap_core.io.readers.people import (
    DetectedPeople,
    cleaned,
    detections,
    frame_number,
    listed,
    must_have_layout,
    numbered_files,
    points,
    read_json,
    short,
    type_name,
)
from imocap_core.limits import must_be_small_enough

Entry = tuple[int, Any, str]  # number, content (in a folder the file), and where it is
People = tuple[int, list[tuple[Any, str]]]  # frame; every person's points, and where they are


@dataclass(frozen=True)
class Form:
    """A format of JSON files: what messages call it, its layouts, and the people of an entry.

    people: of an entry's content, number and place. flat: points are numbers x, y, confidence, x,
    ..., else rows. folder: whether a folder has them, one file an entry. one_file: what a single
    file is expected to be, and advice where it is not.
    """

    name: str
    layouts: tuple[str, ...]
    people: Callable[[Any, int, str], People]
    flat: bool = False
    folder: Literal["no", "may be", "as a rule"] = "may be"
    one_file: tuple[str, str] = ("a list with one entry a frame", "")


LISTS = ("annotations", "instance_info", "frames")  # fields that a file's list may be in
_FAULTS_SHOWN = 5


def _entries_of(path: Path, form: Form) -> list[Entry]:
    """The entries of a file, or the files of a folder. ValueError where there are none."""
    if path.is_dir() and form.folder != "no":
        files = numbered_files(path, what=form.name)
        return [(number, file, str(file)) for number, file in files.items()]
    if form.folder == "as a rule" and not path.exists():
        raise ValueError(
            f"{path}: expected a folder with one {form.name} JSON file per frame, found none (no "
            "such file or folder); check `keypoints` in action.yaml"
        )
    content = list_in(read_json(path))
    if form is PICTURES and isinstance(content, dict):
        places = {name: f"{path}: {short(name)}" for name in content}
        return [(frame_number(name, places[name]), c, places[name]) for name, c in content.items()]
    entries = listed(content, path, *form.one_file)
    return [(number, entry, f"{path}: [{number}]") for number, entry in enumerate(entries)]


def list_in(content: Any) -> Any:
    """The list of a file that has it in a field, other content as it is."""
    fields = content if isinstance(content, dict) else {}
    return next((fields[name] for name in LISTS if isinstance(fields.get(name), list)), content)


def read_people(form: Form, path: Path, layout: str) -> DetectedPeople:
    """All people of all frames. ValueError names file, field, expected and got; of a folder the
    faults of the first files."""
    must_have_layout(form.layouts, layout, form.name, path)
    people: dict[int, list[Float[np.ndarray, "K 3"]]] = {}
    faults: list[str] = []
    for number, content, where in _entries_of(path, form):
        try:
            content = read_json(content) if isinstance(content, Path) else content
            frame, of_frame = form.people(content, number, where)
            people.setdefault(frame, []).extend(
                points(values, layout, place, flat=form.flat) for values, place in of_frame
            )
        except ValueError as fault:
            if path.is_file():
                raise
            faults.append(str(fault))
    if faults:
        more = len(faults) - _FAULTS_SHOWN
        shown = faults[:_FAULTS_SHOWN] + ([f"and {more} more such files"] if more > 0 else [])
        raise ValueError("\n".join(shown))
    return detections(people, layout, path, maybe_nobody=form is OPENPOSE)


def _field(value: Any, name: str, default: Any = None) -> Any:
    return value.get(name, default) if isinstance(value, dict) else None


def people_in(content: Any) -> list[Any] | None:
    """The people of OpenPose's content of a frame, nobody for null; None where it is something
    else."""
    if not isinstance(content, dict) or "people" not in content:
        return None
    people = [] if content["people"] is None else content["people"]
    return people if isinstance(people, list) else None


def _numbers_of(person: Any) -> Any:
    """The numbers of a person's body; OpenPose 1.0 called them otherwise."""
    return _field(person, "pose_keypoints_2d", _field(person, "pose_keypoints"))


def _of_openpose(entry: Any, number: int, where: str) -> People:
    people = people_in(entry)
    if people is None:
        got = type_name(_field(entry, "people"))
        raise ValueError(f"{where}: people: expected a list of people, got {got}")
    return number, [
        (values, f"{where}: people[{i}].pose_keypoints_2d")
        for i, person in enumerate(people)
        if (values := _numbers_of(person)) != []  # of a person without a body
    ]


def _of_easymocap(entry: Any, number: int, where: str) -> People:
    people = listed(_field(entry, "annots"), f"{where}: annots", "a list of people")
    return number, [
        (_field(person, "keypoints"), f"{where}: annots[{n}].keypoints")
        for n, person in enumerate(people)
    ]


def _of_coco(entry: Any, number: int, where: str) -> People:
    if not isinstance(entry, dict):
        raise ValueError(f"{where}: expected one person's fields, got {type_name(entry)}")
    frame = frame_number(entry.get("image_id"), f"{where}.image_id")
    return frame, [(entry.get("keypoints"), f"{where}.keypoints")]


_MORE_PARTS = ("foot_kpts", "face_kpts", "lefthand_kpts", "righthand_kpts")


def _of_whole_body(entry: Any, number: int, where: str) -> People:
    """As of COCO, all parts of a whole body concatenated."""
    frame, [(body, place)] = _of_coco(entry, number, where)
    if _MORE_PARTS[0] in entry and isinstance(body, list):
        parts = [entry.get(name) for name in _MORE_PARTS]
        body = [*body, *(x for part in parts if isinstance(part, list) for x in part)]
    return frame, [(body, place)]


PERSON_FIELDS = {"bodies": "joints", "people": "pose_keypoints_2d"}


def _of_picture(entry: Any, number: int, where: str) -> People:
    name = next((n for n in PERSON_FIELDS if _field(entry, n) is not None), None)
    people = None if name is None else entry[name]
    if name is None or not isinstance(people, list):
        raise ValueError(f"{where}: expected `bodies` or `people`, got {type_name(people)}")
    return number, [
        (_field(person, PERSON_FIELDS[name]), f"{where}.{name}[{n}]")
        for n, person in enumerate(people)
    ]


def people_of(entry: Any) -> Any:
    """The people of a frame, whose entry may be text, one person, a list of their list, or a
    dictionary of somebody's own with one list."""
    if isinstance(entry, str):
        try:
            return json.loads(entry)
        except (ValueError, RecursionError):
            return None
    if isinstance(entry, dict) and "keypoints" in entry:
        return [entry]
    if isinstance(entry, dict) and "instances" not in entry:
        lists = [value for value in entry.values() if isinstance(value, list)]
        entry = entry.get("predictions", lists[0] if len(lists) == 1 else entry)
    nested = isinstance(entry, list) and len(entry) == 1 and isinstance(entry[0], list)
    return entry[0] if nested else entry


def _of_mmpose(entry: Any, number: int, where: str) -> People:
    entry = people_of(entry)
    entry = {"instances": entry} if isinstance(entry, list) else entry
    people = listed(_field(entry, "instances"), f"{where}.instances", "a list of people")
    places = [f"{where}.instances[{n}]" for n in range(len(people))]
    return frame_number(entry.get("frame_id", number), f"{where}.frame_id"), [
        (_with_scores(person, place), f"{place}.keypoints")
        for person, place in zip(people, places, strict=True)
    ]


def _with_scores(person: Any, where: str) -> Float[np.ndarray, "K 3"]:
    xy, scores = _field(person, "keypoints"), _field(person, "keypoint_scores")
    if not isinstance(xy, list) or not isinstance(scores, list) or len(xy) != len(scores):
        got = [str(len(v)) if isinstance(v, list) else type_name(v) for v in (xy, scores)]
        raise ValueError(
            f"{where}: expected keypoints [[x, y], ...] and as many keypoint_scores, got "
            f"{' and '.join(got)}"
        )
    try:
        return np.column_stack([np.array(xy, float).reshape(len(xy), -1)[:, :2], scores])
    except (TypeError, ValueError):
        raise ValueError(f"{where}.keypoints: expected numbers only, got {short(xy)}") from None


NUMBERS = ("frame", "frame_id", "frame_idx", "frame_index", "frame_number", "image_id")


def _of_ultralytics(entry: Any, number: int, where: str) -> People:
    people = people_of(entry)
    if not isinstance(people, list):
        raise ValueError(f"{where}: expected a list of people, got {short(entry)}")
    name = next((n for n in NUMBERS if isinstance(entry, dict) and n in entry), None)
    frame = number if name is None else frame_number(entry[name], f"{where}.{name}")
    places = [f"{where}[{n}].keypoints" for n in range(len(people))]
    return frame, [(_columns(p, w), w) for p, w in zip(people, places, strict=True)]


def is_person(entry: Any) -> bool:
    """Whether an entry is a person of Ultralytics."""
    keypoints = _field(entry, "keypoints")
    return isinstance(keypoints, dict) and {"x", "y"} <= set(keypoints)


def _columns(person: Any, where: str) -> Float[np.ndarray, "K 3"]:
    try:
        keypoints = person["keypoints"]
        x, y = (np.array(keypoints[name], float) for name in "xy")
        visible = np.array(keypoints.get("visible", np.ones(len(x))), float)
        return np.stack([x, y, visible], axis=-1)
    except (TypeError, ValueError, LookupError, AttributeError):
        raise ValueError(
            f"{where}: expected x, y and visible of the points, got {short(person)}"
        ) from None


OPENPOSE = Form(
    "OpenPose",
    ("body25", "body25b", "coco18", "coco17", "halpe26", "wholebody133"),
    _of_openpose,
    flat=True,
    folder="as a rule",
    one_file=(
        "a folder with one OpenPose JSON file per frame, or one file with a list of all frames",
        "check `keypoints` in action.yaml",
    ),
)
_RESULTS = "'s list of results", "name the file with the whole clip"
COCO = Form(
    "COCO",
    ("coco17", "halpe26", "body25", "coco18", "wholebody133", "halpe136"),
    _of_coco,
    flat=True,
    folder="no",
    one_file=(f"COCO{_RESULTS[0]}", _RESULTS[1]),
)
ALPHAPOSE = replace(COCO, name="AlphaPose", one_file=(f"AlphaPose{_RESULTS[0]}", _RESULTS[1]))
PICTURES = replace(ALPHAPOSE, people=_of_picture, folder="may be")
MMPOSE = Form(
    "MMPose",
    ("coco17", "halpe26", "wholebody133", "h36m17", "body25", "coco18"),
    _of_mmpose,
    one_file=("a list with one entry per frame", "save the predictions of the whole video"),
)
EASYMOCAP = Form(
    "EasyMocap", ("body25", "coco17", "halpe26", "wholebody133"), _of_easymocap, folder="as a rule"
)
ULTRALYTICS = Form("Ultralytics", ("coco17", "halpe26", "wholebody133"), _of_ultralytics)


def read_openpose(path: Path, layout: str) -> DetectedPeople:
    """All people of all frames; errors as of `read_people`."""
    return read_people(OPENPOSE, path, layout)


def read_coco(path: Path, layout: str, form: Form = COCO) -> DetectedPeople:
    """All people of all frames in a results file; errors as of `read_people`."""
    people = _of_whole_body if layout == "wholebody133" else _of_coco
    return read_people(replace(form, people=people), path, layout)


def read_alphapose(path: Path, layout: str) -> DetectedPeople:
    """All people of all frames in a results file, or a folder of them; errors as of
    `read_people`."""
    if path.is_dir() or isinstance(list_in(read_json(path)), dict):
        return read_people(PICTURES, path, layout)
    return read_coco(path, layout, ALPHAPOSE)


def read_mmpose(path: Path, layout: str) -> DetectedPeople:
    """All people of all frames of a predictions file; errors as of `read_people`."""
    people = read_people(MMPOSE, path, layout)
    from_one = people.frames.tolist() == list(range(1, len(people.frames) + 1))
    return replace(people, frames=people.frames - 1) if from_one and path.is_file() else people


def read_ultralytics(path: Path, layout: str) -> DetectedPeople:
    """All people of all frames; errors as of `read_people`."""
    if not path.is_dir():
        return read_people(ULTRALYTICS, path, layout)
    must_have_layout(ULTRALYTICS.layouts, layout, ULTRALYTICS.name, path)
    files = numbered_files(path, ".txt", ULTRALYTICS.name)
    count = len(layout_names(layout))
    first = min(min(files), 1)  # of a video they count from 1
    people: dict[int, list[Float[np.ndarray, "K 3"]]] = {}
    for n, file in files.items():
        people[n - first] = []
        for row, where in rows_of(file):
            person = points_in(row, count)
            if person is None:
                raise ValueError(
                    f"{where}: expected a class, a box and {count} points, got {len(row)} numbers; "
                    f"run a pose model, and check `layout` in action.yaml"
                )
            people[n - first].append(person)
    return detections(people, layout, path)


def rows_of(file: Path) -> list[tuple[list[float], str]]:
    """The rows of numbers of a labels file, and where they are."""
    must_be_small_enough(file)
    try:
        lines = file.read_text(encoding="utf-8-sig").splitlines()
        rows = [[float(word) for word in line.split()] for line in lines]
    except ValueError as error:
        raise ValueError(f"{file}: expected rows of numbers: {error}") from None
    return [(row, f"{file}: row {n}") for n, row in enumerate(rows, start=1) if row]


BEFORE, AFTER = 5, 2  # numbers in a row before the points, and at most after them


def points_in(row: list[float], count: int) -> Float[np.ndarray, "K 3"] | None:
    """x, y, confidence of `count` points in a row; None where it has another number of them."""
    for width in (3, 2):
        after = len(row) - BEFORE - width * count
        if 0 <= after <= AFTER:
            table = np.array(row[BEFORE : BEFORE + width * count]).reshape(count, width)
            visible = table[:, 2] if width == 3 else (table != 0).any(axis=1)
            return cleaned(np.column_stack([table[:, :2], visible]))
    return None


HANDS = ("hand_left_keypoints_2d", "hand_right_keypoints_2d")
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
    contents = {
        number: (content, where) for number, content, where in _entries_of(folder, OPENPOSE)
    }
    hands = np.full((len(frames), 2, HAND_POINTS, 3), (np.nan, np.nan, 0.0))
    for t, frame in enumerate(frames.tolist()):
        if frame not in contents or not np.isfinite(body_xy_px[t]).any():
            continue
        content, where = contents[frame]
        content = read_json(content) if isinstance(content, Path) else content
        _of_openpose(content, frame, where)  # its errors
        people = people_in(content) or []
        k = _nearest(people, body_xy_px[t])
        if k is not None:
            hands[t] = [_hand(people[k], name, f"{where}: people[{k}].{name}") for name in HANDS]
    if not (hands[..., 2] > 0).any():
        return None
    return hands[..., :2], hands[..., 2]


def _nearest(people: list[Any], body: Float[np.ndarray, "K 2"]) -> int | None:
    """Index of the person whose points have the smallest median distance to the body's."""
    best, least = None, np.inf
    for k, person in enumerate(people):
        values = _numbers_of(person) or []
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
    if not isinstance(values, list) or len(values) not in (0, 3 * HAND_POINTS):
        got = len(values) if isinstance(values, list) else type(values).__name__
        raise ValueError(
            f"{where}: expected {3 * HAND_POINTS} numbers (x, y, confidence of 21 points) or none, "
            f"got {got}; run the detector again"
        )
    nothing = np.full((HAND_POINTS, 3), (np.nan, np.nan, 0.0))
    if not values:
        return nothing
    try:
        hand = np.array(values, dtype=np.float64).reshape(HAND_POINTS, 3)
    except (TypeError, ValueError):
        raise ValueError(f"{where}: expected numbers only, got {values!r:.60}") from None
    missing = ~np.isfinite(hand).all(axis=1) | (hand[:, 2] <= 0)
    return np.where(missing[:, None], nothing, hand)
