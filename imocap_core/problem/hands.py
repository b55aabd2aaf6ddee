"""Between artifacts and the core's hands."""

from __future__ import annotations

import numpy as np
import torch

from imocap_core.artifacts.schemas import (
    Camera,
    HandKeypoints,
    SyncSummary,
    VideoCameraMotion,
    VideoKeypoints,
    VideoMotion,
)
from imocap_core.body.kinematics import world_rotations
from imocap_core.camera.projection import warp
from imocap_core.conventions import SMPL_JOINTS, SMPL_PARENTS
from imocap_core.hands.assemble import VideoHands, point_weights
from imocap_core.hands.skeleton import SIDES, HandSkeleton
from imocap_core.motion.multiview.timeline import Timeline, make_timeline
from imocap_core.params import HandsParams
from imocap_core.rotations import exp

ELBOWS = [SMPL_JOINTS.index(f"{side}_elbow") for side in SIDES]
WRISTS = [SMPL_JOINTS.index(f"{side}_wrist") for side in SIDES]


def _seen_hands(video: VideoKeypoints) -> HandKeypoints:
    if video.hands is not None:
        return video.hands
    nothing = np.full((len(video.frames), 2, 21, 2), np.nan)
    return HandKeypoints(xy_px=nothing, confidence=np.zeros(nothing.shape[:3]))


def arms_and_hands(
    video: VideoKeypoints,
    turned: VideoCameraMotion,
    camera: Camera,
    motion: VideoMotion,
    skeleton: HandSkeleton,
    params: HandsParams,
) -> VideoHands:
    """Forearms of the body's result; hand keypoints in the first frame's image."""
    hands = _seen_hands(video)
    xy = warp(turned.H_first_from_frame[:, None], hands.xy_px.reshape(len(video.frames), 42, 2))
    xy = xy.reshape(hands.xy_px.shape)
    local = exp(torch.as_tensor(motion.theta).reshape(-1, 24, 3))
    R = world_rotations(local, SMPL_PARENTS)
    wrists = motion.joints[:, WRISTS]
    focal = 0.5 * (camera.K[0, 0] + camera.K[1, 1])
    hand_px = focal * skeleton.length_m.numpy() / np.maximum(wrists[..., 2], 0.1)
    weight = point_weights(
        xy,
        hands.confidence,
        hand_px,
        noise_share=params.noise_share,
        min_confidence=params.min_confidence,
        min_points=params.min_points,
    )
    return VideoHands(
        R_forearm=R[:, ELBOWS].transpose(0, 1),
        wrist_m=torch.as_tensor(wrists).transpose(0, 1),
        R_body=local[:, WRISTS].transpose(0, 1),
        K=torch.as_tensor(camera.K),
        fps=video.fps,
        xy_px=xy.swapaxes(0, 1),
        weight=weight.swapaxes(0, 1),
    )


def members_of(sync: SyncSummary) -> list[str]:
    """Videos that share their hands' motion: matched, as filmed, and at least two of them.

    A mirrored video's hands are looked at by themselves, like those of an excluded one.
    """
    apart = {*sync.mirrored, *sync.excluded}
    together = [i for i in sync.ids if i not in apart]
    return together if len(together) > 1 and sync.reference in together else []


def timeline_of(sync: SyncSummary, ids: list[str]) -> Timeline:
    """Correspondences of some videos, the reference among them."""
    maps = {m.id: m for m in sync.maps}
    length = sync.lengths[sync.ids.index(sync.reference)]
    return make_timeline(
        [maps[i].reference_frame for i in ids], [maps[i].confidence for i in ids], length
    )
