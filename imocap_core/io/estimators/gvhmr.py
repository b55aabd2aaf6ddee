"""GVHMR: `hmr4d_results.pt`, one person's motion, saved by its demo with torch.

``smpl_params_incam`` has ``global_orient`` (N, 3) and ``body_pose`` (N, 63), axis-angle, in camera
axes: pelvis and the 21 joints that SMPL-X shares with SMPL (SMPL's hands stay at rest); one row per
frame of the video. ``transl``, ``betas``, the world's parameters, the camera and the network's
other outputs are not used. The file is read with torch's restricted reader.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from jaxtyping import Float

from imocap_core.io.detectors.people import type_name
from imocap_core.io.estimators.estimates import PerformerBoxes, field, from_vectors
from imocap_core.io.npz import rows_for_frames
from imocap_core.io.pickles import read_results

IN_CAMERA = "smpl_params_incam"


def read_gvhmr(path: Path, performer: PerformerBoxes) -> Float[np.ndarray, "T 24 3 3"]:
    """The joint rotations in camera axes. ValueError names file and field."""
    content = read_results(path)
    if not isinstance(content, dict) or IN_CAMERA not in content:
        got = ", ".join(map(str, content)) if isinstance(content, dict) else type_name(content)
        raise ValueError(f"{path}: expected a dictionary with {IN_CAMERA}, got {got:.80}")
    where = f"{path}: {IN_CAMERA}"
    body = field(content[IN_CAMERA], "body_pose", ("N", 63), where)
    root = field(content[IN_CAMERA], "global_orient", (len(body), 3), where)
    rows = rows_for_frames({}, len(body), performer.frames, path)
    return from_vectors(np.concatenate([root, body], axis=1)[rows])
