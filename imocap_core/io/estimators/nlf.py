"""NLF: what `detect_smpl_batched` returns, saved by the user with torch.save, pickle or as JSON.

A list of its dictionaries, one for every batch of pictures in the video's order, or one dictionary.
``pose`` is a list over the pictures of (people, 72), axis-angle in camera axes (of SMPL+H and
SMPL-X the first 66 numbers); ``boxes`` a list of (people, 4 or 5) left, top, width, height in
pixels. Joints, vertices, shape, translation and uncertainties are not used.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from imocap_core.io.detectors.people import type_name
from imocap_core.io.estimators.estimates import PerformerBoxes, field, from_vectors
from imocap_core.io.estimators.frame_lists import (
    PersonInFrame,
    box_middles,
    frame_entries,
    is_empty,
    of_performer,
    read_saved,
)

SMPL, BODY = 72, 66  # numbers of SMPL's 24 joints, and of the 22 that SMPL-X shares with it


def read_nlf(path: Path, performer: PerformerBoxes) -> Float[np.ndarray, "T 24 3 3"]:
    """The performer's joint rotations in camera axes, NaN where missing.

    ValueError names file, picture, field, expected and got.
    """
    content = read_saved(path)
    batches = [content] if isinstance(content, dict) else frame_entries(content, path)
    estimates: list[PersonInFrame] = []
    frame = 0
    for n, batch in enumerate(batches):
        poses, boxes = (_pictures(batch, name, f"{path}: [{n}]") for name in ("pose", "boxes"))
        if len(poses) != len(boxes):
            raise ValueError(
                f"{path}: [{n}]: expected as many pose and boxes, got {len(poses)} and {len(boxes)}"
            )
        for pose, box in zip(poses, boxes, strict=True):
            estimates += _people(pose, box, frame, f"{path}: [{n}]: picture {frame}")
            frame += 1
    return from_vectors(of_performer(estimates, performer, path))


def _pictures(batch: Any, name: str, where: str) -> list[Any]:
    """One entry a picture."""
    pictures = batch.get(name) if isinstance(batch, dict) else None
    if isinstance(pictures, np.ndarray) and pictures.ndim:
        pictures = list(pictures)
    if not isinstance(pictures, list):
        raise ValueError(f"{where}: {name}: expected a list of pictures, got {type_name(pictures)}")
    return pictures


def _people(pose: Any, box: Any, frame: int, where: str) -> list[PersonInFrame]:
    if is_empty(pose):
        return []
    poses = field({"pose": pose}, "pose", ("people", "numbers"), where)
    if poses.shape[1] < SMPL:
        raise ValueError(
            f"{where}: pose: expected {SMPL} numbers or more of each person, got {poses.shape}"
        )
    used = poses[:, : SMPL if poses.shape[1] == SMPL else BODY]
    vectors = np.pad(used, ((0, 0), (0, SMPL - used.shape[1])))
    middle = box_middles(box, len(poses), where)
    return [PersonInFrame(frame, m, v) for m, v in zip(middle, vectors, strict=True)]
