"""Format and layout of one file with the keypoints of a whole clip."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from imocap_core.io.detectors.deeplabcut import body_parts, read_csv
from imocap_core.io.detectors.mediapipe import PICTURE
from imocap_core.io.detectors.part_names import best_layout
from imocap_core.io.detectors.people import read_json
from imocap_core.io.detectors.sam3d_body import LAYOUT as SAM3D_LAYOUT
from imocap_core.io.detectors.sam3d_body import is_sam3d
from imocap_core.io.detectors.sleap import FRAME, nodes
from imocap_core.io.detectors.sleap_h5 import h5_nodes
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
    listed = content
    if isinstance(content, dict):
        listed = content.get("frames", content.get("annotations"))
    first = next((e for e in listed if isinstance(e, dict)), {}) if isinstance(listed, list) else {}
    if is_sam3d(listed):
        return "sam3d_body", SAM3D_LAYOUT, []
    if "image_id" in first:
        alphapose = "box" in first or "idx" in first or isinstance(first["image_id"], str)
        layout = "wholebody133" if "foot_kpts" in first else None
        return "alphapose" if alphapose else "coco", layout, list(_coco(listed))
    if "instances" in first:
        return "mmpose", None, list(_mmpose(listed))
    if any(name in first for name in PICTURE):
        return "mediapipe", "mediapipe33", []
    return None, None, []


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
    return ("mediapipe", "mediapipe33", []) if names & set(PICTURE) else (None, None, [])


def _guess_csv(path: Path) -> Guess:
    heading = read_csv(path)[0]
    if heading[0].strip().lower() == "scorer":
        return "deeplabcut", best_layout(body_parts(path)), []
    if FRAME in heading:
        return "sleap", best_layout(nodes(path)), []
    return None, None, []


def _guess_h5(path: Path) -> Guess:
    names = h5_nodes(path)
    if names is not None:
        return "sleap", best_layout(names), []
    return "deeplabcut", best_layout(body_parts(path)), []
