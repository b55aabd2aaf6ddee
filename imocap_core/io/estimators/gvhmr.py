"""GVHMR: `hmr4d_results.pt`, and GEM: `smpl_params.pt`; one person's motion, saved with torch.

``smpl_params_incam`` (GVHMR) or ``body_params_incam`` (GEM with the body SMPL) has
``global_orient`` (N, 3) and ``body_pose`` (N, 63), axis-angle, in camera axes: pelvis and the 21
joints that SMPL-X shares with SMPL (SMPL's hands stay at rest); one row per frame of the video.
``transl``, ``betas``, the world's parameters, the camera and the network's other outputs are not
used. The file is read with torch's restricted reader.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from jaxtyping import Float

from imocap_core.io.detectors.people import type_name
from imocap_core.io.estimators.estimates import PerformerBoxes, field, from_vectors
from imocap_core.io.npz import rows_for_frames
from imocap_core.io.pickles import read_results

GVHMR, GEM = "smpl_params_incam", "body_params_incam"
SMPL_BODY = 63


def read_gvhmr(path: Path, performer: PerformerBoxes) -> Float[np.ndarray, "T 24 3 3"]:
    """The joint rotations in camera axes. ValueError names file and field."""
    return _one_person(path, GVHMR, performer)


def read_gem(path: Path, performer: PerformerBoxes) -> Float[np.ndarray, "T 24 3 3"]:
    """As `read_gvhmr`. ValueError for GEM's other body (SOMA), whose joints are not SMPL's."""
    return _one_person(path, GEM, performer)


def _one_person(path: Path, group: str, performer: PerformerBoxes) -> Float[np.ndarray, "T 24 3 3"]:
    content = read_results(path)
    if not isinstance(content, dict) or group not in content:
        got = ", ".join(map(str, content)) if isinstance(content, dict) else type_name(content)
        raise ValueError(f"{path}: expected a dictionary with {group}, got {got:.80}")
    where = f"{path}: {group}"
    body = field(content[group], "body_pose", ("N", "D"), where)
    if body.shape[1] != SMPL_BODY:
        raise ValueError(
            f"{where}: body_pose: expected (N, {SMPL_BODY}), SMPL's body joints, got {body.shape}; "
            "of another body model (SOMA) export SMPL, or give joints (joints_npz)"
        )
    root = field(content[group], "global_orient", (len(body), 3), where)
    rows = rows_for_frames({}, len(body), performer.frames, path)
    return from_vectors(np.concatenate([root, body], axis=1)[rows])
