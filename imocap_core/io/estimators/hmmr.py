"""HMMR: `hmmr_output.pkl`, one person's track, pickled by its demo.

``poses`` (N, 24, 3, 3) are rotation matrices, the root's in camera axes; ``cams``, ``joints``,
``kps``, ``shapes``, ``verts`` and ``omegas`` are not used. The file has no frame numbers: N is
the number of used frames, or of all frames of the video.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from jaxtyping import Float

from imocap_core.io.estimators.estimates import (
    JOINTS,
    PerformerBoxes,
    checked_rotations,
    field,
)
from imocap_core.io.npz import rows_for_frames
from imocap_core.io.pickles import read_results


def read_hmmr(path: Path, performer: PerformerBoxes) -> Float[np.ndarray, "T 24 3 3"]:
    """The joint rotations in camera axes. ValueError names file and field."""
    poses = field(read_results(path), "poses", ("N", JOINTS, 3, 3), str(path))
    rows = rows_for_frames({}, len(poses), performer.frames, path)
    return checked_rotations(poses[rows], f"{path}: poses")
