"""Artifacts and truth to rows of numbers: which result is compared with what, video by video."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imocap_core.artifacts.schemas import Camera, Keypoints, Sync, SyncSummary, VideoKeypoints
from imocap_core.artifacts.schemas.motion import VideoMotion
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.io.truth import Truth, VideoTruth
from imocap_core.metrics import scoring
from imocap_core.metrics.joints import root_relative
from imocap_core.metrics.position import mean_joint_errors_mm
from imocap_core.metrics.scoring import CameraJoints, ScoreRow
from imocap_core.metrics.sync import cycle_residual_frames, true_reference_frame

Array = NDArray[np.float64]


@dataclass(frozen=True)
class StageResult:
    """What one stage says: motions, and from the second on cameras and correspondences."""

    name: str  # "monocular", "single pass", "after loop"
    motions: list[VideoMotion]
    cameras: list[Camera] | None = None
    sync: SyncSummary | None = None


@dataclass(frozen=True)
class BodyPoints:
    """Points of a posed body that an answer's joints alone do not give, in camera axes."""

    nose_m: Array  # (T, 3)
    keypoints_m: Array  # (T, K, 3) in the layout of the detections
    K: Array  # (3, 3) the camera that the answer projects with


def score(
    answer: StageResult,
    keypoints: Keypoints,
    truth: Truth | None,
    points: Mapping[str, BodyPoints],
    xy_first_px: Mapping[str, Array],
) -> list[ScoreRow]:
    """Every metric of one answer, all videos; rows of what cannot be scored say why.

    Args:
        points: video id -> the answer's body points. xy_first_px: video id -> (T, K, 2) detections
            in the image of the first used frame.
    """
    rows: list[ScoreRow] = []
    for seen, motion in zip(keypoints.videos, answer.motions, strict=True):
        own = None if truth is None else truth.videos.get(seen.id)
        rows += _pose(answer.name, seen, motion, own, points[seen.id].nose_m)
        rows += _image(answer.name, seen, points[seen.id], xy_first_px[seen.id])
    if answer.cameras is not None and answer.sync is not None:
        rows += _cameras(answer.name, answer.cameras, answer.sync, truth)
    if answer.sync is not None:
        rows += _sync(answer.name, answer.sync, keypoints, truth)
    return rows


def against_truth(
    answer: StageResult,
    keypoints: Keypoints,
    truth: Truth | None,
    noses: Mapping[str, Array] | None = None,
) -> dict[str, float]:
    """Metric -> mean over the videos, of what needs neither images nor the body's surface.

    ``noses``: video id -> (T, 3) in camera axes, for the set of 17 joints.
    """
    rows: list[ScoreRow] = []
    for seen, motion in zip(keypoints.videos, answer.motions, strict=True):
        own = None if truth is None else truth.videos.get(seen.id)
        rows += _pose(answer.name, seen, motion, own, (noses or {}).get(seen.id))
    if answer.cameras is not None and answer.sync is not None:
        rows += _cameras(answer.name, answer.cameras, answer.sync, truth)
        rows += _sync(answer.name, answer.sync, keypoints, truth)
    return {row.metric: row.value for row in scoring.over_videos(rows) if row.value is not None}


def cycle_row(name: str, sync: Sync) -> ScoreRow:
    """How far frames land from where they started after going round the videos."""
    used = [n for i, n in zip(sync.ids, sync.lengths, strict=True) if i not in sync.excluded]
    kept = np.repeat([i not in sync.excluded for i in sync.ids], sync.lengths)
    value = cycle_residual_frames(sync.relaxed[np.ix_(kept, kept)], used)
    if np.isfinite(value):
        return ScoreRow(name, scoring.ALL_VIDEOS, "cycle_residual_frames", value)
    return ScoreRow(
        name, scoring.ALL_VIDEOS, "cycle_residual_frames", None, "there is one video only"
    )


def true_positions(sync: SyncSummary, truth: Truth | None) -> dict[str, Array]:
    """Video id -> (T,) true index into the reference's used frames; only videos with truth."""
    phases = {} if truth is None else {i: v.phase for i, v in truth.videos.items()}
    reference = phases.get(sync.reference)
    if reference is None or len(reference) != sync.lengths[sync.ids.index(sync.reference)]:
        return {}
    used = np.arange(len(reference))
    return {
        i: true_reference_frame(phase, used, reference)
        for i, length in zip(sync.ids, sync.lengths, strict=True)
        if (phase := phases.get(i)) is not None and i != sync.reference and len(phase) == length
    }


