"""A camera that turns and zooms on the spot: ``H = K_key R K_frame^-1``, a focal length a frame.

The middle of the picture stays where it is and the lens keeps its proportions, so a frame has four
unknowns against its key frame, three of the rotation and one of the zoom.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from imocap_core.camera.averaging import nearest_rotation
from imocap_core.camera.background import Matches
from imocap_core.camera.projection import project_camera, rays
from imocap_core.robust import geman_mcclure, geman_mcclure_weight

Array = NDArray[np.float64]
WIDEST_STEP = np.log(3.0)  # zoom of a frame against its key frame
ROBUST_PX = 3.0  # of the cost by which zooms are compared


@dataclass(frozen=True)
class Zoomed:
    """R_first_from_frame (T, 3, 3), and zoom (T,): each frame's focal length over the first's."""

    R: Array
    zoom: Array


def lens_of(K: Array, zoom: float | Array) -> Array:
    """Intrinsics (..., 3, 3) of the same camera with its focal length times ``zoom`` (...)."""
    lens = np.broadcast_to(K, (*np.shape(zoom), 3, 3)).copy()
    lens[..., :2, :2] *= np.asarray(zoom)[..., None, None]
    return lens


def homographies(K: Array, found: Zoomed) -> Array:
    """H_first_from_frame (T, 3, 3) = K R K_frame^-1."""
    return K @ found.R @ np.linalg.inv(lens_of(K, found.zoom))


def zoom_and_turn(matches: list[Matches], K: Array) -> Zoomed:
    """Rotations and zooms of all frames against the first, whose intrinsics are ``K``."""
    R, zoom = np.tile(np.eye(3), (len(matches), 1, 1)), np.ones(len(matches))
    for t, match in enumerate(matches):
        if match.key == t:
            continue
        if not match.inlier.any():  # held where the frame before it was
            R[t], zoom[t] = R[t - 1], zoom[t - 1]
            continue
        step, R_key = _against_key(match, lens_of(K, zoom[match.key]))
        R[t], zoom[t] = R[match.key] @ R_key, zoom[match.key] * step
    return Zoomed(R, zoom)


def _against_key(match: Matches, K_key: Array) -> tuple[float, Array]:
    """Zoom of one frame over its key frame's, and R_key_from_frame."""

    def cost(log_zoom: float) -> float:
        error = _turned(match, K_key, lens_of(K_key, float(np.exp(log_zoom))))[1]
        return float(geman_mcclure(error**2, ROBUST_PX)[0].mean())

    start = _scale_of(match)
    best = minimize_scalar(
        cost, bounds=(max(start - 0.2, -WIDEST_STEP), min(start + 0.2, WIDEST_STEP)),
        method="bounded", options={"xatol": 1e-4},
    )  # fmt: skip
    step = float(np.exp(best.x))
    return step, _turned(match, K_key, lens_of(K_key, step))[0]


def _scale_of(match: Matches) -> float:
    """Logarithm of how much larger the frame shows things than its key frame does."""
    sizes = [
        np.median(np.linalg.norm(xy - np.median(xy, axis=0), axis=1))
        for xy in (match.xy_frame[match.inlier], match.xy_key[match.inlier])
    ]
    return float(np.log(sizes[0] / sizes[1])) if min(sizes) > 0 else 0.0


def _turned(match: Matches, K_key: Array, K_frame: Array) -> tuple[Array, Array]:
    """R_key_from_frame of the robust Wahba problem, and the inliers' errors (N,) in pixels."""
    xy_key, xy_frame = match.xy_key[match.inlier], match.xy_frame[match.inlier]
    ray_key, ray_frame = rays(xy_key, K_key), rays(xy_frame, K_frame)
    weight = np.ones(len(ray_key))
    for _ in range(3):
        R = nearest_rotation((ray_key * weight[:, None]).T @ ray_frame)
        error = np.linalg.norm(project_camera(ray_frame @ R.T, K_key) - xy_key, axis=1)
        error = np.where(np.isfinite(error), error, 1e3)
        weight = geman_mcclure_weight(error, max(0.3, 2.0 * float(np.median(error))))
    return R, error
