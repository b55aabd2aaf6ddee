"""A camera on one spot: rotations and zooms of key frames, one focal length, radial distortion.

The most that a background can show without parallax. Its parameters are fitted to feature tracks
over pairs of key frames (`tripod_fit`): a point of one is where the other's ray, rotated, meets its
picture.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from jaxtyping import Float, Int64
from scipy.spatial.transform import Rotation

from imocap_core.camera.averaging import nearest_rotation
from imocap_core.camera.lens import Lens
from imocap_core.camera.projection import intrinsics, rays
from imocap_core.robust import geman_mcclure_weight

FAR_PX = 1000.0  # error of a point behind the camera


@dataclass(frozen=True)
class TrackedPair:
    """Tracks that two key frames (by their indices) share, in pixels of both."""

    a: int
    b: int
    xy_a: Float[np.ndarray, "P 2"]
    xy_b: Float[np.ndarray, "P 2"]


@dataclass(frozen=True)
class PairPoints:
    """The points of several pairs, each with the indices of its two key frames.

    xy_a, xy_b: pixels relative to the picture's middle; corner_px: from there to its corner.
    """

    a: Int64[np.ndarray, " P"]
    b: Int64[np.ndarray, " P"]
    xy_a: Float[np.ndarray, "P 2"]
    xy_b: Float[np.ndarray, "P 2"]
    corner_px: float

    @classmethod
    def of(cls, pairs: Sequence[TrackedPair], size: tuple[int, int]) -> PairPoints:
        """Points of pictures of a size."""
        counts = [len(pair.xy_a) for pair in pairs]
        middle = (np.array(size) - 1) / 2
        return cls(
            np.repeat([pair.a for pair in pairs], counts),
            np.repeat([pair.b for pair in pairs], counts),
            np.concatenate([pair.xy_a for pair in pairs]) - middle,
            np.concatenate([pair.xy_b for pair in pairs]) - middle,
            float(np.linalg.norm(middle)),
        )


@dataclass(frozen=True)
class TripodCamera:
    """Key frames of a camera on one spot.

    Attributes:
        log_focal: logarithm of the first key frame's focal length, pixels.
        distortion: the lens shows an undistorted point ``1 + distortion r^2`` times as far from the
            middle, r = 1 in the picture's corner (OpenCV's k1 of a focal length as long as that).
        log_zoom: (F,) of each key frame's focal length over the first one's.
        R: (F, 3, 3) from each key frame's axes to the first one's.
    """

    log_focal: float
    distortion: float
    log_zoom: Float[np.ndarray, " F"]
    R: Float[np.ndarray, "F 3 3"]

    @property
    def focal_px(self) -> float:
        """Focal length of the first key frame."""
        return float(np.exp(self.log_focal))

    def errors_px(self, points: PairPoints) -> Float[np.ndarray, "P 2"]:
        """Where a's picture should show the points of b, less where it does."""
        log_focal = self.log_focal + self.log_zoom
        return transfer_errors_px(
            points, self.distortion, log_focal[points.a], log_focal[points.b],
            self.R[points.a], self.R[points.b],
        )  # fmt: skip

    def retracted(self, change: Float[np.ndarray, " n"]) -> TripodCamera:
        """After increments [focal, distortion, zooms, rotations ``R <- R exp(change)``]."""
        keys = len(self.R)
        turn = Rotation.from_rotvec(change[2 + keys :].reshape(-1, 3)).as_matrix()
        return TripodCamera(
            self.log_focal + float(change[0]),
            self.distortion + float(change[1]),
            self.log_zoom + change[2 : 2 + keys],
            self.R @ turn,
        )


def transfer_errors_px(
    points: PairPoints,
    distortion: float,
    log_focal_a: Float[np.ndarray, " P"],
    log_focal_b: Float[np.ndarray, " P"],
    R_a: Float[np.ndarray, "P 3 3"],
    R_b: Float[np.ndarray, "P 3 3"],
) -> Float[np.ndarray, "P 2"]:
    """Errors of `TripodCamera.errors_px`, with each point's own two cameras.

    In the picture as it is: errors of undistorted points would be smallest for the lens that
    shrinks the picture.
    """
    lens = Lens.of([distortion], np.diag([points.corner_px, points.corner_px, 1.0]))
    straight_b = lens.undistorted(points.xy_b) if distortion else points.xy_b
    focal_a, focal_b = np.exp(log_focal_a)[:, None], np.exp(log_focal_b)[:, None]
    ray = np.concatenate([straight_b / focal_b, np.ones_like(focal_b)], axis=1)
    ray = np.einsum("pji,pj->pi", R_a, np.einsum("pij,pj->pi", R_b, ray))
    shown = focal_a * ray[:, :2] / np.maximum(ray[:, 2:], 1e-3)
    if distortion:
        shown = lens.distorted(shown)
    return np.asarray(np.clip(shown - points.xy_a, -FAR_PX, FAR_PX))


def chained_tripod(
    pairs: Sequence[TrackedPair], keys: int, size: tuple[int, int], focal_px: float
) -> TripodCamera:
    """Rotations and zooms from one key frame to the next, at an assumed focal length.

    Args:
        pairs: those of consecutive key frames, (0, 1), (1, 2) ..., among them.
    """
    steps = {(pair.a, pair.b): pair for pair in pairs}
    R, log_zoom = [np.eye(3)], [0.0]
    for k in range(1, keys):
        pair = steps[k - 1, k]
        log_zoom.append(log_zoom[-1] + _log_scale(pair))
        ray_a, ray_b = (
            rays(xy, intrinsics(focal_px * float(np.exp(zoom)), size))
            for xy, zoom in zip((pair.xy_a, pair.xy_b), log_zoom[-2:], strict=True)
        )
        R.append(R[-1] @ _rotation(ray_a, ray_b))
    return TripodCamera(float(np.log(focal_px)), 0.0, np.array(log_zoom), np.stack(R))


def without_zoom(camera: TripodCamera) -> TripodCamera:
    """The same camera with one focal length."""
    return replace(camera, log_zoom=np.zeros_like(camera.log_zoom))


def _rotation(
    ray_a: Float[np.ndarray, "P 3"], ray_b: Float[np.ndarray, "P 3"]
) -> Float[np.ndarray, "3 3"]:
    """R_a_from_b of the robust Wahba problem."""
    weight, R = np.ones(len(ray_a)), np.eye(3)
    for _ in range(6):
        R = nearest_rotation((ray_a * weight[:, None]).T @ ray_b)
        angle = np.linalg.norm(ray_b @ R.T - ray_a, axis=1)
        weight = geman_mcclure_weight(angle, max(1e-4, 2 * float(np.median(angle))))
    return R


def _log_scale(pair: TrackedPair) -> float:
    """Logarithm of b's magnification relative to a, by a robust similarity."""
    A, _ = cv2.estimateAffinePartial2D(pair.xy_a, pair.xy_b, ransacReprojThreshold=2.0)
    return 0.0 if A is None else 0.5 * float(np.log(max(np.linalg.det(A[:, :2]), 1e-3)))
