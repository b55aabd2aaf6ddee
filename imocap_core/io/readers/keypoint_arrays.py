"""2D keypoints as arrays: npz and npy, VideoPose3D's `data_2d_*.npz`, SAM 3D Body, Human3.6M.

npz: ``keypoints`` (T, P, K, 2) and ``scores`` (T, P, K), with one person also without P, or
``keypoints`` (..., 3) with the scores. ``frames`` (T,) are the frame numbers; without it they count
from 0. A person who is not in a frame is NaN, or has no score above 0; without scores every finite
point counts as certain. An npy file is `keypoints` alone. FreeMoCap's 2D data is of this kind,
(cameras, T, points, 2) with MediaPipe's 33 body points first: of several cameras each video needs
its own part.

VideoPose3D: ``positions_2d`` is {subject: {action: [(T, 17, 2) pixels, one per camera]}} (CPN's
detections on Human3.6M: layout h36m17; a file of custom videos has the video's name for the
subject, `custom` for the action and COCO's points: layout coco17), and ``metadata`` names the
layout. Both are pickles, read without running code. Of several clips the one named like the video's
id is used: ``S9_Walking_1_0`` is subject S9, action "Walking 1", camera 0 (only letters and digits
are compared), or the one whose subject is the video's file name.

SAM 3D Body as a detector: ``pred_keypoints_2d`` become COCO-WholeBody's points, without those of
the face.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Shaped

from imocap_core.body.layouts import layout_names
from imocap_core.io.array_files import read_object
from imocap_core.io.npz import load_arrays, numbers
from imocap_core.io.readers.estimates import NAMES, POINTS_2D, field, saved_people
from imocap_core.io.readers.mediapipe import points_of_csv
from imocap_core.io.readers.people import (
    LAYOUT_OF_COUNT,
    TABLES,
    DetectedPeople,
    cleaned,
    detections,
    must_have_layout,
    read_csv,
    short,
    type_name,
)

OF_MEDIAPIPE = ("mediapipe33", "blazepose33")
WITH_HANDS = 75  # points: MediaPipe's body and two hands, or more
_CAMERAS = (
    "{}: expected the points of one camera, frames first, got {} times {}, as FreeMoCap's 2D data "
    "of several cameras; save each camera's own: numpy.save('v1.npy', numpy.load(FILE)[0])"
)


def read_keypoints_npz(path: Path, layout: str) -> DetectedPeople:
    """All people of all frames. ValueError names file, field, expected and got."""
    arrays = _of_csv(path) if path.suffix.lower() in TABLES else load_arrays(path)
    if path.suffix.lower() == ".npy":
        arrays = _of_npy(arrays["keypoints"], layout, path)
    one_person = "keypoints" in arrays and arrays["keypoints"].ndim == 3
    dims = ("T", "K") if one_person else ("T", "P", "K")
    table = numbers(arrays, "keypoints", (*dims, "2 or 3"), path)
    if not one_person and len(table) < table.shape[1]:
        raise ValueError(_CAMERAS.format(path, *table.shape[:2]))
    count, got = len(layout_names(layout)), table.shape[-2]
    if got != count:
        fitting = LAYOUT_OF_COUNT.get(got)
        advice = f"set layout: {fitting}" if fitting else "check `layout`"
        raise ValueError(
            f"{path}: keypoints: expected the {count} points of {layout}, got {got}; {advice} in "
            "action.yaml"
        )
    if table.shape[-1] == 2:
        if "scores" not in arrays:
            arrays = {**arrays, "scores": np.isfinite(table).all(axis=-1).astype(float)}
        scores = numbers(arrays, "scores", table.shape[:-1], path)
        table = np.concatenate([table, scores[..., None]], axis=-1)
    if table.shape[-1] != 3:
        raise ValueError(
            f"{path}: keypoints: expected x, y and optionally a score of every point, got "
            f"{table.shape[-1]} numbers"
        )
    frames = np.arange(len(table))
    if "frames" in arrays:
        frames = numbers(arrays, "frames", (len(table),), path).astype(np.int64)
    if len(set(frames.tolist())) < len(frames) or (len(frames) and frames.min() < 0):
        distinct, times = np.unique(frames, return_counts=True)
        wrong = distinct[(times > 1) | (distinct < 0)].tolist()
        raise ValueError(
            f"{path}: frames: expected different numbers from 0, got {short(wrong)}, negative or "
            "twice; number the frames from 0"
        )
    people = cleaned(table if not one_person else table[:, None])
    present = {
        int(n): [person for person in in_frame if (person[:, 2] > 0).any()]
        for n, in_frame in zip(frames, people, strict=True)
    }
    return detections(present, layout, path)


def _of_csv(path: Path) -> dict[str, Shaped[np.ndarray, "..."]]:
    points = points_of_csv(path)
    if points is None:
        raise ValueError(
            f"{path}: expected a row a frame with columns x0, y0, c0, ... or left_knee_x, ..., got "
            f"{', '.join(read_csv(path)[0]):.80}"
        )
    return points[0]


def _of_npy(
    table: Shaped[np.ndarray, "..."], layout: str, path: Path
) -> dict[str, Shaped[np.ndarray, "..."]]:
    """The arrays of an npz for those of an npy: (T, K, 2 or 3), FreeMoCap's of one camera."""
    table = people_last(table)
    if table.ndim == 4 and len(table) == 1 and layout in OF_MEDIAPIPE:
        table = table[0]
    if table.ndim == 4 and table.shape[2] >= WITH_HANDS and layout in OF_MEDIAPIPE:
        raise ValueError(_CAMERAS.format(path, *table.shape[:2]))
    if table.dtype.kind not in "fiu" or table.ndim not in (3, 4):
        raise ValueError(
            f"{path}: expected an array (frames, points, 2 or 3), got {table.dtype} {table.shape}"
        )
    if layout in OF_MEDIAPIPE and table.ndim == 3:
        table = table[:, :33, :2]
    return {"keypoints": table}


