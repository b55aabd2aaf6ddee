"""4D-Humans (HMR2) with PHALP: the `.pkl` of its tracking, one dictionary per clip.

{picture's path: {``time`` the frame's number from 0, ``tid`` the people's tracks, ``smpl`` for each
{``global_orient`` (1, 3, 3), ``body_pose`` (23, 3, 3), ``betas``} in camera axes, ``bbox`` x, y,
width, height in pixels, ``tracked_time`` frames since the person was last detected, ...}}, written
with joblib. People who were not detected in a frame (``tracked_time`` above 0) are ignored there.
Of several people the performer is found by the boxes. Cameras, joints, shape, masks and appearance
are not used.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from imocap_core.io.detectors.people import frame_number, type_name
from imocap_core.io.estimators.estimates import (
    JOINTS,
    Entries,
    PerformerBoxes,
    checked_rotations,
    field,
    performer_rows,
    select_rows,
)
from imocap_core.io.pickles import read_results


def read_phalp(path: Path, performer: PerformerBoxes) -> Float[np.ndarray, "T 24 3 3"]:
    """The performer's joint rotations in camera axes, NaN where missing.

    ValueError names file, frame, field, expected and got.
    """
    content = read_results(path)
    if not isinstance(content, dict) or not content:
        got = "an empty one" if isinstance(content, dict) else type_name(content)
        raise ValueError(f"{path}: expected a dictionary with one entry per frame, got {got}")
    frames, track, middle, poses = [], [], [], []
    for n, name in enumerate(sorted(content, key=str)):
        where = f"{path}: {name}"
        entry = content[name]
        people, boxes = _listed(entry, "smpl", where), _listed(entry, "bbox", where)
        ids = _listed(entry, "tid", where)
        if not len(people) == len(boxes) == len(ids):
            raise ValueError(
                f"{where}: expected as many smpl, bbox and tid, got {len(people)}, {len(boxes)} "
                f"and {len(ids)}"
            )
        since = _listed({"tracked_time": []} | entry, "tracked_time", where)
        frame = frame_number(_number(entry.get("time", n)), f"{where}: time")
        for i, person in enumerate(people):
            if i < len(since) and since[i] != 0:
                continue
            box = field({"bbox": boxes[i]}, "bbox", (4,), f"{where}: person {i}")
            frames.append(frame)
            track.append(frame_number(_number(ids[i]), f"{where}: tid"))
            middle.append(box[:2] + 0.5 * box[2:])
            poses.append(_rotations(person, f"{where}: person {i}"))
    if not poses:
        raise ValueError(f"{path}: expected at least one person, got none; track the video again")
    entries = Entries(np.array(frames), np.array(track), np.array(middle))
    rows = performer_rows(entries, performer, path)
    return select_rows(checked_rotations(np.stack(poses), f"{path}: smpl"), rows)


def _listed(entry: Any, name: str, where: str) -> list[Any]:
    people = entry.get(name) if isinstance(entry, dict) else None
    if isinstance(people, np.ndarray) and people.ndim:
        people = list(people)
    if not isinstance(people, list):
        raise ValueError(f"{where}: {name}: expected a list of people, got {type_name(people)}")
    return people


def _rotations(person: Any, where: str) -> Float[np.ndarray, "24 3 3"]:
    root = field(person, "global_orient", (1, 3, 3), where)
    body = field(person, "body_pose", (JOINTS - 1, 3, 3), where)
    return np.concatenate([root, body])


def _number(value: Any) -> Any:
    """A numpy number as Python's."""
    return (
        value.item() if isinstance(value, (np.generic, np.ndarray)) and value.size == 1 else value
    )
