"""Format and layout of one file with the keypoints of a whole clip."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from imocap_core.io.detectors.alphapose import PERSON_FIELDS
from imocap_core.io.detectors.deeplabcut import body_parts, read_csv
from imocap_core.io.detectors.keypoints_npz import WITH_HANDS
from imocap_core.io.detectors.mediapipe import PICTURE, WORLD
from imocap_core.io.detectors.mediapipe_csv import is_long, landmark_columns
from imocap_core.io.detectors.part_names import best_layout
from imocap_core.io.detectors.people import LAYOUT_OF_COUNT, read_json
from imocap_core.io.detectors.sam3d_body import LAYOUT as SAM3D_LAYOUT
from imocap_core.io.detectors.sam3d_body import is_sam3d
from imocap_core.io.detectors.sleap import FRAME, nodes
from imocap_core.io.detectors.sleap_h5 import h5_nodes
from imocap_core.io.detectors.ultralytics import is_person, people_of, points_in, rows_of
from imocap_core.io.hdf5 import is_hdf5
from imocap_core.io.npz import array_names, load_arrays
from imocap_core.io.object_npz import read_object

PEOPLE_LOOKED_AT = 60
_LAYOUT_NAMES = {"coco": "coco17", "h36m": "h36m17"}  # in VideoPose3D's metadata

Person = Float[np.ndarray, "K 3"]  # x, y (pixels), confidence
Guess = tuple[str | None, str | None, list[Person]]


def guess_file(path: Path) -> Guess:
    """(format, layout, people): layout None where only the number of points tells it; people: some
    who have a detected point. ValueError when the file cannot be read or used."""
    suffix = path.suffix.lower()
    if suffix == ".npz":
        return _guess_npz(path)
    if suffix == ".npy":
        return _guess_npy(path)
    if suffix == ".csv":
        return _guess_csv(path)
    if is_hdf5(path):
        return _guess_h5(path)
    if suffix == ".json":
        return _guess_json(path)
    return None, None, []


def _guess_json(path: Path) -> Guess:
    content = read_json(path)
    if isinstance(content, dict) and "people" in content:
        raise ValueError(
            f"{path}: is one frame of OpenPose's output; name the folder with all frames"
        )
    if isinstance(content, dict) and "instance_info" in content:
        return "mmpose", None, list(_mmpose(content["instance_info"]))
    if isinstance(content, dict) and (people := _by_picture(content)):
        return "alphapose", None, people
    listed = content
    if isinstance(content, dict):
        listed = content.get("frames", content.get("annotations"))
    first = next((e for e in listed if isinstance(e, dict)), {}) if isinstance(listed, list) else {}
    if isinstance(listed, list) and (kind := _of_lists(listed)):
        return kind
    if is_sam3d(listed):
        return "sam3d_body", SAM3D_LAYOUT, []
    if "image_id" in first:
        alphapose = "box" in first or "idx" in first or isinstance(first["image_id"], str)
        layout = "wholebody133" if "foot_kpts" in first else None
        return "alphapose" if alphapose else "coco", layout, list(_coco(listed))
    if "instances" in first:
        return "mmpose", None, list(_mmpose(listed))
    if any(name in first for name in (*PICTURE, *WORLD)):
        return "mediapipe", "mediapipe33", []
    return None, None, []


def guess_frames(path: Path, contents: Sequence[Any]) -> Guess:
    """The same of some of the JSON files of a folder, one a frame."""
    if all(isinstance(c, dict) and isinstance(c.get("annots"), list) for c in contents):
        people = [q for c in contents for q in _listed(c["annots"], "keypoints")]
        return "easymocap", None, people
    if all(isinstance(c, dict) and isinstance(c.get("bodies"), list) for c in contents):
        return "alphapose", None, [q for c in contents for q in _listed(c["bodies"], "joints")]
    if all(isinstance(c, list) for c in contents) and (kind := _of_lists(contents)):
        if kind[0] == "mmpose":
            return kind
        raise ValueError(f"{path}: put the frames' lists into one JSON list, in their order")
    return None, None, []


def guess_labels(files: Sequence[Path]) -> Guess:
    """The same of some of Ultralytics' label files."""
    for row, _ in (row for file in files for row in rows_of(file)):
        for count in (17, 26, 133):
            person = points_in(row, count)
            if person is not None:
                return "ultralytics", None, [person]
    return None, None, []


