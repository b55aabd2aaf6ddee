"""Whether all videos show one motion, or performances that differ."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

# Deviations of one motion, in metres (training clips resampled: up to 0.005 and 0.005; captured and
# made performances of training clips: 0.015 or more, or 0.02 or more in their paths)
ONE_MOTION_M, ONE_PATH_M = 0.01, 0.015


def is_one_motion(
    keypoint_sd_m: Float[np.ndarray, "M N K"], rigid_offset_sd: Float[np.ndarray, "M 6"]
) -> bool:
    """Whether the videos' deviations from their common motion are those of one performance.

    Args:
        keypoint_sd_m, rigid_offset_sd: as of `CommonMotion`.
    """
    deviation = keypoint_sd_m.mean(axis=(1, 2)).max(initial=0.0)
    path = rigid_offset_sd[:, 3:].max(initial=0.0)
    return bool(deviation <= ONE_MOTION_M and path <= ONE_PATH_M)
