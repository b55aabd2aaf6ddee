"""Evidence for a counterpart of a frame in the other video, or against one.

A frame whose nearest pose in the other video is unlike it may have no counterpart, but that is
weaker evidence than a Gaussian error makes it: monocular estimates of one pose from two sides may
differ by several times the usual distance, and as long as the pose lasts. So evidence grows with
the logarithm of the distance, and what speaks against a match counts by how much the pose changes:
a performer who stands still is one observation, however long.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

GAIN = 2.0  # nats per observation when the distance changes by a factor of e
PRIOR = 0.5  # in favour of a counterpart, nats per observation


def evidence_of_match(
    nearest: Float[np.ndarray, " N"],
    change: Float[np.ndarray, " N"],
    *,
    matched_square: float,
    level: float,
    observations: float,
) -> Float[np.ndarray, " N"]:
    """Log likelihood ratio of a counterpart against none, of each frame's nearest pose.

    Args:
        nearest: squared distance of the nearest pose of the other video.
        change: squared change of the pose around the frame (`pose_change`).
        matched_square: typical of `nearest` where there is a counterpart.
        level: but for the prior, the ratio is 0 at (1 + 2 level) matched_square; inf: every frame
            has a counterpart.
        observations: independent ones per frame.
    """
    if not np.isfinite(level):
        return np.full(len(nearest), np.inf)
    log_ratio = GAIN * np.log((2.0 + 2.0 * level) / (1.0 + nearest / matched_square))
    novelty = -np.expm1(-change / matched_square)
    against = np.where(log_ratio < 0, novelty, 1.0)
    return np.asarray(observations * (against * log_ratio + PRIOR))
