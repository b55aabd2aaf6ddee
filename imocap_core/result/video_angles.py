"""Joint angles of one video of a result."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from imocap_core.biomechanics.angle_spread import angle_spreads_deg
from imocap_core.biomechanics.joint_angles import joint_angles_deg
from imocap_core.camera.world import y_up_axes
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.result.body import body_model, local_rotations, posed_joints
from imocap_core.result.video import VideoResult

BODY = len(SMPL_JOINTS)
UNKNOWN = ("_wrist_", "_pronation")  # the prior alone would speak, which is too sure of them
WITH_WRISTS = 3 * SMPL_JOINTS.index("left_hand")  # numbers of a pose up to the wrists


@dataclass(frozen=True, eq=False)
class VideoAngles:
    """Joint angles of one video over its T frames.

    angles_deg: by name, (T,); NaN where an angle is not defined. sd_deg: standard deviations; none
    of wrists and pronation, which keypoints of the body do not show (`UNKNOWN`), and none at all
    where the stage uncertainty has not run.
    """

    id: str
    angles_deg: dict[str, Float[np.ndarray, " T"]]
    sd_deg: dict[str, Float[np.ndarray, " T"]]


def video_angles(video: VideoResult, up: str = "y", tilt_sd_deg: float = np.nan) -> VideoAngles:
    """Joint angles of a video in a levelled world, whose axis `up` (y or z) points up.

    tilt_sd_deg: how well the ground tells where up is; NaN unknown.
    """
    R, rest = body_rotations(video, up), rest_joints_m(video)
    angles, uncertain = joint_angles_deg(R, rest), video.joint_uncertainty
    if uncertain is None:
        return VideoAngles(video.id, angles, {})
    sd = angle_spreads_deg(
        R,
        rest,
        uncertain.rotation_covariance_deg2.astype(np.float64),
        tilt_sd_deg=tilt_sd_deg,
        camera_sd_deg=uncertain.camera_sd_deg,
    )
    shown = {name: x for name, x in sd.items() if not any(part in name for part in UNKNOWN)}
    return VideoAngles(video.id, angles, shown)


def body_rotations(video: VideoResult, up: str = "y") -> Float[np.ndarray, "T 24 3 3"]:
    """Rotations of SMPL's 24 joints against their parents, the first in a world whose y points up.

    Wrists are those of the hands where the video has hands. up: the axis of the video's world.
    """
    wrists = video.poses[:, :WITH_WRISTS]
    R = local_rotations(np.concatenate([wrists, video.theta[:, WITH_WRISTS:]], axis=1))
    R[:, 0] = y_up_axes(up) @ R[:, 0]
    return R


def rest_joints_m(video: VideoResult) -> Float[np.ndarray, "24 3"]:
    """The performer's joints in the rest pose, metres."""
    model = body_model(video.model, video.action, hands=False)
    return posed_joints(model, video.betas, np.zeros((1, 3 * BODY)), np.zeros((1, 3)))[0]
