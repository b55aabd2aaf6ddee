"""Whole-body metrics of one result: each joint, rotations, the surface, the motion in the world."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import astuple, dataclass
from functools import lru_cache

import numpy as np
import torch
from jaxtyping import Float, Int

from imocap_core.artifacts.schemas import Keypoints, VideoKeypoints
from imocap_core.artifacts.schemas.motion_schemas import VideoMotion
from imocap_core.body import Model, Posed
from imocap_core.body.model import rotations_from_pose
from imocap_core.body.points import pick_points
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.evaluate.scoreboard import (
    StageResult,
    consecutive,
    posed_body,
    true_body,
    true_joints,
    true_rotations,
    true_segments,
    video_truth,
)
from imocap_core.io.truth import Truth, VideoTruth, model_text
from imocap_core.metrics import scoring, trajectory
from imocap_core.metrics.position import hip_midpoint, mean_over_frames
from imocap_core.metrics.scoring import CameraJoints, ScoreRow, scored_row
from imocap_core.metrics.whole_body import (
    edges_of,
    joint_rotation_errors_deg,
    mpjae_deg,
    pa_pve_mm,
    segment_rotations,
    stretched_edge_shares,
    vertex_distances_mm,
)
from imocap_core.workers import thread_map

FOOT_POINTS = ("left_heel", "left_big_toe", "right_heel", "right_big_toe")
_CHUNK = 32  # frames whose surfaces are in memory together


@dataclass(frozen=True)
class VertexErrors:
    """PVE about the hips' middle, and after Procrustes; mm."""

    pve: float
    pa_pve: float


@dataclass(frozen=True)
class SurfaceMeasures:
    """Distortion of a body's surface against the same person's at rest, and its errors.

    stretched_shares: of edges, per frame. errors: None without a true surface.
    """

    stretched_shares: Float[np.ndarray, " T"]
    errors: VertexErrors | None


@lru_cache(maxsize=2)
def surface_edges(model: Model) -> Int[np.ndarray, "E 2"]:
    """The edges of a body model's surface."""
    return edges_of(model.faces.cpu().numpy())


def measure_surfaces(
    predicted: Sequence[Posed], true: Posed | None, edges: Int[np.ndarray, "E 2"]
) -> list[SurfaceMeasures]:
    """Measures of several results of one video; each surface is skinned once.

    Errors are means over vertices and frames, NaN without frames.
    """
    bodies = [*predicted, *([] if true is None else [true])]
    parts = [slice(start, start + _CHUNK) for start in range(0, len(bodies[0].transl), _CHUNK)]
    measured: list[list[SurfaceMeasures]] = [[] for _ in predicted]
    for part in parts:
        surfaces = [_surface(body, part) for body in bodies]
        last = None if true is None else surfaces[-1]
        for measures, surface in zip(measured, surfaces, strict=False):
            errors = None if last is None else _vertex_errors_mm(surface, last)
            measures.append(_distortion(surface, edges, errors))
    return [_of_all_frames(measures, true is not None) for measures in measured]


@dataclass(frozen=True)
class _Surface:
    """A body's surface in some frames, at rest, and its root; metres."""

    model: Model
    vertices: Float[np.ndarray, "t V 3"]
    rest: Float[np.ndarray, "V 3"]
    root: Float[np.ndarray, "t 3"]


def _surface(body: Posed, frames: slice) -> _Surface:
    shaped = body.shaped
    posed = shaped.pose(body.R_local[frames], body.transl[frames])
    root = hip_midpoint(posed.joints.cpu().numpy(), shaped.model.joint_names)
    vertices, rest = (x.cpu().numpy() for x in (posed.mesh().vertices, shaped.vertices_rest))
    return _Surface(shaped.model, vertices, rest, root)


def _distortion(
    surface: _Surface, edges: Int[np.ndarray, "E 2"], errors: VertexErrors | None
) -> SurfaceMeasures:
    """The measures that need no truth, beside those that do."""
    return SurfaceMeasures(stretched_edge_shares(surface.vertices, surface.rest, edges), errors)


def _vertex_errors_mm(predicted: _Surface, true: _Surface) -> VertexErrors:
    """Means over the frames of two surfaces."""
    pair = predicted.vertices, true.vertices
    distances = vertex_distances_mm(*pair, predicted.root, true.root)
    return VertexErrors(mean_over_frames(distances), pa_pve_mm(*pair))


