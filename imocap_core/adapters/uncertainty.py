"""From posteriors to the artifact of the stage uncertainty."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from imocap_core.adapters.joint import SolvedGroup
from imocap_core.adapters.participants import Participants
from imocap_core.artifacts.schemas import (
    Keypoints,
    NearPair,
    PredictedVideo,
    RefineSync,
    Uncertainty,
    VideoKeypoints,
    VideoMotion,
    VideoUncertainty,
    Viewpoint,
    WeakSpan,
)
from imocap_core.biomechanics.joint_angles import mirrored_rotation_covariance, rotation_jacobian
from imocap_core.body import Model
from imocap_core.conventions import EVAL_14, SMPL_JOINTS
from imocap_core.metrics.calibration import along_and_across, total_sigma
from imocap_core.motion.monocular.fit import Prediction
from imocap_core.motion.multiview.leave_one_out import predicted_by_others
from imocap_core.motion.observability import AZIMUTHS_DEG, ViewpointReport, weak_spans
from imocap_core.motion.state import MotionState

_WEAK_LIMIT = 2.0  # times the action's median: more is an ill-determined joint
REPORTED = [SMPL_JOINTS.index(name) for name in EVAL_14]  # hands, toes, collars: hardly observed
MM2_PER_M2 = 1e6


@dataclass(frozen=True)
class GroupPosterior:
    """What is claimed of videos that were solved together, as solved (mirrored ones reflected):
    covariances of joints and of the anatomical joints' rotations, of the latter with the common
    motion given, and standard deviations of the cameras' rotations."""

    participants: Participants
    covariances_m2: list[Float[np.ndarray, "_ 24 3 3"]]
    rotations_deg2: list[Float[np.ndarray, "_ 15 3 3"]]
    deviations_deg2: list[Float[np.ndarray, "_ 15 3 3"]]
    camera_rotation_rad: list[float]
    viewpoints: ViewpointReport


def anatomical_rotations(model: Model, motion: MotionState) -> Float[Tensor, "T 15 3 72"]:
    """Derivatives of the anatomical joints' rotations by a motion's increments (a batch of 1)."""
    rest = model.shape(motion.betas).joints_rest[0, : len(SMPL_JOINTS)]
    rows = rotation_jacobian(motion.R_local[0].cpu().numpy(), rest.cpu().numpy())
    return torch.as_tensor(rows).to(motion.trans)


def lasting_residual_m(group: SolvedGroup) -> float:
    """What keypoints are off all through a video, beyond what noise leaves: root mean square of
    their median residuals (8 cm at most), along each axis of the picture, at their depth."""
    squares = []
    videos = group.problem.reprojection_evidence(group.solution).videos
    for v, observation in zip(videos, group.problem.scene.observations, strict=True):
        xyz_m = v.xyz_m @ v.R.T + v.t
        off_m = (v.xy_px - v.K[:2, 2]) / v.K[[0, 1], [0, 1]] * xyz_m[..., 2:] - xyz_m[..., :2]
        off_m[v.weight == 0] = np.nan
        off_m = off_m[:, (v.weight > 0).any(axis=0)]
        middle = np.nanmedian(off_m, axis=0)
        noise = 1.4826 * np.nanmedian(np.abs(off_m - middle), axis=0)  # and lasts 0.2 s:
        independent = np.maximum(np.isfinite(off_m).sum(axis=0) / (0.2 * observation.fps), 1)
        limited = np.clip(middle, -0.08, 0.08)
        squares.append((limited**2 - np.pi / 2 * noise**2 / independent).mean())
    return float(np.sqrt(max(0.0, float(np.mean(squares)))))


def leave_one_out_of(
    groups: Sequence[SolvedGroup], limb_errors: Mapping[str, float]
) -> list[PredictedVideo]:
    """How well each video is predicted without it, in the order of the groups; excluded videos by
    their own monocular fits alone (``limb_errors``). None of an action of one video."""
    rows: list[PredictedVideo] = []
    if len(groups) == 1 and len(groups[0].ids) == 1:
        return rows
    for group in groups:
        problem, solution = group.problem, group.solution
        by_others: list[Prediction | None] = [None] * len(group.ids)
        if solution.common is not None:
            scene = problem.scene_of(solution)
            by_others = [*predicted_by_others(scene, solution, problem.options)]
        for video, others in zip(group.ids, by_others, strict=True):
            rows.append(
                PredictedVideo(
                    id=video,
                    error_share=float("nan") if others is None else others.median,
                    near_share=float("nan") if others is None else others.near_share,
                    monocular_error_share=limb_errors.get(video, float("nan")),
                    frames=0 if others is None else others.frames,
                )
            )
    return rows


