"""The performer's limb joints in the pictures, from a calibrated triangulation."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from jaxtyping import Float

from imocap_core.io.truth import read_pose2sim_truth

SIDES, PARTS = ("left", "right"), ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")
LIMBS = [f"{side}_{part}" for side in SIDES for part in PARTS]
SHIFTS = range(-3, 4)  # frames by which reference and pictures may differ


def reference_limbs(folder: Path, video: str, frames: int) -> Float[np.ndarray, "T 12 2"]:
    """Limb joints (`LIMBS`) in the first frames of a video, pixels; NaN where there are none."""
    truth = read_pose2sim_truth(folder, {video: np.arange(frames)}).videos[video]
    assert truth.joints is not None
    assert truth.K is not None
    assert truth.R is not None
    assert truth.t is not None
    columns = [truth.joint_names.index(name) for name in LIMBS]
    in_camera = truth.joints[:, columns] @ truth.R.T + truth.t
    pixels = in_camera @ truth.K.T
    return np.asarray(pixels[..., :2] / pixels[..., 2:])


def shifted(limbs: Float[np.ndarray, "T 12 2"], by: int) -> Float[np.ndarray, "T 12 2"]:
    """The same so many frames later; NaN where there are none."""
    moved = np.full_like(limbs, np.nan)
    if by >= 0:
        moved[: len(limbs) - by] = limbs[by:]
    else:
        moved[-by:] = limbs[:by]
    return moved