def _of_lists(frames: Sequence[Any]) -> Guess | None:
    """Of frames that are lists of people: MMPose's or Ultralytics' results as they are."""
    entries = [people_of(entry) for entry in frames[:PEOPLE_LOOKED_AT]]
    people = [person for entry in entries if isinstance(entry, list) for person in entry]
    if any(is_person(person) for person in people):
        tables = [p["keypoints"] for p in people if is_person(p)]
        lengths = {len(t["x"]) for t in tables if isinstance(t["x"], list)}
        return "ultralytics", None, [np.ones((n, 3)) for n in lengths]
    if any(isinstance(p, dict) and "keypoint_scores" in p for p in people):
        return "mmpose", None, list(_mmpose([{"instances": people}]))
    return None


def _by_picture(content: dict[str, Any]) -> list[Person]:
    """People of AlphaPose's forms by picture name; none where it is another file."""
    of_frames = [c for c in list(content.values())[:PEOPLE_LOOKED_AT] if isinstance(c, dict)]
    return [
        person
        for frame in of_frames
        for name, field in PERSON_FIELDS.items()
        for person in _listed(frame.get(name), field)
    ]


def _listed(people: Any, field: str) -> Iterator[Person]:
    for person in people if isinstance(people, list) else []:
        values = person.get(field) if isinstance(person, dict) else None
        if isinstance(values, list) and values:
            yield from _detected(values)


def _coco(entries: list[Any]) -> Iterator[Person]:
    for entry in entries[:PEOPLE_LOOKED_AT]:
        values = entry.get("keypoints") if isinstance(entry, dict) else None
        if isinstance(values, list) and values and len(values) % 3 == 0:
            yield from _detected(values)


def _mmpose(entries: Any) -> Iterator[Person]:
    for entry in entries[:PEOPLE_LOOKED_AT] if isinstance(entries, list) else []:
        people = entry.get("instances") if isinstance(entry, dict) else None
        for person in people if isinstance(people, list) else []:
            xy = person.get("keypoints") if isinstance(person, dict) else None
            if isinstance(xy, list) and all(isinstance(p, list) and len(p) >= 2 for p in xy):
                yield from _detected([[*p[:2], 1.0] for p in xy])


def _detected(values: list[Any]) -> Iterator[Person]:
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
    if names & {*PICTURE, *WORLD}:
        return "mediapipe", "mediapipe33", []
    return None, None, []


def _guess_npy(path: Path) -> Guess:
    table = load_arrays(path)["keypoints"]
    if table.ndim not in (3, 4):
        return None, None, []
    count = table.shape[-2]
    if count not in LAYOUT_OF_COUNT and count >= WITH_HANDS:
        return "npz", "mediapipe33", []
    return "npz", None, [np.ones((count, 3))]


def _guess_csv(path: Path) -> Guess:
    heading = read_csv(path)[0]
    if heading[0].strip().lower() == "scorer":
        return "deeplabcut", best_layout(body_parts(path)), []
    if FRAME in heading and any(cell.endswith(".x") for cell in heading):
        return "sleap", best_layout(nodes(path)), []
    if is_long(heading) or landmark_columns(heading) is not None:
        return "mediapipe", "mediapipe33", []
    return None, None, []


def _guess_h5(path: Path) -> Guess:
    names = h5_nodes(path)
    if names is not None:
        return "sleap", best_layout(names), []
    return "deeplabcut", best_layout(body_parts(path)), []
