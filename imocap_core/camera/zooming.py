"""A camera that rotates about its centre and zooms: ``H = K_key R K_frame^-1``.

The principal point stays in the middle of the picture and pixels stay square, so a frame has four
unknowns relative to its key frame, three of the rotation and one of the focal length.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.optimize import minimize_scalar

from imocap_core.camera.averaging import nearest_rotation
from imocap_core.camera.background import Matches
from imocap_core.camera.projection import project_camera, rays
from imocap_core.robust import geman_mcclure, geman_mcclure_weight

WIDEST_STEP = np.log(3.0)  # zoom of a frame against its key frame
ROBUST_PX = 3.0  # of the cost by which zooms are compared


@dataclass(frozen=True)
class RotationsAndZooms:
    """Rotations R_first_from_frame, and each frame's focal length divided by the first frame's."""

    R: Float[np.ndarray, "T 3 3"]
    zoom: Float[np.ndarray, " T"]


def lens_of(
    K: Float[np.ndarray, "3 3"], zoom: float | Float[np.ndarray, "..."]
) -> Float[np.ndarray, "... 3 3"]:
    """Intrinsic matrices of the same camera with its focal length times ``zoom``."""
    lens = np.broadcast_to(K, (*np.shape(zoom), 3, 3)).copy()
    lens[..., :2, :2] *= np.asarray(zoom)[..., None, None]
    return lens


def homographies(
    K: Float[np.ndarray, "3 3"], motion: RotationsAndZooms
) -> Float[np.ndarray, "T 3 3"]:
    """Homographies H_first_from_frame = K R K_frame^-1."""
    return K @ motion.R @ np.linalg.inv(lens_of(K, motion.zoom))


def rotations_and_zooms(
    matches: Sequence[Matches], K: Float[np.ndarray, "3 3"]
) -> RotationsAndZooms:
    """Rotation and zoom of every frame relative to the first, whose intrinsics are ``K``."""
    R, zoom = np.tile(np.eye(3), (len(matches), 1, 1)), np.ones(len(matches))
    for t, match in enumerate(matches):
        if match.key == t:
            continue
        if not match.inlier.any():  # not matched: as the frame before it
            R[t], zoom[t] = R[t - 1], zoom[t - 1]
            continue
        step, R_key = _relative_to_key(match, lens_of(K, zoom[match.key]))
        R[t], zoom[t] = R[match.key] @ R_key, zoom[match.key] * step
    return RotationsAndZooms(R, zoom)


def _relative_to_key(
    match: Matches, K_key: Float[np.ndarray, "3 3"]
) -> tuple[float, Float[np.ndarray, "3 3"]]:
    """Zoom of one frame divided by its key frame's, and R_key_from_frame."""

    def cost(log_zoom: float) -> float:
        lens = lens_of(K_key, float(np.exp(log_zoom)))
        error = rotations_key_from_frame([match], K_key, lens, rounds=3)[1][0]
        return float(geman_mcclure(error**2, ROBUST_PX)[0].mean())

    start = _log_scale(match)
    best = minimize_scalar(
        cost, bounds=(max(start - 0.2, -WIDEST_STEP), min(start + 0.2, WIDEST_STEP)),
        method="bounded", options={"xatol": 1e-4},
    )  # fmt: skip
    step = float(np.exp(best.x))
    return step, rotations_key_from_frame([match], K_key, lens_of(K_key, step), rounds=3)[0][0]


def _log_scale(match: Matches) -> float:
    """Logarithm of the frame's magnification relative to its key frame."""
    sizes = [
        np.median(np.linalg.norm(xy - np.median(xy, axis=0), axis=1))
        for xy in (match.xy_frame[match.inlier], match.xy_key[match.inlier])
    ]
    return float(np.log(sizes[0] / sizes[1])) if min(sizes) > 0 else 0.0


def rotations_key_from_frame(
    matches: Sequence[Matches],
    K_key: Float[np.ndarray, "3 3"],
    K_frame: Float[np.ndarray, "3 3"],
    *,
    rounds: int = 4,
) -> tuple[Float[np.ndarray, "F 3 3"], list[Float[np.ndarray, " N"]]]:
    """R_key_from_frame of some frames, and each one's errors in pixels at its inliers.

    Robust Wahba problems, solved side by side: rays of a frame are rotated onto rays of its key.
    """
    counts = np.array([int(match.inlier.sum()) for match in matches])
    weight = (np.arange(max(counts.max(), 1)) < counts[:, None]).astype(np.float64)
    there = weight > 0  # rows are filled up to the longest
    xy_key, xy_frame = (np.zeros((*there.shape, 2)) for _ in range(2))
    xy_key[there] = np.concatenate([match.xy_key[match.inlier] for match in matches])
    xy_frame[there] = np.concatenate([match.xy_frame[match.inlier] for match in matches])
    ray_key, ray_frame = rays(xy_key, K_key), rays(xy_frame, K_frame)
    middle = np.stack([np.maximum(counts - 1, 0) // 2, counts // 2], axis=1)
    for _ in range(rounds):
        R = nearest_rotation(np.swapaxes(ray_key * weight[..., None], 1, 2) @ ray_frame)
        shown = project_camera(ray_frame @ np.swapaxes(R, 1, 2), K_key)
        error = np.linalg.norm(shown - xy_key, axis=2)
        error = np.where(np.isfinite(error), error, 1e3)
        ordered = np.sort(np.where(there, error, np.inf), axis=1)
        median = np.take_along_axis(ordered, middle, axis=1).mean(axis=1)
        weight = there * geman_mcclure_weight(error / np.maximum(0.3, 2 * median)[:, None], 1.0)
    for t in np.flatnonzero(counts == 0).tolist():
        H = np.linalg.inv(K_key) @ matches[t].H_key_from_frame @ K_frame
        R[t] = nearest_rotation(H / np.cbrt(np.linalg.det(H)))
    return R, [row[:count] for row, count in zip(error, counts, strict=True)]
