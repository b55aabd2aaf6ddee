"""An action's truth, in the axes and at the frames of the results that are scored."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float, Int

from imocap_core.artifacts.schemas import Keypoints, SyncSummary
from imocap_core.body import Model, Posed
from imocap_core.body.conversions import rotations_from_pose
from imocap_core.io.pose2sim_files import has_pose2sim_truth
from imocap_core.io.pose2sim_truth import read_pose2sim_truth
from imocap_core.io.truth import Truth, VideoTruth, read_truth
from imocap_core.metrics.joint_rotations import segment_rotations
from imocap_core.metrics.scoring import CameraJoints
from imocap_core.metrics.sync import true_reference_frame
from imocap_core.motion.multiview.common_time import pose_at, values_at
from imocap_core.motion.multiview.timeline import sample_rotations


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