def _of_all_frames(parts: Sequence[SurfaceMeasures], scored: bool) -> SurfaceMeasures:
    errors = [astuple(part.errors) for part in parts if part.errors is not None]
    counts = [len(part.stretched_shares) for part in parts]
    means = np.average(errors, axis=0, weights=counts) if errors else np.full(2, np.nan)
    return SurfaceMeasures(
        np.concatenate([np.zeros(0), *(part.stretched_shares for part in parts)]),
        VertexErrors(*(float(mean) for mean in means)) if scored else None,
    )


def foot_points_m(posed: Posed) -> Float[np.ndarray, "T 4 3"]:
    """Heel and big toe of both feet, on the surface."""
    points = pick_points(posed.shaped.model.points("body25"), FOOT_POINTS)
    return np.asarray(posed.keypoints(points).cpu().numpy())


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

    videos = thread_map(of_video, range(len(keypoints.videos)))
    return [[row for of_result in videos for row in of_result[k]] for k in range(len(results))]


def joint_rows(
    name: str, video: VideoKeypoints, motion: VideoMotion, truth: VideoTruth | None
) -> list[ScoreRow]:
    """The metrics that need joints and rotations, not the body's surface."""
    predicted = CameraJoints(motion.joints, SMPL_JOINTS, consecutive(motion.frames))
    jitter = scoring.jitter_row(name, video.id, predicted, video.fps)
    true, R_true = true_joints(truth, motion.frames), true_rotations(truth)
    if true is None:
        unknown = truth is None or truth.joints is None
        note = NO_TRUTH if unknown else NO_CAMERA
        rows = scoring.unscored_rows(name, video.id, dict.fromkeys(scoring.WORLD_METRICS, note))
    else:
        rows = scoring.world_rows(name, video.id, predicted, true)
    segments = segment_rotations(_local_rotations(motion))
    rows += scoring.segment_rows(name, video.id, segments, true_segments(truth))
    if R_true is None:
        note = NO_TRUTH if truth is None else NO_POSE
        rows.append(ScoreRow(name, video.id, scoring.MPJAE, None, note))
    else:
        value = mpjae_deg(_local_rotations(motion), R_true)
        rows.append(scored_row(name, video.id, scoring.MPJAE, value, "no frame has both"))
    return [*rows, jitter]


def joint_position_errors_mm(result: StageResult, truth: Truth | None) -> JointErrors:
    """SMPL joint -> error after alignment on the twelve joints, mean over frames, then videos.

    Empty without truth.
    """

    def of_video(motion: VideoMotion) -> JointErrors:
        true = true_joints(video_truth(truth, motion.id), motion.frames)
        predicted = CameraJoints(motion.joints, SMPL_JOINTS, consecutive(motion.frames))
        return {} if true is None else scoring.aligned_errors_mm(predicted, true)

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
    measured = measure_surfaces(bodies, true, surface_edges(model))
    why_not = NO_TRUTH if truth is None else NO_SURFACE

    def rows(
        name: str, motion: VideoMotion, body: Posed, surface: SurfaceMeasures
    ) -> list[ScoreRow]:
        stretch = [scoring.stretch_row(name, video.id, surface.stretched_shares)]
        if true is None or surface.errors is None:
            notes = dict.fromkeys(scoring.SURFACE_METRICS, why_not)
            return [*scoring.unscored_rows(name, video.id, notes), *stretch]
        feet = foot_points_m(body), foot_points_m(true)
        sliding = trajectory.foot_sliding_mm(*feet, consecutive(motion.frames), video.fps)
        values = (*astuple(surface.errors), sliding)
        if_nan = (*("no frame has both",) * 2, "no foot is in contact")
        scored = zip(scoring.SURFACE_METRICS, values, if_nan, strict=True)
        return [*(scored_row(name, video.id, *item) for item in scored), *stretch]

    return [rows(*one) for one in zip(names, motions, bodies, measured, strict=True)]


def _local_rotations(motion: VideoMotion) -> np.ndarray:
    """Joint rotations (T, 24, 3, 3) relative to the parent joint."""
    return np.asarray(rotations_from_pose(torch.from_numpy(motion.theta)).numpy())
