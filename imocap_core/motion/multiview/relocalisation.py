"""Relocalisation: a video whose camera the others' motion refutes is placed anew by its keypoints.

The first cameras come of root orientations of monocular fits. A fit that took the back for the
front, or reversed depth, puts its camera on the other side of the performer, and no local solver
brings it back. But the keypoints that it was fitted to are right: held against the mean motion of
the other videos, at the frames that correspond, they tell the camera's rotation (scaled
orthographic, any scale and place a frame). It replaces the first one where it lies far from it and
explains the keypoints much better.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from imocap_core.camera.averaging import angle_deg, mean_vector
from imocap_core.camera.rotation_search import refined_rotation
from imocap_core.conventions import mirror_indices
from imocap_core.motion.multiview.aligned import align
from imocap_core.motion.multiview.cameras import PATH_SCALE_M, Cameras
from imocap_core.motion.multiview.consensus import consensus_motion, to_world
from imocap_core.motion.multiview.keypoint_evidence import (
    KeypointEvidence,
    keypoint_evidence,
    mean_of_others,
    registration_residuals,
)
from imocap_core.motion.multiview.per_video import common_at_video_frames
from imocap_core.motion.multiview.scene import Scene
from imocap_core.motion.state import MotionState
from imocap_core.sync.screening.registration import camera_directions

DIRECTIONS = 128
ROLLS_DEG = (-25.0, 0.0, 25.0)
STEPS_DEG = (8.0, 4.0, 2.0)  # of the rotation's refinement
FAR_DEG = 45.0  # from the first camera: what is nearer the joint solve reaches by itself
EXPLAINED_SHARE = 0.7  # of the first camera's residual, at most


def relocalise(
    scene: Scene, state: MotionState, cameras: Cameras, agreement_rad: float
) -> tuple[MotionState, Cameras]:
    """Cameras that the other videos' motion refutes are replaced, and their videos' motions with
    them by the others' mean.

    One at a time, the clearest first, as long as two others agree; of two videos at most one.

    Args:
        state: every video's motion in its own camera's axes.
        agreement_rad: as of `consensus_motion`.
    """
    evidence = keypoint_evidence(scene, state)
    twins = mirror_indices(scene.body.keypoints.names)
    R = cameras.R.cpu().numpy().copy()
    replaced: list[int] = []
    while len(replaced) < max(1, len(R) - 2):
        rest = [v for v in range(len(R)) if v not in replaced]
        ratios, rotations = zip(
            *(_better_rotation(evidence, R, v, twins) for v in rest), strict=True
        )
        best = int(np.argmin(ratios))
        if ratios[best] > EXPLAINED_SHARE:
            break
        R[rest[best]] = rotations[best]
        replaced.append(rest[best])
    if not replaced:
        return state, cameras
    turned = replace(cameras, R=torch.as_tensor(R).to(cameras.R))
    placed = _translated(scene, state, turned, replaced).in_axes_of(scene.reference)
    return _carried(scene, state, placed, replaced, agreement_rad), placed


def _better_rotation(
    evidence: KeypointEvidence, R: Float[np.ndarray, "M 3 3"], v: int, twins: Sequence[int]
) -> tuple[float, Float[np.ndarray, "3 3"]]:
    """The best far rotation of a camera; its residual over the present one's."""
    pose = mean_of_others(evidence, R, v)
    data = (evidence.xy_px[v], evidence.weight[v])
    candidates = np.concatenate([R[v][None], _candidates()])
    residuals = registration_residuals(pose, *data, candidates, twins)
    far = angle_deg(candidates, R[v]) > FAR_DEG

    def explained(R: Float[np.ndarray, "D 3 3"]) -> Float[np.ndarray, " D"]:
        return registration_residuals(pose, *data, R, twins)

    (best, residual), (near, least) = (
        refined_rotation(candidates[side][residuals[side].argmin()], explained, STEPS_DEG)
        for side in (far, ~far)
    )
    if float(angle_deg(near, R[v])) > FAR_DEG:
        least = float(residuals[~far].min())
    return residual / max(least, 1e-9), best


def _candidates() -> Float[np.ndarray, "D 3 3"]:
    """Rotations of cameras all about the performer, level in the world or rolled a little."""
    axes = camera_directions(DIRECTIONS)
    level = np.concatenate([axes, np.cross(axes[:, :1], axes[:, 1:])], axis=1)
    rolls = Rotation.from_euler("z", np.array(ROLLS_DEG)[:, None], degrees=True).as_matrix()
    return np.asarray((rolls[:, None] @ level).reshape(-1, 3, 3))


def _translated(scene: Scene, state: MotionState, cameras: Cameras, videos: list[int]) -> Cameras:
    """Translations of some cameras: their paths, from their own fits, onto the others' path."""
    aligned = align(scene.body, state, scene.timeline)
    world = to_world(aligned, cameras)
    others = [u for u in range(len(cameras.R)) if u not in videos]
    t = cameras.t.clone()
    for v in videos:
        shift, share = [], []
        for u in others:
            shift.append(aligned.root[v] - world.root[u] @ cameras.R[v].T)
            share.append(aligned.weight[v] * aligned.weight[u])
        shifts, shares = torch.cat(shift).cpu().numpy(), torch.cat(share).cpu().numpy()
        if (shares > 0).any():
            t[v] = torch.as_tensor(mean_vector(shifts, shares, scale=PATH_SCALE_M)).to(t)
    return replace(cameras, t=t)


def _carried(
    scene: Scene, state: MotionState, cameras: Cameras, videos: list[int], agreement_rad: float
) -> MotionState:
    """The poses of some videos from the mean motion of the others, where they are matched."""
    confidence = scene.timeline.confidence.copy()
    confidence[videos] = 0.0
    others = replace(scene, timeline=replace(scene.timeline, confidence=confidence))
    mean = consensus_motion(others, state, cameras, agreement_rad)
    poses = common_at_video_frames(scene, state, mean, cameras).R_local
    R_local = state.R_local.clone()
    R_local[videos] = poses[videos]
    return replace(state, R_local=R_local)
