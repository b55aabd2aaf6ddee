"""VIBE: `vibe_output.pkl`, written by its demo with joblib (and by tools in its format).

{person: {``pose`` (N, 72) axis-angle, the root in camera axes, ``bboxes`` (N, 4) middle, width and
height in pixels, ``frame_ids`` (N,), ``betas``, cameras, joints, ``verts``}}. Of several people
the performer is found by the boxes. Cameras, shape, joints and mesh are not used.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from imocap_core.io.estimators.estimates import PerformerBoxes, field
from imocap_core.io.estimators.persons import performer_of


def read_vibe(path: Path, performer: PerformerBoxes) -> Float[np.ndarray, "T 24 3 3"]:
    """The performer's joint rotations in camera axes; see `performer_of`."""
    return performer_of(path, performer, _middle_px)


def _middle_px(person: dict[str, Any], count: int, where: str) -> Float[np.ndarray, "N 2"]:
    return field(person, "bboxes", (count, 4), where)[:, :2]