def uncertainty_of(
    posteriors: Sequence[GroupPosterior],
    keypoints: Keypoints,
    refined: RefineSync,
    left_out: Sequence[PredictedVideo],
) -> Uncertainty:
    """The artifact: the groups' posteriors as filmed, and ill-determined joints and phases.

    Args:
        posteriors: first of the videos that take part, then of each excluded one.
    """
    motions = {v.id: v for v in refined.motion.videos}
    by_id: dict[str, VideoUncertainty] = {}
    whole = posteriors[0].viewpoints
    for k, group in enumerate(posteriors):
        for v, video in enumerate(group.participants.keypoints.videos):
            covariance = group.participants.filmed_covariance(video.id, group.covariances_m2[v])
            rotations, deviations = group.rotations_deg2[v], group.deviations_deg2[v]
            if video.id in group.participants.mirrored:
                rotations, deviations = map(mirrored_rotation_covariance, (rotations, deviations))
            comparable = k == 0 or (whole.by_performer and group.viewpoints.by_performer)
            azimuth = float(group.viewpoints.azimuths_deg[v]) if comparable else float("nan")
            rotation_deg = float(np.degrees(group.camera_rotation_rad[v])) if k == 0 else np.nan
            by_id[video.id] = _video(
                motions[video.id],
                MM2_PER_M2 * covariance,
                rotations,
                deviations,
                azimuth,
                rotation_deg,
            )
    order = [v.id for v in keypoints.videos]
    videos = [by_id[i] for i in order]
    every = np.concatenate([v.sigma_mm[:, REPORTED].ravel() for v in videos])
    unknown = [v.id for v in videos if not np.isfinite(v.sigma_mm).all()]
    median = float(np.nanmedian(every)) if np.isfinite(every).any() else float("nan")
    weak = [
        span
        for uncertain, video in zip(videos, keypoints.videos, strict=True)
        for span in _weak(uncertain, video, median)
    ]
    ids = [v.id for v in posteriors[0].participants.keypoints.videos]
    return Uncertainty(
        videos=videos,
        median_mm=median,
        weak=sorted(weak, key=lambda span: -span.sigma_mm),
        near=[
            NearPair(videos=[ids[p.a], ids[p.b]], angle_deg=p.angle_deg, seen_across=across)
            for p, across in zip(whole.pairs, whole.across, strict=True)
        ],
        viewpoints=[
            Viewpoint(azimuth_deg=a, reduction=float(r))
            for a, r in zip(AZIMUTHS_DEG, whole.reductions, strict=True)
            if np.isfinite(r)
        ],
        azimuth_from="performer" if whole.by_performer else "camera",
        status=_status(median, unknown),
        leave_one_out=sorted(left_out, key=lambda row: order.index(row.id)),
    )


def _video(
    motion: VideoMotion,
    covariance_mm2: Float[np.ndarray, "T 24 3 3"],
    rotations_deg2: Float[np.ndarray, "T 15 3 3"],
    deviations_deg2: Float[np.ndarray, "T 15 3 3"],
    azimuth_deg: float,
    camera_rotation_deg: float,
) -> VideoUncertainty:
    root = motion.joints[:, 0]
    sight = root / np.linalg.norm(root, axis=-1, keepdims=True)
    depth, across = along_and_across(covariance_mm2, sight[:, None])
    return VideoUncertainty(
        id=motion.id,
        frames=motion.frames,
        sigma_mm=total_sigma(covariance_mm2),
        depth_mm=depth,
        across_mm=across,
        covariance_mm2=covariance_mm2.astype(np.float32),
        rotation_covariance_deg2=rotations_deg2.astype(np.float32),
        deviation_covariance_deg2=deviations_deg2.astype(np.float32),
        azimuth_deg=azimuth_deg,
        camera_rotation_deg=camera_rotation_deg,
    )


def _weak(uncertain: VideoUncertainty, video: VideoKeypoints, median: float) -> list[WeakSpan]:
    spans = weak_spans(uncertain.sigma_mm[:, REPORTED], _WEAK_LIMIT * median, video.fps)
    time_s = video.time_s
    return [
        WeakSpan(
            video=video.id,
            joint=EVAL_14[span.joint],
            first_frame=int(video.frames[span.first]),
            last_frame=int(video.frames[span.last]),
            begin_s=float(time_s[span.first]),
            end_s=float(time_s[span.last]),
            sigma_mm=span.sigma,
            of_median=span.sigma / median,
        )
        for span in spans
    ]


def _status(median: float, unknown: list[str]) -> str:
    status = f"Half of all standard deviations (14 joints, all frames) are below {median:.0f} mm"
    if unknown:
        status += (
            f"; unknown for {', '.join(unknown)}, whose normal matrix is not positive definite"
        )
    return status + "."
