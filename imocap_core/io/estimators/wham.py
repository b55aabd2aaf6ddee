"""WHAM: `wham_output.pkl`, written by its demo with joblib when asked to save.

{person: {``pose`` (N, 72) axis-angle, the root in camera axes, ``trans`` (N, 3), ``frame_ids``
(N,), ``betas``, ``verts``, ``pose_world``, ``trans_world``}}. Of several people the performer is
found by ``trans``, projected with WHAM's default focal length (the picture's diagonal).
World motion, shape and mesh are not used.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from imocap_core.io.estimators.estimates import PerformerBoxes, field
from imocap_core.io.estimators.persons import performer_of


def read_wham(path: Path, performer: PerformerBoxes) -> Float[np.ndarray, "T 24 3 3"]:
    """The performer's joint rotations in camera axes; see `performer_of`."""

    def middle_px(person: dict[str, Any], count: int, where: str) -> Float[np.ndarray, "N 2"]:
        trans = field(person, "trans", (count, 3), where)
        focal_px = float(np.hypot(*performer.size))
        depth = np.where(trans[:, 2:] > 0, trans[:, 2:], np.nan)
        return np.asarray(focal_px * trans[:, :2] / depth + 0.5 * np.array(performer.size))

    return performer_of(path, performer, middle_px)
