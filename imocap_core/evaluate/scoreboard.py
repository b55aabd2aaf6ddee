"""Every metric of one result: artifacts and the truth in their axes to rows of numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float, Int

from imocap_core import rotations
from imocap_core.adapters.relative_motion import Paths, paths_of, paths_of_initial
from imocap_core.adapters.sync_maps import maps_of
from imocap_core.artifacts.schemas import (
    Camera,
    CameraMotion,
    InitialSmpl,
    Keypoints,
    RefineSync,
    SmplBa,
    Sync,
    SyncSummary,
    VideoKeypoints,
    VideoMotion,
)
from imocap_core.body import Model, Posed
from imocap_core.body.model import rotations_from_pose
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.files import has_pose2sim_truth
from imocap_core.io.truth import Truth, VideoTruth, read_pose2sim_truth, read_truth
from imocap_core.metrics import scoring
from imocap_core.metrics.position import mean_joint_errors_mm, root_relative
from imocap_core.metrics.scoring import CameraJoints, ScoreRow
from imocap_core.metrics.sync import cycle_residual_frames, true_reference_frame
from imocap_core.metrics.trajectory import camera_place_errors_mm, focal_error_pct
from imocap_core.metrics.whole_body import segment_rotations
from imocap_core.motion.multiview.timeline import pose_at, sample_rotations, values_at

MONOCULAR, SINGLE_PASS, AFTER_LOOP = "monocular", "single pass", "after loop"


@dataclass(frozen=True)
class StageResult:
    """Motions in the order of the videos; cameras and synchronisation where the stage has them.

    paths: of moving cameras, where they are known.
    """

    name: str
    motions: list[VideoMotion]
    cameras: list[Camera] | None = None
    sync: SyncSummary | None = None
    paths: Paths | None = None


def stage_results(
    initial: InitialSmpl,
    sync: Sync,
    single: SmplBa,
    refined: RefineSync,
    camera_motion: CameraMotion,
) -> list[StageResult]:
    """The three results that are compared, in the order of the stages."""
    final, alone = refined.motion, paths_of_initial(initial, camera_motion)
    return [
        StageResult(MONOCULAR, initial.videos, paths=alone),
        StageResult(SINGLE_PASS, single.videos, single.cameras, sync, paths_of(single.cameras)),
        StageResult(AFTER_LOOP, final.videos, final.cameras, refined.sync, paths_of(final.cameras)),
    ]


def round_results(refined: RefineSync) -> list[StageResult]:
    """The results of the loop's rounds; round 0 is the single pass."""
    return [StageResult("round", r.motion.videos, r.motion.cameras, r.sync) for r in refined.rounds]


def action_truth(folder: Path, file: Path | None, keypoints: Keypoints) -> Truth | None:
    """The truth file that action.yaml names, or a calibrated rig's files in the action's folder.

    None when there is neither. ValueError names the file and the faulty field.
    """
    frames = {v.id: np.arange(v.frames[0], v.frames[-1] + 1) for v in keypoints.videos}
    if file is not None:
        truth = read_truth(file, frames)
    elif has_pose2sim_truth(folder):
        truth = read_pose2sim_truth(folder, frames)
    else:
        return None
    moving = {v.id: v.source_frames - v.frames[0] for v in keypoints.videos if v.moments}
    at_moments = {i: truth_at(truth.videos[i], position) for i, position in moving.items()}
    return replace(truth, videos=truth.videos | at_moments)


def truth_at(video: VideoTruth, position: Float[np.ndarray, " N"]) -> VideoTruth:
    """A video's truth at fractional frames: angles geodesically, the rest linearly."""

    def turned(R: Float[np.ndarray, "T ..."] | None) -> Float[np.ndarray, "N ..."] | None:
        if R is None:
            return None
        by_joint = torch.from_numpy(R.reshape(len(R), -1, 3, 3))
        return sample_rotations(by_joint, position).numpy().reshape(-1, *R.shape[1:])

    def moved(values: Float[np.ndarray, "T ..."] | None) -> Float[np.ndarray, "N ..."] | None:
        return None if values is None else values_at(values, position)

    return replace(
        video,
        joints=moved(video.joints),
        phase=moved(video.phase),
        hands=moved(video.hands),
        trans=moved(video.trans),
        theta=None if video.theta is None else pose_at(video.theta, position),
        R_frames=turned(video.R_frames),
        segments=turned(video.segments),
    )


