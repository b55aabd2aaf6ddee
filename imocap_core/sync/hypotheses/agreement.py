"""Pairwise agreement of hypotheses: one rotation and one warp must explain both videos' keypoints.

Under the rotation from video a to video b, a's motion is projected onto b's keypoints, and, under
its inverse, b's motion onto a's. Each direction by itself is blind to depth: reversed in a, it is
made good by a rotation the other way. Both together under one rotation are not, unless the two
videos look along one line. Keypoints are the evidence, so a wrong motion cannot vouch for another
beyond what the pictures show.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from imocap_core.sync.screening.registration import (
    Keypoints2D,
    camera_directions,
    pose_residuals,
    warp_costs,
)

DIRECTIONS = 128


def pair_costs(
    motions_a: Sequence[Float[np.ndarray, "T_a J 3"]],
    motions_b: Sequence[Float[np.ndarray, "T_b J 3"]],
    keypoints_a: Keypoints2D,
    keypoints_b: Keypoints2D,
) -> Float[np.ndarray, "K_a K_b"]:
    """Mean residual of both videos' keypoints for each pair of hypotheses, 0 to 1.

    Args:
        motions_a, motions_b: the hypotheses of each video, in the axes of its own camera (y down).
    """
    forth = camera_directions(DIRECTIONS)
    R = np.concatenate([forth, np.cross(forth[:, :1], forth[:, 1:])], axis=1)
    back = R.transpose(0, 2, 1)[:, :2]
    onto_b = [pose_residuals(x, keypoints_b, forth) for x in motions_a]  # (D, T_b, T_a)
    onto_a = [pose_residuals(x, keypoints_a, back) for x in motions_b]  # (D, T_a, T_b)
    frames = len(keypoints_b.weight)
    return np.array(
        [
            [float(warp_costs(0.5 * (x + y.transpose(0, 2, 1))).min()) / frames for y in onto_a]
            for x in onto_b
        ]
    )
