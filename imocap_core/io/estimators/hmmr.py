"""HMMR: `hmmr_output.pkl`, one person's track as its demo pickles it.

``poses`` (N, 24, 3, 3) are rotation matrices, the root's in camera axes; ``cams``, ``joints``,
``kps``, ``shapes``, ``verts`` and ``omegas`` are not used. The file does not say which frames it
has: N is the number of used frames, or of the whole video's.
"""

from __future__ import annotations

from pathlib import Path

from imocap_core.io.estimators.estimates import (
    JOINTS,
    Array,
    PerformerBoxes,
    checked_rotations,
    field,
)
from imocap_core.io.npz import rows_for_frames
from imocap_core.io.pickles import read_results


def read_hmmr(path: Path, performer: PerformerBoxes) -> Array:
    """The joint rotations (T, 24, 3, 3) in camera axes. ValueError names file and field."""
    poses = field(read_results(path), "poses", ("N", JOINTS, 3, 3), str(path))
    rows = rows_for_frames({}, len(poses), performer.frames, path)
    return checked_rotations(poses[rows], f"{path}: poses")