def video_truth(truth: Truth | None, video: str) -> VideoTruth | None:
    """One video's truth; None when there is none."""
    return None if truth is None else truth.videos.get(video)


def consecutive(frames: Int[np.ndarray, " T"]) -> Int[np.ndarray, " T"]:
    """Numbers of used frames, one apart in time: of moments the nearest source frames, which may
    repeat, are not."""
    return frames[0] + np.arange(len(frames))


def true_joints(video: VideoTruth | None, frames: Int[np.ndarray, " T"]) -> CameraJoints | None:
    """True joints in the axes of the video's camera; None when joints or camera are unknown."""
    if video is None or video.joints is None or video.R is None or video.t is None:
        return None
    assert len(video.joints) == len(frames), "truth and result must have the same frames"
    joints = video.joints @ video.R.T + video.t
    return CameraJoints(joints, video.joint_names, consecutive(frames))


def true_rotations(video: VideoTruth | None) -> Float[np.ndarray, "T 24 3 3"] | None:
    """True joint rotations relative to the parent joint, the root's in the axes of the video's
    camera; None when pose or camera are unknown."""
    if video is None or video.theta is None or video.R is None:
        return None
    R_local = rotations_from_pose(torch.from_numpy(video.theta)).numpy()
    R_local[:, 0] = video.R @ R_local[:, 0]
    return np.asarray(R_local)


def true_segments(video: VideoTruth | None) -> dict[str, Float[np.ndarray, "T 3 3"]]:
    """SMPL joint -> true rotation of its segment in the axes of the video's camera.

    Of a captured skeleton's segments, or of the true pose; empty without either.
    """
    R_local = true_rotations(video)
    if R_local is not None:
        return segment_rotations(R_local)
    if video is None or video.segments is None or video.R is None:
        return {}
    turned = video.R @ video.segments
    return {name: turned[:, k] for k, name in enumerate(video.segment_joints)}


def true_body(video: VideoTruth | None, model: Model) -> Posed | None:
    """The true body in the axes of the video's camera; None when pose, place, shape or camera are
    unknown. The truth must be that of `model`."""
    R_local = true_rotations(video)
    if R_local is None or video is None or video.trans is None or video.betas is None:
        return None
    if video.R is None or video.t is None:
        return None
    shaped = model.shape(torch.from_numpy(video.betas).to(model.v_template))
    # the root turns about the pelvis, not the origin
    pelvis_rest = shaped.joints_rest[0].cpu().numpy()
    transl = (pelvis_rest + video.trans) @ video.R.T + video.t - pelvis_rest
    return shaped.pose(*(torch.from_numpy(x).to(model.v_template) for x in (R_local, transl)))


def true_positions(sync: SyncSummary, truth: Truth | None) -> dict[str, Float[np.ndarray, " _"]]:
    """Video id -> true (fractional) index into the reference's used frames, for videos whose true
    phases are known."""
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


@dataclass(frozen=True)
class BodyPoints:
    """Points in camera axes, metres.

    keypoints_m: in the layout of the detections. K: intrinsics with which the result projects.
    """

    nose_m: Float[np.ndarray, "T 3"]
    keypoints_m: Float[np.ndarray, "T K 3"]
    K: Float[np.ndarray, "3 3"]


def body_points(
    model: Model, motion: VideoMotion, layout: str, K: Float[np.ndarray, "3 3"]
) -> BodyPoints:
    """Keypoints of a layout and the nose in every frame of a motion, in its camera's axes."""
    posed = posed_body(model, motion, list(range(len(motion.frames))))
    with_nose = model.points("coco17")
    nose = posed.keypoints(with_nose)[..., with_nose.names.index("nose"), :]
    return BodyPoints(nose.cpu().numpy(), posed.keypoints(model.points(layout)).cpu().numpy(), K)


