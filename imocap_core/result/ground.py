"""From one world to another: a video's motion, hands and camera; and the ground they stand on."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from imocap_core.camera.gravity import FilmedBody
from imocap_core.camera.ground import estimate_ground
from imocap_core.camera.ground_plane import Ground
from imocap_core.camera.tilt_evidence import LevelPrior
from imocap_core.camera.world import (
    BodyMotion,
    Extrinsics,
    GroundAlignment,
    align_camera_to_ground,
    align_motion_to_ground,
)
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.result.video import HandMotion, VideoResult

JOINTS = len(SMPL_JOINTS)
LOOSELY_LEVEL = LevelPrior(roll_deg=5.0, pitch_deg=15.0, pitch_down_deg=0.0)


def ground_under(videos: Sequence[VideoResult], excluded: Collection[str]) -> Ground:
    """The ground under videos that are not `excluded`, where no artifact has it (of older runs)."""
    bodies = [
        FilmedBody(v.body_joints, v.fps, np.asarray(v.camera.R_per_frame.mean(axis=0)))
        for v in videos
        if v.id not in excluded
    ]
    return estimate_ground(bodies, LOOSELY_LEVEL)


def moved(video: VideoResult, alignment: GroundAlignment) -> VideoResult:
    """The same video in another world."""
    body = with_points(BodyMotion(video.theta, video.trans, video.body_joints), video.hands)
    body, hands = without_points(align_motion_to_ground(body, alignment), video.hands)
    pose = align_camera_to_ground(Extrinsics(video.camera.R, video.camera.t), alignment)
    return replace(
        video,
        theta=body.theta,
        trans=body.trans,
        body_joints=body.joints,
        hands=hands,
        camera=replace(video.camera, R=pose.R, t=pose.t),
    )


def with_points(body: BodyMotion, hands: HandMotion | None) -> BodyMotion:
    """The body and, after its joints, the points of its hands."""
    if hands is None:
        return body
    points = hands.points.reshape(len(body.joints), -1, 3)
    return BodyMotion(body.theta, body.trans, np.concatenate([body.joints, points], axis=1))


def without_points(
    both: BodyMotion, hands: HandMotion | None
) -> tuple[BodyMotion, HandMotion | None]:
    """The reverse of `with_points`."""
    body = BodyMotion(both.theta, both.trans, both.joints[:, :JOINTS])
    if hands is None:
        return body, None
    points = both.joints[:, JOINTS:].reshape(len(both.joints), 2, -1, 3)
    return body, replace(hands, points=points)
