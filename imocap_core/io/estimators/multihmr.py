"""Multi-HMR: the people that its model returns for every frame, saved by the user.

{``img_size``: the model's, ``frames``: [one list of people a frame]}, with torch.save, pickle or as
JSON. A person has ``rotvec`` (53, 3), axis-angle in camera axes: SMPL-X's pelvis and 21 joints
first, then hands and jaw; and ``loc`` (2,), the head's place in the square picture of ``img_size``
pixels into which the model's demo fits the video's. Meshes, shape and translations are not used.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from jaxtyping import Float

from imocap_core.io.detectors.people import type_name
from imocap_core.io.estimators.estimates import PerformerBoxes, field, from_vectors
from imocap_core.io.estimators.frame_lists import (
    PersonInFrame,
    frame_entries,
    of_performer,
    read_saved,
)

JOINTS, BODY = 53, 22  # of rotvec, and those that SMPL shares with SMPL-X
HANDS = 6  # numbers of SMPL's hands, which stay at rest


def read_multihmr(path: Path, performer: PerformerBoxes) -> Float[np.ndarray, "T 24 3 3"]:
    """The performer's joint rotations in camera axes, NaN where missing.

    ValueError names file, frame, person, field, expected and got.
    """
    content = read_saved(path)
    side = content.get("img_size") if isinstance(content, dict) else None
    if isinstance(side, np.ndarray) and side.size == 1:
        side = side.item()
    if not isinstance(side, (int, float)) or not 0 < side < np.inf:
        raise ValueError(
            f"{path}: expected a dictionary with img_size, the model's, and frames, got "
            f"{type_name(content)} with img_size {type_name(side)}"
        )
    estimates: list[PersonInFrame] = []
    for frame, people in enumerate(frame_entries(content.get("frames"), path)):
        if not isinstance(people, list):
            where = f"{path}: frames[{frame}]"
            raise ValueError(f"{where}: expected a list of people, got {type_name(people)}")
        for i, person in enumerate(people):
            where = f"{path}: frames[{frame}][{i}]"
            vectors = field(person, "rotvec", (JOINTS, 3), where)
            middle = in_video(field(person, "loc", (2,), where), float(side), performer.size)
            estimates.append(
                PersonInFrame(frame, middle, np.pad(vectors[:BODY].ravel(), (0, HANDS)))
            )
    return from_vectors(of_performer(estimates, performer, path))


def in_video(
    xy: Float[np.ndarray, "2"], side: float, size: tuple[int, int]
) -> Float[np.ndarray, "2"]:
    """A place in a square of `side` pixels, in whose middle the picture fits, in the picture's
    pixels."""
    return (xy - side / 2) * max(size) / side + np.array(size) / 2
