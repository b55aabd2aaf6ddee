"""The values of an npz file, and the tables beside every export: sync.csv and cameras.json."""

from __future__ import annotations

from pathlib import Path

from imocap_core.conventions import SMPL_JOINTS
from imocap_core.errors import WrongUse
from imocap_core.io.writers.camera_calibration import CameraCalibration
from imocap_core.io.writers.export_npz import (
    CameraFrames,
    ExportedHands,
    ExportedVideo,
    write_cameras,
    write_sync,
)
from imocap_core.result.camera import VideoCamera
from imocap_core.result.result import ActionResult
from imocap_core.result.synchronisation import Synchronisation
from imocap_core.result.video import VideoResult


def write_cameras_and_sync(out: Path, result: ActionResult) -> list[Path]:
    """sync.csv and cameras.json, of a result on the videos' own timelines."""
    videos = [npz_values(video, result) for video in result]
    return [write_sync_table(out, result.sync), write_cameras(out, videos, result.reference)]


def write_sync_table(out: Path, sync: Synchronisation) -> Path:
    """sync.csv."""
    summary = sync.summary
    return write_sync(
        out,
        {video.id: video.frames for video in sync.videos.values()},
        {m.id: (m.reference_frame, m.confidence) for m in summary.maps},
        summary.reference,
        None if summary.trust is None else {v.id: v.phase_s for v in summary.trust.videos},
    )


def per_frame(camera: VideoCamera) -> CameraFrames | None:
    """The camera of every frame; None where it is static."""
    if camera.is_static:
        return None
    return CameraFrames(camera.K_per_frame, camera.R_per_frame, camera.t_per_frame)


def calibration_of(camera: VideoCamera) -> CameraCalibration:
    """A camera as calibration files hold it; WrongUse for one that turns, zooms or moves."""
    if not camera.is_static:
        raise WrongUse(
            f"--format calib: the camera of {camera.id} turns, zooms or moves, and a calibration "
            "file holds one pose a camera; leave it out with --video, or export npz, which has "
            "the camera of every frame"
        )
    lens = tuple(camera.distortion.tolist())
    return CameraCalibration(camera.id, camera.size, camera.K, camera.R, camera.t, lens)


def npz_values(video: VideoResult, result: ActionResult) -> ExportedVideo:
    """One video as its npz file holds it."""
    hands = None
    if video.hands is not None:
        hands = ExportedHands(video.poses, video.hands.points, video.hands.visible)
    common = result.time == "common"
    return ExportedVideo(
        id=video.id,
        poses=video.theta,
        betas=video.betas,
        trans=video.trans,
        joints=video.body_joints,
        joint_names=tuple(SMPL_JOINTS),
        fps=video.fps,
        size=video.camera.size,
        frames=video.frames,
        K=video.camera.K,
        R=video.camera.R,
        t=video.camera.t,
        model=video.model,
        joint_sd_mm=video.uncertainty,
        per_frame=per_frame(video.camera),
        distortion=None if video.camera.lens is None else video.camera.distortion,
        up_axis=result.up_axis,
        hands=hands,
        inside=video.inside if common else None,
        phase_s=video.phase_s if common else None,
        time_s=None if video.keypoints.moments is None else video.time_s,
    )
