"""Whole-body metrics of one result: each joint, rotations, the surface, the motion in the world."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import astuple

import numpy as np
import torch

from imocap_core.artifacts.schemas import Keypoints, VideoKeypoints
from imocap_core.artifacts.schemas.motion import VideoMotion
from imocap_core.body import Model, Posed
from imocap_core.body.conversions import rotations_from_pose
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.evaluate.body_points import posed_body
from imocap_core.evaluate.results import StageResult
from imocap_core.evaluate.surface import (
    SurfaceMeasures,
    foot_points_m,
    measure_surfaces,
    surface_mesh,
)
from imocap_core.evaluate.truth import (
    consecutive,
    true_body,
    true_joints,
    true_rotations,
    true_segments,
    video_truth,
)
from imocap_core.io.truth import Truth, VideoTruth, model_text
from imocap_core.metrics import body_scoring, world
from imocap_core.metrics.joint_rotations import joint_rotation_errors_deg, segment_rotations
from imocap_core.metrics.scoring import CameraJoints, ScoreRow, scored_row
from imocap_core.workers import at_once

JointErrors = dict[str, float]
NO_TRUTH = "no truth"
NO_CAMERA = "the true camera is not known"
NO_POSE = "the truth has no joint rotations"
NO_SURFACE = "the truth has no pose and shape of this body model"


def whole_body_rows(
    results: Sequence[StageResult], keypoints: Keypoints, truth: Truth | None, model: Model
) -> list[list[ScoreRow]]:
    """Every metric of `body_scoring`, per result, all videos; rows without a value have the
    reason."""
    names = [result.name for result in results]

    def of_video(v: int) -> list[list[ScoreRow]]:
        video, motions = keypoints.videos[v], [result.motions[v] for result in results]
        surfaces = _surface_rows(names, video, motions, truth, model)
        true = video_truth(truth, video.id)
        return [
            [*joint_rows(name, video, motion, true), *of_surface]
            for name, motion, of_surface in zip(names, motions, surfaces, strict=True)
        ]

    videos = at_once(of_video, range(len(keypoints.videos)))
    return [[row for of_result in videos for row in of_result[k]] for k in range(len(results))]


def joint_rows(
    name: str, video: VideoKeypoints, motion: VideoMotion, truth: VideoTruth | None
) -> list[ScoreRow]:
    """The metrics that need joints and rotations, not the body's surface."""
    predicted = CameraJoints(motion.joints, SMPL_JOINTS, consecutive(motion.frames))
    jitter = body_scoring.jitter_row(name, video.id, predicted, video.fps)
    true, R_true = true_joints(truth, motion.frames), true_rotations(truth)
    if true is None:
        unknown = truth is None or truth.joints is None
        note = NO_TRUTH if unknown else NO_CAMERA
        metrics = (*body_scoring.JOINT_GROUPS, *body_scoring.WORLD_METRICS)
        rows = body_scoring.unscored_rows(name, video.id, dict.fromkeys(metrics, note))
    else:
        rows = [
            *body_scoring.joint_group_rows(name, video.id, predicted, true),
            *body_scoring.world_rows(name, video.id, predicted, true),
        ]
    segments = segment_rotations(_local_rotations(motion))
    rows += body_scoring.segment_rows(name, video.id, segments, true_segments(truth))
    if R_true is None:
        note = NO_TRUTH if truth is None else NO_POSE
        notes = dict.fromkeys(body_scoring.ROTATION_METRICS, note)
        rows += body_scoring.unscored_rows(name, video.id, notes)
    else:
        rows += body_scoring.rotation_rows(name, video.id, _local_rotations(motion), R_true)
    return [*rows, jitter]


def joint_position_errors_mm(result: StageResult, truth: Truth | None) -> JointErrors:
    """SMPL joint -> error after alignment on the twelve joints, mean over frames, then videos.

    Empty without truth.
    """

    def of_video(motion: VideoMotion) -> JointErrors:
        true = true_joints(video_truth(truth, motion.id), motion.frames)
        predicted = CameraJoints(motion.joints, SMPL_JOINTS, consecutive(motion.frames))
        return {} if true is None else body_scoring.aligned_errors_mm(predicted, true)

    return _mean_over_videos(result.motions, of_video)


def joint_rotation_errors(result: StageResult, truth: Truth | None) -> JointErrors:
    """SMPL joint -> error of its local rotation in degrees, mean over frames, then videos.

    Empty where the truth has no rotations.
    """

    def of_video(motion: VideoMotion) -> JointErrors:
        true = true_rotations(video_truth(truth, motion.id))
        if true is None:
            return {}
        errors = joint_rotation_errors_deg(_local_rotations(motion), true)
        return dict(zip(SMPL_JOINTS, errors.tolist(), strict=True))

    return _mean_over_videos(result.motions, of_video)


def _mean_over_videos(
    motions: Iterable[VideoMotion], of_video: Callable[[VideoMotion], JointErrors]
) -> JointErrors:
    videos = [errors for motion in motions if (errors := of_video(motion))]
    joints = [name for name in SMPL_JOINTS if any(name in errors for errors in videos)]
    return {
        name: float(np.mean([errors[name] for errors in videos if name in errors]))
        for name in joints
    }


def _surface_rows(
    names: Sequence[str],
    video: VideoKeypoints,
    motions: Sequence[VideoMotion],
    truth: Truth | None,
    model: Model,
) -> list[list[ScoreRow]]:
    """Vertex errors and foot sliding where the truth has a surface, and the surface's stretch; per
    result."""
    bodies = [posed_body(model, motion, list(range(len(motion.frames)))) for motion in motions]
    same_model = truth is not None and truth.model == model_text(model.name, model.digest)
    true = true_body(video_truth(truth, video.id), model) if same_model else None
    measured = measure_surfaces(bodies, true, surface_mesh(model))
    why_not = NO_TRUTH if truth is None else NO_SURFACE

    def rows(
        name: str, motion: VideoMotion, body: Posed, surface: SurfaceMeasures
    ) -> list[ScoreRow]:
        shares, volumes = surface.stretched_shares, surface.torso_volumes
        stretch = body_scoring.stretch_rows(name, video.id, shares, volumes)
        if true is None or surface.errors is None:
            notes = dict.fromkeys(body_scoring.SURFACE_METRICS, why_not)
            return [*body_scoring.unscored_rows(name, video.id, notes), *stretch]
        feet = foot_points_m(body), foot_points_m(true)
        sliding = world.foot_sliding_mm(*feet, consecutive(motion.frames), video.fps)
        values = (*astuple(surface.errors), sliding)
        if_nan = (*("no frame has both",) * 3, "no foot is in contact")
        scored = zip(body_scoring.SURFACE_METRICS, values, if_nan, strict=True)
        return [*(scored_row(name, video.id, *item) for item in scored), *stretch]

    return [rows(*one) for one in zip(names, motions, bodies, measured, strict=True)]


def _local_rotations(motion: VideoMotion) -> np.ndarray:
    """Joint rotations (T, 24, 3, 3) relative to the parent joint."""
    return np.asarray(rotations_from_pose(torch.from_numpy(motion.theta)).numpy())
