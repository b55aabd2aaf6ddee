"""The limbs' keypoints, which every detector has."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from imocap_core.artifacts.schemas import VideoKeypoints
from imocap_core.body.layouts import layout_names
from imocap_core.conventions import mirror_indices

LIMBS = tuple(
    f"{side}_{joint}"
    for joint in ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")
    for side in ("left", "right")
)
TWINS = mirror_indices(LIMBS)


def limbs_px(video: VideoKeypoints) -> Float[np.ndarray, "T 12 2"]:
    """Detections (T, 12, 2) of shoulders to ankles; NaN where there are none."""
    names = layout_names(video.layout)
    xy = np.full((len(video.frames), len(LIMBS), 2), np.nan)
    for k, name in enumerate(LIMBS):
        if name in names:
            column = names.index(name)
            there = video.confidence[:, column] > 0
            xy[there, k] = video.xy_px[there, column]
    return xy
