"""The hands' problem: from artifacts to what is fitted, and back."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import torch

from imocap_core.adapters.lenses import undistorted_px
from imocap_core.adapters.relative_motion import paths_of, relative_motions
from imocap_core.artifacts.schemas import (
    Camera,
    CameraMotion,
    HandKeypoints,
    Hands,
    Keypoints,
    RefineSync,
    SyncSummary,
    VideoCameraMotion,
    VideoHands,
    VideoKeypoints,
    VideoMotion,
)
from imocap_core.body import Model
from imocap_core.body.kinematics import world_rotations
from imocap_core.camera.projection import warp
from imocap_core.conventions import SIDES, SMPL_JOINTS, SMPL_PARENTS
from imocap_core.hands.hand_fit import USUAL, FittedHands
from imocap_core.hands.hand_objective import ArmsAndHands, point_weights
from imocap_core.hands.hand_skeleton import HandSkeleton, hand_skeleton
from imocap_core.motion.multiview.timeline import Timeline, make_timeline
from imocap_core.rotations import exp, log, unwrap

ELBOWS = [SMPL_JOINTS.index(f"{side}_elbow") for side in SIDES]
WRISTS = [SMPL_JOINTS.index(f"{side}_wrist") for side in SIDES]
NEAREST_M = 0.1  # least depth of a wrist


@dataclass(frozen=True)
class HandGroup:
    """Videos whose hands are fitted together; one by itself has no timeline.

    Attributes:
        reference: index of the video whose frames the timeline counts.
    """

    ids: list[str]
    videos: list[ArmsAndHands]
    timeline: Timeline | None
    reference: int


@dataclass(frozen=True)
class HandsProblem:
    """The hands of one performer in all videos; the videos that share a motion come first."""

    skeleton: HandSkeleton
    groups: list[HandGroup]


def hands_problem(
    body: Model, keypoints: Keypoints, camera_motion: CameraMotion, refined: RefineSync
) -> HandsProblem:
    """The hands' problem; body: a model with fingers, given the reference's shape."""
    sync, reference = refined.sync, refined.sync.reference
    solved = {c.id: c for c in refined.motion.cameras}
    filmed = relative_motions(refined.motion.videos, paths_of(refined.motion.cameras))
    motions = {v.id: v for v in filmed}
    moving = {c.id: c for c in camera_motion.videos}
    skeleton = hand_skeleton(
        body.shape(torch.as_tensor(motions[reference].betas).to(body.v_template))
    )
    videos = {
        v.id: _arms_and_hands(v, moving[v.id], solved[v.id], motions[v.id], skeleton)
        for v in keypoints.videos
    }
    together = _members_of(sync)
    groups = [HandGroup([i], [videos[i]], None, 0) for i in videos if i not in together]
    if together:
        arms = [videos[i] for i in together]
        timeline = _timeline_of(sync, together)
        groups.insert(0, HandGroup(together, arms, timeline, together.index(reference)))
    return HandsProblem(skeleton, groups)


def _arms_and_hands(
    video: VideoKeypoints,
    moving: VideoCameraMotion,
    camera: Camera,
    motion: VideoMotion,
    skeleton: HandSkeleton,
) -> ArmsAndHands:
    """Forearms of the body's result; hand keypoints in the first frame's image."""
    hands = _hand_keypoints(video)
    pixels = undistorted_px(hands.xy_px.reshape(len(video.frames), 42, 2), moving.lens, moving.K)
    xy = warp(moving.H_first_from_frame[:, None], pixels)
    xy = xy.reshape(hands.xy_px.shape)
    template = skeleton.bones
    local = exp(torch.as_tensor(motion.theta).to(template).reshape(-1, 24, 3))
    R = world_rotations(local, SMPL_PARENTS)
    wrists = motion.joints[:, WRISTS]
    focal = 0.5 * (camera.K[0, 0] + camera.K[1, 1])
    hand_px = focal * skeleton.length_m.cpu().numpy() / np.maximum(wrists[..., 2], NEAREST_M)
    weight = point_weights(xy, hands.confidence, hand_px, USUAL)
    return ArmsAndHands(
        R_forearm=R[:, ELBOWS].transpose(0, 1),
        wrist_m=torch.as_tensor(wrists).to(template).transpose(0, 1),
        R_body=local[:, WRISTS].transpose(0, 1),
        K=torch.as_tensor(camera.K).to(template),
        fps=video.fps,
        xy_px=xy.swapaxes(0, 1),
        weight=weight.swapaxes(0, 1),
    )


def _hand_keypoints(video: VideoKeypoints) -> HandKeypoints:
    if video.hands is not None:
        return video.hands
    nothing = np.full((len(video.frames), 2, 21, 2), np.nan)
    return HandKeypoints(xy_px=nothing, confidence=np.zeros(nothing.shape[:3]))


def _members_of(sync: SyncSummary) -> list[str]:
    """Videos that share their hands' motion: matched, as filmed, and at least two of them.

    A mirrored video's hands are fitted by themselves, like those of an excluded one.
    """
    apart = {*sync.mirrored, *sync.excluded}
    together = [i for i in sync.ids if i not in apart]
    return together if len(together) > 1 and sync.reference in together else []


def _timeline_of(sync: SyncSummary, ids: list[str]) -> Timeline:
    """Correspondences of some videos, the reference among them."""
    maps = {m.id: m for m in sync.maps}
    length = sync.lengths[sync.ids.index(sync.reference)]
    return make_timeline(
        [maps[i].reference_frame for i in ids], [maps[i].confidence for i in ids], length
    )


def hands_of(
    body: Model,
    keypoints: Keypoints,
    refined: RefineSync,
    fitted: Mapping[str, FittedHands],
    size: float,
) -> Hands:
    """The artifact; fitted: every video's hands; size: of the videos that share a motion."""
    frames = {v.id: v.frames for v in refined.motion.videos}
    videos = [_stored(v.id, frames[v.id], fitted[v.id]) for v in keypoints.videos]
    shares = [f"{v.id} {100 * v.visible.mean():.0f} %" for v in videos]
    return Hands(
        videos=videos,
        model=body.name,
        model_digest=body.digest,
        size=size,
        status=f"seen: {', '.join(shares)} of both hands in all frames",
    )


def no_hands() -> Hands:
    """The artifact where no keypoints have hands."""
    return Hands(videos=[], model="", model_digest="", size=1.0, status="no hand keypoints")


def _stored(name: str, frames: np.ndarray, hands: FittedHands) -> VideoHands:
    return VideoHands(
        id=name,
        frames=frames,
        fingers=hands.finger_vectors.cpu().numpy(),
        wrists=unwrap(log(hands.R_wrist)).cpu().numpy(),
        points_m=hands.points_m.cpu().numpy(),
        visible=hands.visible.cpu().numpy().astype("int64"),
    )
