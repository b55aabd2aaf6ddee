"""WHAM: `wham_output.pkl`, as its demo writes it with joblib when asked to save.

{person: {``pose`` (N, 72) axis-angle, the root in camera axes, ``trans`` (N, 3), ``frame_ids``
(N,), ``betas``, ``verts``, ``pose_world``, ``trans_world``}}. Of several people the performer is
found by where ``trans`` is in the picture, at WHAM's usual focal length (the picture's diagonal).
World motion, shape and mesh are not used.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from imocap_core.io.estimators.estimates import Array, PerformerBoxes, field
from imocap_core.io.estimators.persons import performer_of


def read_wham(path: Path, performer: PerformerBoxes) -> Array:
    """The performer's joint rotations, as of `performer_of`."""

    def middle_px(person: dict[str, Any], count: int, where: str) -> Array:
        trans = field(person, "trans", (count, 3), where)
        focal_px = float(np.hypot(*performer.size))
        depth = np.where(trans[:, 2:] > 0, trans[:, 2:], np.nan)
        middle: Array = focal_px * trans[:, :2] / depth + 0.5 * np.array(performer.size)
        return middle

    return performer_of(path, performer, middle_px)
