"""From the artifacts of an action to its result in one world."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Literal, TypeVar

import numpy as np

from imocap_core.adapters.ground import ground_of
from imocap_core.adapters.lenses import lenses_of
from imocap_core.artifacts.schemas import (
    Camera,
    CameraMotion,
    Hands,
    InitialSmpl,
    Keypoints,
    RefineSync,
    SmplBa,
    Sync,
    SyncSummary,
    Uncertainty,
    VideoCameraMotion,
    VideoHands,
    VideoKeypoints,
    VideoMotion,
    VideoUncertainty,
)
from imocap_core.camera.gravity import BodyMotion, Extrinsics, to_world
from imocap_core.errors import WorkFailed
from imocap_core.pipeline.action import read_action
from imocap_core.result.artifacts import Artifacts
from imocap_core.result.result import ActionResult
from imocap_core.result.video import (
    HandMotion,
    JointUncertainty,
    VideoCamera,
    VideoResult,
    synchronisation_of,
)
from imocap_core.result.video_motion import ground_under, with_points, without_points

Stage = Literal["refine_sync", "smpl_ba"]
NONE = np.zeros(0, dtype=np.int64)  # frames of a video that is missing
Kind = TypeVar("Kind", bound=ActionResult)


def read_result(
    artifacts: Artifacts, kind: type[Kind], folder: Path | None = None, stage: Stage = "refine_sync"
) -> Kind:
    """The result in the reference camera's axes, on the videos' own timelines.

    Args:
        artifacts: of the action.
        kind: the class to make.
        folder: of action.yaml, which paths of videos are relative to; None when unknown.
        stage: whose motion it is: of the loop of synchronisation and motion, or of the first joint
            solve, before that loop.

    WorkFailed when an artifact is missing, damaged, or of other frames than the motion.
    """
    keypoints = artifacts.get(Keypoints)
    motion, summary = _solved(artifacts, stage)
    frames = {v.id: v.frames for v in motion.videos}
    _check_frames(artifacts, "keypoints", {v.id: v.frames for v in keypoints.videos}, frames)
    source = {v.id: v.source_frames for v in keypoints.videos}
    sync = synchronisation_of(summary, source, {v.id: v.fps for v in keypoints.videos})
    camera_motion, hands = artifacts.find(CameraMotion), artifacts.find(Hands)
    uncertainty = artifacts.find(Uncertainty) if stage == "refine_sync" else None
    turned = {} if camera_motion is None else {v.id: v for v in camera_motion.videos}
    fingers = {} if hands is None else {v.id: v for v in hands.videos}
    sigmas = {} if uncertainty is None else {v.id: v for v in uncertainty.videos}
    _check_frames(artifacts, "hands", {i: v.frames for i, v in fingers.items()}, frames)
    _check_frames(artifacts, "uncertainty", {i: v.frames for i, v in sigmas.items()}, frames)
    cameras = {camera.id: camera for camera in motion.cameras}
    detections = {v.id: v for v in keypoints.videos}
    refined = artifacts.get(RefineSync) if stage == "refine_sync" else None
    files = _files(keypoints, folder)
    lenses = {} if camera_motion is None else lenses_of(camera_motion, refined)
    placed = []
    for v in motion.videos:
        video = VideoResult(
            id=v.id,
            action=artifacts.action,
            keypoints=detections[v.id],
            video=files.get(v.id),
            camera=replace(
                _camera(cameras[v.id], turned.get(v.id), detections[v.id]), lens=lenses.get(v.id)
            ),
            fps=detections[v.id].fps,
            frames=detections[v.id].source_frames,
            inside=np.ones(len(v.frames), dtype=bool),
            phase_s=sync[v.id].phase_s,
            confidence=sync[v.id].confidence,
            theta=v.theta,
            betas=v.betas,
            trans=v.trans,
            body_joints=v.joints,
            hands=_hands(fingers.get(v.id)),
            reprojection_px=v.reprojection_px,
            joint_uncertainty=_uncertainty(sigmas.get(v.id)),
            sync=sync,
            model=f"{motion.model} {motion.model_digest}",
        )
        placed.append(_in_world(video))
    plane = motion.ground
    return kind(
        action=artifacts.action,
        videos=tuple(placed),
        ground=ground_under(placed, sync.excluded) if plane is None else ground_of(plane),
        reference=motion.reference,
        sync=sync,
        artifacts=artifacts,
        folder=folder,
    )


def read_monocular(artifacts: Artifacts) -> list[VideoMotion]:
    """Monocular motions, each in the axes of its first-frame camera, in the order of the
    keypoints. WorkFailed when they are missing or of other frames than the keypoints."""
    videos = artifacts.get(InitialSmpl).videos
    frames = {v.id: v.frames for v in artifacts.get(Keypoints).videos}
    _check_frames(artifacts, "initial_smpl", {v.id: v.frames for v in videos}, frames)
    return videos


def _solved(artifacts: Artifacts, stage: Stage) -> tuple[SmplBa, SyncSummary]:
    if stage == "smpl_ba":
        return artifacts.get(SmplBa), artifacts.get(Sync)
    refined = artifacts.get(RefineSync)
    return refined.motion, refined.sync


def _check_frames(
    artifacts: Artifacts,
    stage: str,
    frames: Mapping[str, np.ndarray],
    expected: Mapping[str, np.ndarray],
) -> None:
    """WorkFailed when a stage's artifact, where it has any video, is of other frames."""
    wrong = [v for v in expected if frames and not np.array_equal(frames.get(v, NONE), expected[v])]
    if wrong:
        raise WorkFailed(
            f"{artifacts.action}: its artifacts are of different frames ({stage} of "
            f"{', '.join(wrong)}); {artifacts.advice}"
        )


