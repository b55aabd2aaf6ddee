"""How well a joint motion explains the keypoints of each video by the video's own motion."""

from __future__ import annotations

import numpy as np

from imocap_core.motion.multiview.keypoint_evidence import frame_residuals
from imocap_core.motion.multiview.scene import Scene
from imocap_core.motion.multiview.swapped_sides import point_shares
from imocap_core.motion.state import MotionState

FLOOR = 0.02  # share of the keypoints' spread that no motion explains


def unexplained(scene: Scene, state: MotionState) -> float:
    """Mean logarithm of the share of the keypoints' spread that the motion leaves, over the matched
    frames of each video, then over the videos.

    Args:
        scene: with the sides of the detections as the motion has them.
        state: every video's motion in its own camera's axes.
    """
    poses = scene.body.positions(scene.body.keypoints, state).xyz.cpu().numpy()
    shares, ahead = point_shares(scene.body.keypoints.names), np.eye(3)[None]
    means = []
    for pose, o, position in zip(
        poses, scene.observations, scene.timeline.to_reference, strict=True
    ):
        matched = np.isfinite(position)
        weight = np.where(matched[:, None], o.confidence * shares, 0.0)
        residual = frame_residuals(pose[: len(weight)], o.xy_px, weight, ahead)[0]
        if matched.any():
            means.append(float(np.log(residual[matched] + FLOOR).mean()))
    return float(np.mean(means))
