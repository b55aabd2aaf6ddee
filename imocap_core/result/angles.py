"""Joint angles of a result: of every video, and their mean over the performances."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from imocap_core.biomechanics.angle_spread import angle_spreads_deg
from imocap_core.biomechanics.joint_angles import angle_names, joint_angles_deg
from imocap_core.biomechanics.mean_curve import MeanCurve, mean_curve
from imocap_core.camera.world import y_up_axes
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.result.body import body_model, local_rotations, posed_joints
from imocap_core.result.result import ActionResult
from imocap_core.result.video import VideoResult

BODY = len(SMPL_JOINTS)
WITH_WRISTS = 3 * SMPL_JOINTS.index("left_hand")  # numbers of a pose up to the wrists


@dataclass(frozen=True, eq=False)
class VideoAngles:
    """Joint angles of one video over its T frames.

    angles_deg: by name, (T,); NaN where an angle is not defined. sd_deg: standard deviations of
    those that the joints' places determine; none where the stage uncertainty has not run.
    """

    id: str
    angles_deg: dict[str, Float[np.ndarray, " T"]]
    sd_deg: dict[str, Float[np.ndarray, " T"]]


@dataclass(frozen=True, eq=False)
class MeanAngles:
    """Joint angles over the N moments of the common time axis.

    phase_s (N,): seconds of the reference. curves: mean and standard deviation over the
    performances, by name.
    """

    phase_s: Float[np.ndarray, " N"]
    curves: dict[str, MeanCurve]


def video_angles(video: VideoResult, up: str = "y") -> VideoAngles:
    """Joint angles of a video in a levelled world, whose axis `up` (y or z) points up."""
    angles = joint_angles_deg(body_rotations(video, up), rest_joints_m(video))
    covariance = video.covariance_mm2
    sd = {} if covariance is None else angle_spreads_deg(video.body_joints, covariance)
    return VideoAngles(video.id, angles, sd)


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


def mean_angles(result: ActionResult) -> MeanAngles:
    """Mean joint angles of a result on the common time axis, in a world whose y points up."""
    each = [video_angles(video) for video in result]
    inside = [video.inside for video in result]
    curves = {n: mean_curve([a.angles_deg[n] for a in each], inside) for n in angle_names()}
    return MeanAngles(result.videos[0].phase_s, curves)
