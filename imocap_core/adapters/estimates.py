"""Results of other monocular estimators as starting points of one video's fit."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from imocap_core.adapters.even_moments import nearest_used
from imocap_core.artifacts.schemas import VideoKeypoints
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.io.readers.estimates import PerformerBoxes
from imocap_core.io.readers.smpl_estimators import JOINT_READERS, ROTATIONS, read_smpl_npz
from imocap_core.motion.monocular.starts import (
    MIN_JOINTS,
    Start,
    interpolate_rotations,
    start_at_motion,
)
from imocap_core.motion.multiview.timeline import sample, sample_rotations, values_at
from imocap_core.pipeline.stage import Context
from imocap_core.rotations import exp

Estimate = Float[np.ndarray, "T 24 3"] | Start | Float[Tensor, "T 24 3 3"] | None
"""Joints in metres, an SMPL motion as a start, or joint rotations."""
SourceEstimate = Float[np.ndarray, "S 24 3"] | Start | Float[Tensor, "S 24 3 3"] | None

PERSON_M = (0.1, 10.0)  # extent of a person's joints: outside, they are in other units
FARTHEST_M = 10_000.0
FIRST_FRAME_FORMATS = ("joints_npz", "smpl_npz")  # in the axes of the first frame's camera


def estimate_of(
    ctx: Context, video: VideoKeypoints, R_first_from_frame: Float[Tensor, "T 3 3"]
) -> Estimate:
    """The declared estimate of a video, in the axes of the first frame's camera; None without one.

    Formats other than `FIRST_FRAME_FORMATS` are in the axes of each frame's own camera, from which
    R_first_from_frame rotates them.

    Raises:
        ValueError: the file is missing, damaged, or not usable; or the format is unknown.
    """
    path, kind = ctx.initial(video.id), video.initial_format
    if path is None:
        return None
    nearest = nearest_used(video)
    source = np.arange(video.frames[0], video.frames[-1] + 1)
    boxes = PerformerBoxes(source, video.person_box_px[nearest], video.size)
    R_first_from_frame = R_first_from_frame[nearest]
    if kind in JOINT_READERS:
        return _at_used_frames(_joints(path, kind, boxes, R_first_from_frame), video)
    if kind in ROTATIONS:
        return _at_used_frames(_rotations(path, kind, boxes, R_first_from_frame), video)
    if kind == "smpl_npz":
        return _at_used_frames(_smpl_motion(path, source), video)
    formats = ", ".join(["smpl_npz", *JOINT_READERS, *ROTATIONS])
    raise ValueError(
        f"{ctx.action_file()}: videos: {video.id}: initial_format: expected one of {formats}, got "
        f"{kind!r}; convert the estimate to one of them"
    )


def detected_joints(path: Path, video: VideoKeypoints) -> Float[np.ndarray, "T 24 3"] | None:
    """The 3D landmarks in a file of MediaPipe's detections, in the axes of each frame's camera;
    None where it has none that can be used."""
    nearest = nearest_used(video)
    source = np.arange(video.frames[0], video.frames[-1] + 1)
    boxes = PerformerBoxes(source, video.person_box_px[nearest], video.size)
    unturned = torch.eye(3, dtype=torch.float64).expand(len(source), 3, 3)
    try:
        joints = _at_used_frames(_joints(path, "mediapipe_world", boxes, unturned), video)
    except ValueError:
        return None
    assert isinstance(joints, np.ndarray)
    return joints


def check_estimate(ctx: Context, video: VideoKeypoints) -> None:
    """ValueError, with what to do, when the declared estimate of a video cannot be used."""
    unturned = torch.eye(3, dtype=torch.float64).expand(len(video.frames), 3, 3)
    try:
        estimate_of(ctx, video, unturned)
    except ValueError as error:
        raise ValueError(
            f"{error}; repair what `initial` of {video.id} names in action.yaml, or remove "
            f"`initial` and `initial_format` there"
        ) from None


def _at_used_frames(of_source: SourceEstimate, video: VideoKeypoints) -> Estimate:
    """An estimate of every source frame at the used frames."""
    if video.moments is None or of_source is None:
        return of_source
    position = video.source_frames - video.frames[0]
    if isinstance(of_source, np.ndarray):
        return values_at(of_source, position)
    if isinstance(of_source, Tensor):
        return sample_rotations(of_source, position)
    R_local, trans = of_source.R_local, of_source.trans
    return Start(sample_rotations(R_local, position), sample(trans, position), of_source.cost)


def _joints(
    path: Path, kind: str, boxes: PerformerBoxes, R_first_from_frame: Tensor
) -> Float[np.ndarray, "T 24 3"]:
    estimate = JOINT_READERS[kind](path, boxes)
    joints = np.full((len(boxes.frames), 24, 3), np.nan)
    for k, name in enumerate(estimate.joint_names):
        if name in SMPL_JOINTS:
            joints[:, SMPL_JOINTS.index(name)] = estimate.joints[:, k]
    if kind not in FIRST_FRAME_FORMATS:
        joints = np.einsum("tij,tkj->tki", R_first_from_frame.numpy(), joints)
    most = int(np.isfinite(joints).all(-1).sum(1).max())
    if most < MIN_JOINTS:
        raise ValueError(
            f"{path}: joints: expected numbers for at least {MIN_JOINTS} of SMPL's joints "
            f"({', '.join(SMPL_JOINTS)}) in some frame, got {most} of {len(estimate.joint_names)}"
        )
    complete = joints[np.isfinite(joints).all(-1).sum(1) >= MIN_JOINTS]
    bounded = np.clip(complete, -FARTHEST_M, FARTHEST_M)
    sides = np.nanmax(bounded, axis=1) - np.nanmin(bounded, axis=1)
    extent_m = float(np.median(sides.max(axis=-1)))
    if not PERSON_M[0] <= extent_m <= PERSON_M[1]:
        raise ValueError(
            f"{path}: joints: expected metres, a person of {PERSON_M[0]:g} to {PERSON_M[1]:g}, got "
            f"{extent_m:.3g}"
        )
    return joints


def _rotations(
    path: Path, kind: str, boxes: PerformerBoxes, R_first_from_frame: Tensor
) -> Float[Tensor, "T 24 3 3"]:
    R_local = torch.as_tensor(ROTATIONS[kind](path, boxes))
    R_local[:, 0] = R_first_from_frame @ R_local[:, 0]
    keys = R_local.isfinite().flatten(1).all(1).nonzero()[:, 0].cpu().numpy()
    if len(keys) == 0:
        raise ValueError(f"{path}: every used frame has numbers that are not finite")
    return interpolate_rotations(R_local[keys], keys, len(R_local))


def _smpl_motion(path: Path, frames: np.ndarray) -> Start:
    smpl = read_smpl_npz(path, frames)
    R_local = exp(torch.as_tensor(smpl.theta.reshape(-1, 24, 3)))
    R_local[:, 0] = torch.as_tensor(smpl.R) @ R_local[:, 0]
    try:
        start = start_at_motion(R_local, torch.as_tensor(smpl.trans @ smpl.R.T + smpl.t))
    except ValueError as error:
        raise ValueError(f"{path}: poses, trans: {error}") from None
    depth_m = float(start.trans[:, 2].median())
    if not 0 < depth_m <= FARTHEST_M:
        raise ValueError(
            f"{path}: trans: expected metres in front of the camera (z, which R and t lead to), "
            f"got {depth_m:.3g}"
        )
    return start
