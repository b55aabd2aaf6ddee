"""Every metric of one result: artifacts and truth to rows of numbers, video by video."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float

from imocap_core.artifacts.schemas import Keypoints, Sync, SyncSummary, VideoKeypoints
from imocap_core.artifacts.schemas.motion import VideoMotion
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.evaluate.body_points import BodyPoints
from imocap_core.evaluate.camera_scores import camera_rows
from imocap_core.evaluate.results import StageResult
from imocap_core.evaluate.truth import (
    consecutive,
    true_joints,
    true_positions,
    video_truth,
)
from imocap_core.io.truth import Truth, VideoTruth
from imocap_core.metrics import scoring
from imocap_core.metrics.joints import root_relative
from imocap_core.metrics.position import mean_joint_errors_mm
from imocap_core.metrics.scoring import CameraJoints, ScoreRow
from imocap_core.metrics.sync import cycle_residual_frames
from imocap_core.problem.sync_maps import maps_of


def score(
    result: StageResult,
    keypoints: Keypoints,
    truth: Truth | None,
    points: Mapping[str, BodyPoints],
    xy_first_px: Mapping[str, Float[np.ndarray, "_ _ 2"]],
) -> list[ScoreRow]:
    """Every metric of one result, all videos; rows without a value have the reason.

    Args:
        points: video id -> the result's body points. xy_first_px: video id -> (T, K, 2) detections
            in the image of the first used frame.
    """
    rows: list[ScoreRow] = []
    for video, motion in zip(keypoints.videos, result.motions, strict=True):
        body, true = points[video.id], video_truth(truth, video.id)
        rows += _pose(result.name, video, motion, true, body.nose_m)
        rows += _image(result.name, video, body, xy_first_px[video.id])
    if result.cameras is not None and result.sync is not None:
        rows += camera_rows(result.name, result.cameras, result.sync, truth)
    if result.sync is not None:
        rows += _sync(result.name, result.sync, keypoints, truth)
    return rows


def against_truth(
    result: StageResult,
    keypoints: Keypoints,
    truth: Truth | None,
    noses: Mapping[str, Float[np.ndarray, "_ 3"]] | None = None,
) -> dict[str, float]:
    """Metric -> mean over the videos, for metrics that need neither images nor the body's surface.

    noses: video id -> (T, 3) in camera axes, for the set of 17 joints.
    """
    rows: list[ScoreRow] = []
    for video, motion in zip(keypoints.videos, result.motions, strict=True):
        true = video_truth(truth, video.id)
        rows += _pose(result.name, video, motion, true, (noses or {}).get(video.id))
    if result.cameras is not None and result.sync is not None:
        rows += camera_rows(result.name, result.cameras, result.sync, truth)
        rows += _sync(result.name, result.sync, keypoints, truth)
    return scoring.means_over_videos(rows)


def cycle_row(name: str, sync: Sync) -> ScoreRow:
    """The cycle residual of the videos that are not excluded."""
    used = {v for v, name in enumerate(sync.ids) if name not in sync.excluded}
    pairs = maps_of(sync).pairs.items()
    value = cycle_residual_frames({p: m.largest() for p, m in pairs if used.issuperset(p)})
    if np.isfinite(value):
        return ScoreRow(name, scoring.ALL_VIDEOS, "cycle_residual_frames", value)
    return ScoreRow(
        name, scoring.ALL_VIDEOS, "cycle_residual_frames", None, "there is one video only"
    )


def joint_errors_mm(
    result: StageResult, truth: Truth | None, joints: Sequence[str]
) -> Float[np.ndarray, " J"] | None:
    """Mean error of each of the named joints over frames, then videos; None without truth."""
    errors = []
    for motion in result.motions:
        true = true_joints(video_truth(truth, motion.id), motion.frames)
        if true is None or not set(joints) <= set(true.names):
            continue
        pair = (
            root_relative(motion.joints, SMPL_JOINTS, joints),
            root_relative(true.joints_m, true.names, joints),
        )
        errors.append(mean_joint_errors_mm(*pair))
    return np.mean(errors, axis=0) if errors else None


def _pose(
    name: str,
    video: VideoKeypoints,
    motion: VideoMotion,
    truth: VideoTruth | None,
    nose_m: Float[np.ndarray, "T 3"] | None = None,
) -> list[ScoreRow]:
    true = true_joints(truth, motion.frames)
    if true is None:
        unknown = truth is None or truth.joints is None
        why = "no truth" if unknown else "the true camera is not known"
        return [ScoreRow(name, video.id, metric, None, why) for metric in scoring.POSE_METRICS]
    predicted = CameraJoints(motion.joints, SMPL_JOINTS, consecutive(motion.frames))
    if nose_m is not None:
        joints = np.concatenate([motion.joints, nose_m[:, None]], axis=1)
        predicted = CameraJoints(joints, (*SMPL_JOINTS, "nose"), predicted.frames)
    return scoring.pose_rows(name, video.id, predicted, true, video.fps)


def _image(
    name: str,
    video: VideoKeypoints,
    body: BodyPoints,
    xy_first_px: Float[np.ndarray, "T K 2"],
) -> list[ScoreRow]:
    heights = video.person_box_px[:, 3] - video.person_box_px[:, 1]
    height = float(np.nanmedian(heights)) if np.isfinite(heights).any() else float("nan")
    return scoring.reprojection_rows(
        name, video.id, body.keypoints_m, body.K, xy_first_px, video.confidence, height
    )


def _sync(
    name: str, sync: SyncSummary, keypoints: Keypoints, truth: Truth | None
) -> list[ScoreRow]:
    videos = {v.id: v for v in keypoints.videos}
    reference = videos[sync.reference]
    frames = {i: consecutive(video.frames) for i, video in videos.items()}
    used = np.arange(len(reference.frames))
    with_truth = true_positions(sync, truth)
    rows = []
    for sync_map in (m for m in sync.maps if m.id != sync.reference):
        video = sync_map.id
        if video in sync.excluded or video not in with_truth or truth is None:
            why = "excluded" if video in sync.excluded else "no true phases"
            rows += [ScoreRow(name, video, metric, None, why) for metric in scoring.SYNC_METRICS]
            continue
        phase, reference_phase = (truth.videos[i].phase for i in (video, sync.reference))
        assert phase is not None  # true_positions has videos with phases only
        assert reference_phase is not None
        rows += scoring.sync_rows(
            name,
            video,
            np.interp(sync_map.reference_frame, used, frames[sync.reference]),
            frames[video],
            phase,
            frames[sync.reference],
            reference_phase,
            truth.phase_end or float(np.nanmax(reference_phase)),
            reference.fps,
        )
    return rows
