"""The path of a moving camera: every frame's pose from the points that its background shows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int64
from scipy.spatial.transform import Rotation, Slerp

from imocap_core.camera.background import FeatureTracks
from imocap_core.camera.pnp import PointEvidence, errors_px, refine
from imocap_core.camera.projection import camera_from_world, intrinsics

FEWEST_POINTS = 12  # that a frame's pose is fitted to
LEAST_REGISTERED = 0.8  # of the key frames
LEAST_POSED = 0.9  # of the frames
SCALE_PX = 1.5  # of the robust loss
LEAST_NOISE_PX = 0.3
INFLATION = 3.0  # of the uncertainty of one frame's pose by that of the points (made walks)
MOST_OFF_PX = 1.5  # median error of a frame's points in the pictures that were tracked in


@dataclass(frozen=True)
class BackgroundStructure:
    """Points of the background and the key frames that show them, in any unit.

    Attributes:
        focal_px: of all key frames.
        keys: (F,) frames; R: (F, 3, 3), t: (F, 3) camera from world.
        track: (P,) ascending; points: (P, 3) in the world.
    """

    focal_px: float
    keys: Int64[np.ndarray, " F"]
    R: Float[np.ndarray, "F 3 3"]
    t: Float[np.ndarray, "F 3"]
    track: Int64[np.ndarray, " P"]
    points: Float[np.ndarray, "P 3"]


@dataclass(frozen=True)
class CameraPath:
    """Every frame's camera in the axes of the first one, in units of the background's distance.

    Attributes:
        focal_px: of all frames; R_first_from_frame: (T, 3, 3).
        centre: (T, 3) its place; sd: (T,) standard deviation of a coordinate of it.
        off_px: median error of the background's points.
    """

    focal_px: float
    R_first_from_frame: Float[np.ndarray, "T 3 3"]
    centre: Float[np.ndarray, "T 3"]
    sd: Float[np.ndarray, " T"]
    off_px: float


@dataclass(frozen=True)
class _FramePose:
    R: Float[np.ndarray, "3 3"]
    centre: Float[np.ndarray, "3"]
    sd: float
    off_px: float


def camera_path(
    structure: BackgroundStructure, tracks: FeatureTracks, frames: int, size: tuple[int, int]
) -> CameraPath | None:
    """Poses of all frames; None where too few of them show enough of the background's points.

    The unit is the median distance from the cameras to the points. A frame without a pose lies
    between its neighbours, and its uncertainty is as large as the path.
    """
    K = intrinsics(structure.focal_px, size)
    poses: dict[int, _FramePose] = {}
    for t in range(frames):
        pose = _frame_pose(structure, tracks, t, K)
        if pose is not None and pose.off_px < MOST_OFF_PX:
            poses[t] = pose
    if len(poses) < LEAST_POSED * frames:
        return None
    posed = np.array(sorted(poses))
    centres = np.stack([poses[t].centre for t in posed])
    distances = np.linalg.norm(
        structure.points[:, None] - centres[:: max(1, len(posed) // 8)], axis=-1
    )
    unit = float(np.median(distances))
    R = np.stack([poses[t].R for t in posed])
    every = np.clip(np.arange(frames), posed[0], posed[-1])
    R_all = Slerp(posed, Rotation.from_matrix(R))(every).as_matrix() if len(posed) > 1 else R
    centre = np.stack([np.interp(every, posed, c) for c in centres.T], axis=1)
    sd = np.full(frames, float(np.ptp(centres, axis=0).max()))
    sd[posed] = [INFLATION * poses[t].sd for t in posed]
    return CameraPath(
        focal_px=structure.focal_px,
        R_first_from_frame=R_all[0] @ R_all.swapaxes(1, 2),
        centre=(centre - centre[0]) @ R_all[0].T / unit,
        sd=sd / unit,
        off_px=float(np.median([pose.off_px for pose in poses.values()])),
    )


def _frame_pose(
    structure: BackgroundStructure, tracks: FeatureTracks, t: int, K: Float[np.ndarray, "3 3"]
) -> _FramePose | None:
    """Refined from the pose of the nearest key frame; None with too few points."""
    ids, xy = tracks.at(t)
    _, rows, points = np.intersect1d(ids, structure.track, return_indices=True)
    if len(rows) < FEWEST_POINTS:
        return None
    nearest = int(np.argmin(np.abs(structure.keys - t)))
    evidence = PointEvidence(
        structure.points[points], xy[rows], np.ones(len(rows)), np.full(len(rows), t), K
    )
    R, shift, _ = refine(
        evidence, structure.R[nearest], structure.t[nearest], SCALE_PX, 40, turn=True
    )
    error = errors_px(evidence, R, shift)
    off = float(np.median(error))
    near = evidence.of(np.asarray(error < 3 * max(off, LEAST_NOISE_PX)))
    noise = max(LEAST_NOISE_PX, off)
    return _FramePose(R, -R.T @ shift, _centre_sd(near, R, shift, noise), off)


def _centre_sd(
    evidence: PointEvidence, R: Float[np.ndarray, "3 3"], t: Float[np.ndarray, "3"], noise_px: float
) -> float:
    """Standard deviation of a coordinate of the camera's place, the rotation unknown as well."""
    x, y, z = camera_from_world(evidence.x_world, R, t).T
    focal = evidence.K[0, 0]
    by_point = np.zeros((len(z), 2, 3))
    by_point[:, 0, 0] = by_point[:, 1, 1] = focal / z
    by_point[:, 0, 2], by_point[:, 1, 2] = -focal * x / z**2, -focal * y / z**2
    cross = np.zeros((len(z), 3, 3))
    cross[:, 0, 1], cross[:, 0, 2], cross[:, 1, 2] = z, -y, x
    by_turn = by_point @ (cross - cross.swapaxes(1, 2))
    J = np.concatenate([by_point, by_turn], axis=2).reshape(-1, 6) / noise_px
    information = J.T @ J
    return float(np.sqrt(np.trace(np.linalg.pinv(information)[:3, :3]) / 3))
