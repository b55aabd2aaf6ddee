"""A root bone on the floor, which carries the motion through the world (root motion)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from imocap_core.camera.world import heading, on_floor, y_up_axes
from imocap_core.io.writers.motion_clip import MotionClip

NAME = "root"


def with_root_bone(clip: MotionClip, up: str) -> MotionClip:
    """The same motion with a bone `root` above the pelvis, in a world whose y or z points up.

    The root is on the floor under the pelvis and turns with the body's heading about the vertical;
    the pelvis moves against it.
    """
    to_y = y_up_axes(up)
    turned = to_y.T @ heading(to_y @ clip.R_local[:, 0])
    R_local = np.concatenate([turned[:, None], clip.R_local], axis=1)
    R_local[:, 1] = np.swapaxes(turned, -1, -2) @ clip.R_local[:, 0]
    return replace(
        clip,
        joint_names=(NAME, *clip.joint_names),
        parents=(-1, *(parent + 1 for parent in clip.parents)),
        rest=np.concatenate([np.zeros((1, 3)), clip.rest]),
        tips={joint + 1: tip for joint, tip in clip.tips.items()},
        R_local=R_local,
        root=on_floor(clip.pelvis, up),
    )