def people_last(table: Shaped[np.ndarray, "..."]) -> Shaped[np.ndarray, "..."]:
    """(T, P, K, n) of MoveNet's outputs (T, 1, P, K, n); others as they are."""
    return table[:, 0] if table.ndim == 5 and table.shape[1] == 1 else table


LAYOUTS = ("h36m17", "coco17")
POINTS = 17
_SHOWN = 6


def read_cpn_npz(path: Path, layout: str, names: Sequence[str]) -> DetectedPeople:
    """The clip that one of `names` (the video's id, its file name) refers to.

    ValueError names file, field, expected and got, with the clips in the file.
    """
    must_have_layout(LAYOUTS, layout, "VideoPose3D", path)
    clips = dict(_clips(path))
    chosen = _choose(clips, names)
    if chosen is None:
        listed = ", ".join(list(clips)[:_SHOWN]) + (" ..." if len(clips) > _SHOWN else "")
        raise ValueError(
            f"{path}: positions_2d: expected one clip, or one named like the video's id "
            f"({', '.join(names)}), got {len(clips)}: {listed}; give the video the id of its clip"
        )
    table = _table(clips[chosen], f"{path}: positions_2d: {chosen}")
    people = cleaned(np.concatenate([table, np.ones((*table.shape[:2], 1))], axis=2))
    frames = {t: [p] if (p[:, 2] > 0).any() else [] for t, p in enumerate(people)}
    return detections(frames, layout, path)


def _clips(path: Path) -> Iterator[tuple[str, Any]]:
    tree = read_object(path, "positions_2d")
    for subject, actions in _items(tree, f"{path}: positions_2d"):
        for action, cameras in _items(actions, f"{path}: positions_2d: {subject}"):
            if not isinstance(cameras, (list, tuple)):
                raise ValueError(
                    f"{path}: positions_2d: {subject}, {action}: expected a list of cameras, got "
                    f"{type_name(cameras)}"
                )
            for number, camera in enumerate(cameras):
                yield f"{subject} {action} {number}", camera


def _items(tree: Any, where: str) -> Iterator[tuple[str, Any]]:
    if not isinstance(tree, dict) or not tree:
        raise ValueError(f"{where}: expected subject -> action -> cameras, got {type_name(tree)}")
    for name, value in tree.items():
        yield str(name), value


def _choose(clips: dict[str, Any], names: Sequence[str]) -> str | None:
    if len(clips) == 1:
        return next(iter(clips))
    requested = {_letters(name) for name in names}
    by_all = [clip for clip in clips if _letters(clip) in requested]
    by_subject = [clip for clip in clips if _letters(clip.rsplit(" custom ", 1)[0]) in requested]
    for fitting in (by_all, by_subject):
        if len(fitting) == 1:
            return fitting[0]
    return None


def _letters(name: str) -> str:
    return re.sub(r"[^a-z0-9]+", " ", name.lower()).strip()


def _table(value: Any, where: str) -> Float[np.ndarray, "T 17 2"]:
    numeric = isinstance(value, np.ndarray) and value.dtype.kind in "fiu"
    if not numeric or value.ndim != 3 or value.shape[1:] != (POINTS, 2):
        got = f"{value.dtype} {value.shape}" if isinstance(value, np.ndarray) else type_name(value)
        raise ValueError(f"{where}: expected numbers (T, {POINTS}, 2), got {got}")
    return np.asarray(value, dtype=np.float64)


LAYOUT = "wholebody133"
_ROOTS = {"left_hand_root": "left_wrist", "right_hand_root": "right_wrist"}


def read_sam3d_keypoints(path: Path, layout: str) -> DetectedPeople:
    """All people of all frames. ValueError names file, frame, field, expected and got."""
    must_have_layout((LAYOUT,), layout, "SAM 3D Body", path)
    frames: dict[int, list[Float[np.ndarray, "K 3"]]] = {}
    for frame, people in saved_people(path):
        points = [field(person, POINTS_2D, (len(NAMES), 2), where) for person, where in people]
        frames.setdefault(frame, []).extend(map(whole_body, points))
    return detections(frames, layout, path)


def whole_body(points_px: Float[np.ndarray, "70 2"]) -> Float[np.ndarray, "133 3"]:
    """One person's points as COCO-WholeBody's: pixels and confidence."""
    index = {name: k for k, name in enumerate(NAMES)}
    person = np.full((len(layout_names(LAYOUT)), 3), np.nan)
    for column, name in enumerate(layout_names(LAYOUT)):
        place = index.get(_ROOTS.get(name, name))
        if place is not None:
            person[column] = *points_px[place], 1.0
    return cleaned(person)
