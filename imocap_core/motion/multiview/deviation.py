"""How far each performance strays from the common motion, read from the images.

What a view's reprojection error has beyond detector noise is a difference of performance (or of
synchronisation). It is seen in the image plane; depth is taken to differ as much. This is the
moment estimate behind the coupling's strength: small where videos agree, large where they do not.
"""

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from imocap_core.motion.kinematics import Body
from imocap_core.motion.state import MotionState

Array = NDArray[np.float64]
LEAST_SPREAD_RAD = 0.03
LEAST_LEVER_M = 0.15
UNSEEN_SPREAD_M = 0.1  # of a video that shows nothing of the common motion


@dataclass(frozen=True)
class Spread:
    """How far each performance strays from the common one (standard deviations).

    Attributes:
        keypoints_m: (M, N, K) of each keypoint by itself; whole: (M, 6) of the body as a whole,
            three turns (rad) and three shifts (m).
    """

    keypoints_m: Array
    whole: Array


def keypoint_spread_m(
    errors_px: Array, sigma_px: Array, depth_m: Array, focal_px: Array, *, window: int
) -> Array:
    """(M, N, K) standard deviation per coordinate, metres, of each keypoint's deviation.

    Args:
        errors_px: (M, N, K, 2), NaN where unseen; sigma_px: (M, N) detector noise.
        depth_m: (M, N); focal_px: (M,).
        window: frames over which squared errors are pooled (median, so outliers do not count).
    """
    squared = (errors_px**2).sum(-1) / 2
    half = max(1, window // 2)
    padded = np.pad(squared, ((0, 0), (half, half), (0, 0)), mode="reflect")
    windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * half + 1, axis=1)
    seen = np.isfinite(windows).sum(-1) >= 3
    filled = np.where(seen[..., None], windows, 0.0)
    pooled = median_of_known(filled) / np.log(2)  # the median of an exponential is ln 2 of its mean
    videos = len(errors_px)
    inflated = pooled * videos / max(videos - 1, 1)
    excess = np.maximum(inflated - sigma_px[..., None] ** 2, 0.0)
    spread = np.sqrt(excess) * (depth_m / focal_px[:, None])[..., None]
    typical = [
        np.median(s[k]) if k.any() else UNSEEN_SPREAD_M for s, k in zip(spread, seen, strict=True)
    ]
    return np.where(seen, spread, np.array(typical)[:, None, None])


def median_of_known(values: Array) -> Array:
    """Medians over the last axis, NaN left out; every row has a number (`np.nanmedian`, faster)."""
    ordered = np.sort(values, axis=-1)  # NaN last
    known = np.isfinite(values).sum(-1, keepdims=True)
    low, high = (np.take_along_axis(ordered, k, -1)[..., 0] for k in ((known - 1) // 2, known // 2))
    return np.asarray(0.5 * (low + high))


def joint_spread_rad(body: Body, shared: MotionState, spread_m: Array) -> Array:
    """(M, N, 24) deviation of each joint's rotation: what its nearest moved keypoint allows.

    A keypoint at distance d below joint j that strays by s metres turns the joint by at most s/d;
    the smallest such bound over the keypoints that the joint moves is the joint's own.
    """
    points = body.positions(body.keypoints, shared).xyz[0]
    joints = body.positions(body.joints, shared).xyz[0]
    lever = torch.cdist(joints, points).clamp_min(LEAST_LEVER_M).cpu().numpy()  # (N, 24, K)
    moved = body.keypoints.moved_by.T.cpu().numpy()  # (24, K)
    angle = spread_m[:, :, None] / lever[None]  # (M, N, 24, K)
    angle = np.where(moved, angle, np.inf).min(-1)
    nothing = ~moved.any(1)
    angle[:, :, nothing] = 0.1
    return np.maximum(angle, LEAST_SPREAD_RAD)
