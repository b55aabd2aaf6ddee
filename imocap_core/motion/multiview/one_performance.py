"""One motion for all videos, at every video's own frames."""

from __future__ import annotations

import numpy as np

from imocap_core.motion.multiview.cameras import Cameras
from imocap_core.motion.multiview.coupling import coupling_terms
from imocap_core.motion.multiview.per_video import common_at_video_frames, targets_of
from imocap_core.motion.multiview.scene import Scene, per_video_terms, solve
from imocap_core.motion.state import MotionState
from imocap_core.params import MotionParams

SAME_RAD, SAME_M = 1e-3, 1e-4  # that a matched frame may differ from the common motion by


def follow_common(
    scene: Scene, state: MotionState, common: MotionState, cameras: Cameras, options: MotionParams
) -> MotionState:
    """The common motion at every video's matched frames; where a video shows more than the
    reference, its own evidence, continuing the common motion.

    Args:
        state: every video's motion so far, in its own camera's axes; common: batch of 1, world.
    """
    start = common_at_video_frames(scene, state, common, cameras)
    if all(np.isfinite(position).all() for position in scene.timeline.to_reference):
        return start
    targets = targets_of(scene, start, common, cameras)
    matched = (targets.trust > 0).to(start.trans)
    joints = matched[..., None].expand(*matched.shape, 24) / SAME_RAD**2
    coupling = coupling_terms(scene.body, targets, start, joints, matched / SAME_M**2)
    terms = [*per_video_terms(scene, start.trans), *coupling]
    return solve(terms, start, options.max_steps, performers=scene.performers).state
