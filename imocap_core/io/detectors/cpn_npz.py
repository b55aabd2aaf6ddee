"""VideoPose3D's 2D keypoints: `data_2d_*.npz`, `positions_2d` of many clips in one file.

As its page on datasets describes: ``positions_2d`` is {subject: {action: [(T, 17, 2) pixels, one
per camera]}} (CPN's detections on Human3.6M: layout h36m17; a file of custom videos has the
video's name for the subject, `custom` for the action and COCO's points: layout coco17), and
``metadata`` names the layout. Both are pickles, read without running code. There is no
confidence: every finite point has 1.

Of several clips the one named like the video's id is used: ``S9_Walking_1_0`` is subject S9, action
"Walking 1", camera 0 (only letters and digits are compared), or the one whose subject is the
video's file name.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from imocap_core.io.detectors.people import (
    DetectedPeople,
    cleaned,
    detections,
    must_have_layout,
    type_name,
)
from imocap_core.io.object_npz import read_object

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