def posed_body(model: Model, motion: VideoMotion, frames: list[int]) -> Posed:
    """The body at some frames (indices) of a motion, in its camera's axes."""
    arrays = (motion.theta[frames], motion.trans[frames], motion.betas)
    theta, transl, betas = (torch.from_numpy(x).to(model.device) for x in arrays)
    by_joint = theta.reshape(len(frames), -1, 3)
    return model.shape(betas).pose(rotations.exp(by_joint), transl)


ROTATION, PLACE, FOCAL = "camera_rotation_error_deg", "camera_place_error_mm", "focal_error_pct"
CAMERA_METRICS = (ROTATION, PLACE, FOCAL)
LEAST_PLACES = 3  # cameras: a similarity brings any two onto any two others
UNKNOWN = "the true cameras are not known"


def camera_rows(
    name: str, cameras: Sequence[Camera], sync: SyncSummary, truth: Truth | None
) -> list[ScoreRow]:
    """Every camera's errors; rows without a value have the reason."""
    true = {} if truth is None else truth.videos
    why = {camera.id: _left_out(camera.id, sync) for camera in cameras}
    scored = [camera for camera in cameras if not why[camera.id]]
    rows = _rotations(name, cameras, sync, true, why)
    rows += _places(name, scored, true)
    true_K = {i: v.K for i, v in true.items() if v.K is not None}
    for camera in (c for c in scored if c.id in true_K):
        error = focal_error_pct(camera.K[0, 0], true_K[camera.id][0, 0])
        rows.append(scoring.scored_row(name, camera.id, FOCAL, error, "not recovered"))
    have = {row.metric for row in rows}
    return rows + [
        ScoreRow(name, camera.id, metric, None, UNKNOWN)
        for metric in (PLACE, FOCAL)
        if metric not in have
        for camera in cameras
    ]


def _left_out(video: str, sync: SyncSummary) -> str:
    """Why a camera is not scored; empty where it is."""
    if video in sync.excluded:
        return "excluded"
    mirrored = {video, sync.reference} & {*sync.mirrored}
    return "mirrored: its world is a reflection" if mirrored else ""


def _rotations(
    name: str,
    cameras: Sequence[Camera],
    sync: SyncSummary,
    true: Mapping[str, VideoTruth],
    why: Mapping[str, str],
) -> list[ScoreRow]:
    """Of every camera but the reference's."""
    true_R = {i: v.R for i, v in true.items() if v.R is not None}
    estimated = {camera.id: camera.R for camera in cameras}
    reference, rows = sync.reference, []
    for video in (i for i in estimated if i != reference):
        if why[video]:
            rows.append(ScoreRow(name, video, ROTATION, None, why[video]))
        elif video in true_R and reference in true_R:
            pair = (estimated[video], estimated[reference], true_R[video], true_R[reference])
            rows.append(scoring.camera_row(name, video, *pair))
        else:
            rows.append(ScoreRow(name, video, ROTATION, None, UNKNOWN))
    return rows


def _places(name: str, scored: Sequence[Camera], true: Mapping[str, VideoTruth]) -> list[ScoreRow]:
    """Of the cameras whose true place is known."""
    true_centre = {i: -v.R.T @ v.t for i, v in true.items() if v.R is not None and v.t is not None}
    cameras = [camera for camera in scored if camera.id in true_centre]
    if not cameras:
        return []
    if len(cameras) < LEAST_PLACES:
        why = f"places are compared from {LEAST_PLACES} cameras on"
        return [ScoreRow(name, camera.id, PLACE, None, why) for camera in cameras]
    centres = np.array([-c.R.T @ c.t for c in cameras])
    errors = camera_place_errors_mm(centres, np.array([true_centre[c.id] for c in cameras]))
    return [
        scoring.scored_row(name, camera.id, PLACE, float(error), "not recovered")
        for camera, error in zip(cameras, errors, strict=True)
    ]


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
    name: str, video: VideoKeypoints, body: BodyPoints, xy_first_px: Float[np.ndarray, "T K 2"]
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
