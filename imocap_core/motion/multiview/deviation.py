"""How far each performance deviates from the common motion, estimated from the images.

What a view's reprojection errors have beyond detector noise is a difference of performance (or of
synchronisation). It is observed in the image plane; in depth the same is assumed. This moment
estimate sets the coupling's strength: strong where videos agree, weak where they do not.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch
from jaxtyping import Float

from imocap_core.motion.kinematics import Body
from imocap_core.motion.multiview.cameras import Cameras
from imocap_core.motion.multiview.common_keypoints import (
    CommonKeypoints,
    reprojection_errors_px,
    root_depths_m,
)
from imocap_core.motion.multiview.scene import Scene
from imocap_core.motion.state import MotionState

LEAST_SPREAD_RAD, LEAST_SPREAD_M = 0.03, 0.01
LEAST_LEVER_M = 0.15
UNSEEN_SPREAD_M = 0.1  # of a video whose keypoints are missing throughout
UNMOVED_SPREAD_RAD = 0.1  # of a joint that moves no keypoint


def keypoint_spread_m(
    scene: Scene, motion: MotionState, keypoints: CommonKeypoints, cameras: Cameras
) -> Float[np.ndarray, "M N K"]:
    """Standard deviation per coordinate, metres, of each keypoint from the common motion."""
    errors = reprojection_errors_px(
        scene.body, motion, keypoints, cameras, robust_scale=scene.fit.robust_scale_sigma
    )
    depth = root_depths_m(scene.body, motion, cameras, keypoints)
    return spread_beyond_noise_m(
        errors, keypoints.sigma_px, depth, cameras.focal_px, window=round(scene.fps / 2)
    )


def with_keypoint_spread(
    body: Body,
    keypoints: CommonKeypoints,
    spread_m: Float[np.ndarray, "M N K"],
    motion: MotionState,
    cameras: Cameras,
) -> CommonKeypoints:
    """Keypoints whose variance includes the performances' deviations."""
    depth = root_depths_m(body, motion, cameras, keypoints)
    spread_px = spread_m * (cameras.focal_px[:, None] / depth)[..., None]
    sigma2 = keypoints.sigma_px[..., None] ** 2
    return replace(keypoints, weight=keypoints.weight * sigma2 / (sigma2 + spread_px**2))


def spread_beyond_noise_m(
    errors_px: Float[np.ndarray, "M N K 2"],
    sigma_px: Float[np.ndarray, "M N"],
    depth_m: Float[np.ndarray, "M N"],
    focal_px: Float[np.ndarray, " M"],
    *,
    window: int,
) -> Float[np.ndarray, "M N K"]:
    """Standard deviation per coordinate, metres, of what detector noise does not explain.

    Args:
        errors_px: NaN where missing; sigma_px: detector noise.
        window: frames over which squared errors are pooled (median, so outliers do not count).
    """
    squared = (errors_px**2).sum(-1) / 2
    half = max(1, window // 2)
    padded = np.pad(squared, ((0, 0), (half, half), (0, 0)), mode="reflect")
    windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * half + 1, axis=1)
    usable = np.isfinite(windows).sum(-1) >= 3
    filled = np.where(usable[..., None], windows, 0.0)
    # the median of an exponential distribution is ln 2 times its mean
    pooled = finite_median(filled) / np.log(2)
    videos = len(errors_px)
    inflated = pooled * videos / max(videos - 1, 1)
    excess = np.maximum(inflated - sigma_px[..., None] ** 2, 0.0)
    spread = np.sqrt(excess) * (depth_m / focal_px[:, None])[..., None]
    typical = [
        np.median(s[k]) if k.any() else UNSEEN_SPREAD_M for s, k in zip(spread, usable, strict=True)
    ]
    return np.where(usable, spread, np.array(typical)[:, None, None])


def finite_median(values: Float[np.ndarray, "... W"]) -> Float[np.ndarray, "..."]:
    """Medians over the last axis without NaN (`np.nanmedian`, faster); no row may be all NaN."""
    ordered = np.sort(values, axis=-1)  # NaN last
    count = np.isfinite(values).sum(-1, keepdims=True)
    low, high = (np.take_along_axis(ordered, k, -1)[..., 0] for k in ((count - 1) // 2, count // 2))
    return np.asarray(0.5 * (low + high))


def pooled_spread_m(spread_m: Float[np.ndarray, "M N K"]) -> Float[np.ndarray, "M N K"]:
    """Spread of keypoints of which half the variance is that of all in the frame: the errors of one
    view tell little of a single keypoint's; at least LEAST_SPREAD_M."""
    variance = np.square(spread_m)
    pooled = np.sqrt((variance + variance.mean(axis=-1, keepdims=True)) / 2)
    return np.maximum(pooled, LEAST_SPREAD_M)


def joint_spread_rad(
    body: Body, motion: MotionState, spread_m: Float[np.ndarray, "M N K"]
) -> Float[np.ndarray, "M N 24"]:
    """Standard deviation of each joint's rotation: the smallest bound that a keypoint sets.

    A keypoint at distance d below joint j that deviates by s metres rotates the joint by at most
    s/d; the smallest such bound over the keypoints that the joint moves is taken.

    Args:
        motion: the common one (batch of 1).
    """
    points = body.positions(body.keypoints, motion).xyz[0]
    joints = body.positions(body.joints, motion).xyz[0]
    lever = torch.cdist(joints, points).clamp_min(LEAST_LEVER_M).cpu().numpy()  # (N, 24, K)
    moved = body.keypoints.moved_by.T.cpu().numpy()  # (24, K)
    angle = spread_m[:, :, None] / lever[None]  # (M, N, 24, K)
    angle = np.where(moved, angle, np.inf).min(-1)
    angle[:, :, ~moved.any(1)] = UNMOVED_SPREAD_RAD
    return np.maximum(angle, LEAST_SPREAD_RAD)