def _files(keypoints: Keypoints, folder: Path | None) -> dict[str, Path]:
    """The video files that exist, where the action.yaml of a folder has them now."""
    if folder is None:
        return {}
    places = {video.id: video.video for video in keypoints.videos}
    with suppress(WorkFailed):
        places |= {video.id: video.video for video in read_action(folder).videos}
    paths = {video: folder / place for video, place in places.items() if place is not None}
    return {video: path for video, path in paths.items() if path.is_file()}


def _camera(
    camera: Camera, turned: VideoCameraMotion | None, detections: VideoKeypoints
) -> VideoCamera:
    """A camera whose own motion is unknown, as its stage has not run, counts as static."""
    count = len(detections.frames)
    if turned is None or len(turned.zoom) != count:
        still = np.tile(np.eye(3), (count, 1, 1))
        turns, zoom, H_first_from_frame = still, np.ones(count), still
    else:
        turns, zoom = turned.R_first_from_frame, turned.zoom
        H_first_from_frame = turned.H_first_from_frame
    return VideoCamera(
        id=camera.id,
        size=detections.size,
        K=camera.K,
        R=camera.R,
        t=camera.t,
        R_first_from_frame=turns,
        zoom=zoom,
        H_first_from_frame=H_first_from_frame,
        path_m=camera.path_m if len(camera.path_m) == count else None,
    )


def _hands(hands: VideoHands | None) -> HandMotion | None:
    if hands is None:
        return None
    return HandMotion(hands.wrists, hands.fingers, hands.points_m, hands.visible > 0)


def _uncertainty(given: VideoUncertainty | None) -> JointUncertainty | None:
    if given is None:
        return None
    return JointUncertainty(
        given.sigma_mm,
        given.covariance_mm2,
        given.rotation_covariance_deg2,
        given.deviation_covariance_deg2,
        given.camera_rotation_deg,
    )


def _in_world(video: VideoResult) -> VideoResult:
    """From the axes of the video's first-frame camera to the world's."""
    body = with_points(BodyMotion(video.theta, video.trans, video.body_joints), video.hands)
    placed = to_world(body, Extrinsics(video.camera.R, video.camera.t))
    body, hands = without_points(placed, video.hands)
    return replace(video, theta=body.theta, trans=body.trans, body_joints=body.joints, hands=hands)