def joint_errors_mm(
    answer: StageResult, truth: Truth | None, wanted: Sequence[str]
) -> Array | None:
    """Mean error of each wanted joint (J,) over frames, then videos; None without truth."""
    errors = []
    for motion in answer.motions:
        own = None if truth is None else truth.videos.get(motion.id)
        true = None if own is None else true_motion(own, motion.frames)
        if true is None or not set(wanted) <= set(true.names):
            continue
        pair = (
            root_relative(motion.joints, SMPL_JOINTS, wanted),
            root_relative(true.joints_m, true.names, wanted),
        )
        errors.append(mean_joint_errors_mm(*pair))
    return np.mean(errors, axis=0) if errors else None


def true_motion(own: VideoTruth, frames: NDArray[np.int64]) -> CameraJoints | None:
    """True joints in the axes of the video's camera; None when joints or camera are not known."""
    if own.joints is None or own.R is None or own.t is None:
        return None
    assert len(own.joints) == len(frames), "readers of truth give the used frames"
    return CameraJoints(own.joints @ own.R.T + own.t, own.joint_names, frames)


def _pose(
    name: str,
    seen: VideoKeypoints,
    motion: VideoMotion,
    own: VideoTruth | None,
    nose_m: Array | None = None,
) -> list[ScoreRow]:
    true = None if own is None else true_motion(own, motion.frames)
    if true is None:
        why = "no truth" if own is None or own.joints is None else "the true camera is not known"
        return [ScoreRow(name, seen.id, metric, None, why) for metric in scoring.POSE_METRICS]
    predicted = CameraJoints(motion.joints, SMPL_JOINTS, motion.frames)
    if nose_m is not None:
        joints = np.concatenate([motion.joints, nose_m[:, None]], axis=1)
        predicted = CameraJoints(joints, (*SMPL_JOINTS, "nose"), motion.frames)
    return scoring.pose_rows(name, seen.id, predicted, true, seen.fps)


def _image(name: str, seen: VideoKeypoints, body: BodyPoints, xy_first_px: Array) -> list[ScoreRow]:
    heights = seen.person_box_px[:, 3] - seen.person_box_px[:, 1]
    height = float(np.nanmedian(heights)) if np.isfinite(heights).any() else float("nan")
    return scoring.reprojection_rows(
        name, seen.id, body.keypoints_m, body.K, xy_first_px, seen.confidence, height
    )


def _cameras(
    name: str, cameras: Sequence[Camera], sync: SyncSummary, truth: Truth | None
) -> list[ScoreRow]:
    reference = sync.reference
    known = {} if truth is None else {i: v.R for i, v in truth.videos.items() if v.R is not None}
    found = {camera.id: camera.R for camera in cameras}
    rows = []
    for video in (i for i in found if i != reference):
        if video in sync.excluded or {video, reference} & {*sync.mirrored}:
            why = "excluded" if video in sync.excluded else "mirrored: it stands in another world"
            rows.append(ScoreRow(name, video, "camera_rotation_error_deg", None, why))
        elif video in known and reference in known:
            pair = (found[video], found[reference], known[video], known[reference])
            rows.append(scoring.camera_row(name, video, *pair))
        else:
            why = "the true cameras are not known"
            rows.append(ScoreRow(name, video, "camera_rotation_error_deg", None, why))
    return rows


def _sync(
    name: str, sync: SyncSummary, keypoints: Keypoints, truth: Truth | None
) -> list[ScoreRow]:
    videos = {v.id: v for v in keypoints.videos}
    reference = videos[sync.reference]
    used = np.arange(len(reference.frames))
    known = true_positions(sync, truth)
    rows = []
    for found in (m for m in sync.maps if m.id != sync.reference):
        if found.id in sync.excluded:
            why = "excluded"
            rows += [ScoreRow(name, found.id, metric, None, why) for metric in scoring.SYNC_METRICS]
            continue
        if found.id not in known or truth is None:
            why = "no true phases"
            rows += [ScoreRow(name, found.id, metric, None, why) for metric in scoring.SYNC_METRICS]
            continue
        phase, reference_phase = (truth.videos[i].phase for i in (found.id, sync.reference))
        assert phase is not None  # true_positions speaks of videos with phases only
        assert reference_phase is not None
        rows += scoring.sync_rows(
            name,
            found.id,
            np.interp(found.reference_frame, used, reference.frames),
            videos[found.id].frames,
            phase,
            reference.frames,
            reference_phase,
            truth.phase_end or float(np.nanmax(reference_phase)),
            reference.fps,
        )
    return rows
