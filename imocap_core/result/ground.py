"""From each camera's axes to the world's, and a world that stands level on its ground."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from imocap_core.camera.world import (
    BodyMotion,
    Extrinsics,
    align_camera_to_ground,
    align_motion_to_ground,
    find_ground_alignment,
)
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.result.video import HandMotion, VideoResult

JOINTS = len(SMPL_JOINTS)
FEET = [SMPL_JOINTS.index(name) for name in ("left_foot", "right_foot")]


def levelled(
    videos: Sequence[VideoResult], excluded: Sequence[str], up: str
) -> tuple[VideoResult, ...]:
    """The same in a world that stands on the ground under the videos that are not `excluded`."""
    joints = [v.body_joints for v in videos if v.id not in excluded]
    ground = find_ground_alignment([j[:, FEET] for j in joints], [j[:, 0] for j in joints], up)
    placed = []
    for v in videos:
        body = with_points(BodyMotion(v.theta, v.trans, v.body_joints), v.hands)
        body, hands = without_points(align_motion_to_ground(body, ground), v.hands)
        pose = align_camera_to_ground(Extrinsics(v.camera.R, v.camera.t), ground)
        placed.append(
            replace(
                v,
                theta=body.theta,
                trans=body.trans,
                body_joints=body.joints,
                hands=hands,
                camera=replace(v.camera, R=pose.R, t=pose.t),
            )
        )
    return tuple(placed)


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
