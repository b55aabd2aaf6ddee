"""Poses of all videos made comparable: checks, velocities, changes, vertical motion.

Vertical motion of the trunk: what the root-relative comparison of poses leaves out. In a jump the
pose hardly changes, the height does; and of two squats one is deeper, but both are lowest where
they turn. Where the camera stands is unknown and it may drift, so slow changes of the height do not
count. The distance of two poses with it is that of bodies that may be shifted sideways and turned,
but not lifted: the squared difference of heights is added to the mean squared distance of the
joints. It vanishes where nobody leaves the ground.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from scipy.ndimage import gaussian_filter1d

from imocap_core.sync.maps import BandedMap, Blocks
from imocap_core.sync.procrustes import centred, rotations_onto

RIGID_PAIRS = 20  # of joints, by which sizes are compared


def check_poses(
    poses: Sequence[Float[np.ndarray, "..."]],
    confidence: Sequence[Float[np.ndarray, "..."]] | None,
    fps: Sequence[float],
) -> None:
    """Raise one ValueError that names every fault in the videos' poses, confidences and frame
    rates."""
    faults = []
    if not poses:
        faults.append("poses: expected at least one video, got none")
    if len(fps) != len(poses):
        faults.append(f"fps: expected one per video ({len(poses)}), got {len(fps)}")
    faults += [f"fps of video {v}: expected > 0, got {f}" for v, f in enumerate(fps) if not f > 0]
    for v, x in enumerate(poses):
        if x.ndim != 3 or x.shape[0] == 0 or x.shape[1:] != (poses[0].shape[1], 3):
            faults.append(
                f"poses of video {v}: expected (T >= 1, J, 3) with the J of video 0, got {x.shape}"
            )
        elif confidence is not None and confidence[v].shape != x.shape[:2]:
            faults.append(
                f"confidence of video {v}: expected {x.shape[:2]}, got {confidence[v].shape}"
            )
    if faults:
        raise ValueError("; ".join(faults))


def joint_weights_of(
    poses: Sequence[Float[np.ndarray, "_T J 3"]],
    confidence: Sequence[Float[np.ndarray, "_T J"]] | None,
) -> list[Float[np.ndarray, "_T J"]]:
    """Per video: each joint's confidence, 0 where the joint is missing (NaN)."""
    present = [np.isfinite(x).all(axis=-1).astype(float) for x in poses]
    if confidence is None:
        return present
    return [x * np.nan_to_num(c) for x, c in zip(present, confidence, strict=True)]


def body_scales(poses: Sequence[Float[np.ndarray, "_T J 3"]]) -> Float[np.ndarray, " M"]:
    """Relative size of the body in each video, geometric mean 1.

    Monocular estimates differ in scale. The most rigid pairs of joints, those whose distance
    varies least within the videos, are bones (or as good as bones): their median lengths give the
    scale whatever the poses are.
    """
    J = poses[0].shape[1]
    a, b = np.triu_indices(J, 1)
    lengths = [np.linalg.norm(x[:, a] - x[:, b], axis=-1) for x in poses]
    counts = [np.isfinite(length).sum(axis=0) for length in lengths]
    usable = np.min(counts, axis=0) >= 1
    if usable.sum() < 1:
        return np.ones(len(poses))
    median = np.stack([np.nanmedian(length[:, usable], axis=0) for length in lengths])
    variation = sum(np.nanstd(length[:, usable], axis=0) for length in lengths) / np.maximum(
        median.sum(axis=0), 1e-12
    )
    rigid = np.argsort(variation, kind="stable")[:RIGID_PAIRS]
    log_scale = np.median(np.log(np.maximum(median[:, rigid], 1e-12)), axis=1)
    return np.asarray(np.exp(log_scale - log_scale.mean()))


def stack(
    poses: Sequence[Float[np.ndarray, "_T J 3"]], scales: Float[np.ndarray, " M"]
) -> tuple[Float[np.ndarray, "N_a J 3"], Blocks]:
    """All frames of all videos, each video divided by its scale, and the blocks they form."""
    return (
        np.concatenate([x / s for x, s in zip(poses, scales, strict=True)]),
        Blocks(tuple(len(x) for x in poses)),
    )


TAKEN_OFF = 0.5  # at most, of a difference of means: a part of the action has another one, too
MOMENTS = 4.0  # independent ones that a mean pose is of
ALIGNMENTS = 4  # of poses with their mean, and of means with theirs


def of_one_mean(
    poses: Sequence[Float[np.ndarray, "_T J 3"]], weights: Sequence[Float[np.ndarray, "_T J"]]
) -> list[Float[np.ndarray, "_T J 3"]]:
    """Poses with half of what stays of a video taken off: its mean is nearer to that of all.

    Another body, another way to hold the arms, a monocular estimate that leans or bends throughout
    tell nothing of time, and are larger than what does. A video that shows a part of the action has
    another mean for that: as much of the difference stays as its poses vary less than the others',
    and as much as the mean of a few moments differs by chance.
    """
    of_videos = [_aligned_mean(x, w) for x, w in zip(poses, weights, strict=True)]
    means, turns, spreads = zip(*of_videos, strict=True)
    shown = np.stack([(w > 0).any(axis=0) for w in weights])
    common, to_common, _ = _aligned_mean(np.stack(means), shown.astype(float))
    usual, out = float(np.median(spreads)), []
    for v, (x, spread) in enumerate(zip(poses, spreads, strict=True)):
        off = np.where(shown[v][:, None], common @ to_common[v] - means[v], 0.0)
        square = float((off**2).sum() / max(shown[v].sum(), 1))
        chance = max(usual - spread, 0.0) + usual / MOMENTS
        share = TAKEN_OFF * max(0.0, 1.0 - chance / max(square, 1e-12))
        out.append(x + share * np.einsum("nba,jb->nja", turns[v], off))
    return out


def _aligned_mean(
    poses: Float[np.ndarray, "N J 3"], weights: Float[np.ndarray, "N J"]
) -> tuple[Float[np.ndarray, "J 3"], Float[np.ndarray, "N 3 3"], float]:
    """Mean of poses after the best rotation of each, these, and the mean squared distance."""
    x, total = centred(poses, weights), np.maximum(weights.sum(axis=0), 1e-9)
    whole = np.flatnonzero(weights.sum(axis=1) == weights.sum(axis=1).max())
    mean, R, turned = x[whole[len(whole) // 2]], np.zeros(0), x
    for _ in range(ALIGNMENTS):
        R = rotations_onto(x, np.broadcast_to(mean, x.shape), weights)
        turned = np.einsum("nab,njb->nja", R, x)
        mean = (weights[..., None] * turned).sum(axis=0) / total[:, None]
    square = (weights * ((turned - mean) ** 2).sum(axis=-1)).sum() / total.sum()
    return mean, R, float(square)


CHANGE_S = 0.5  # means over this long before and after a frame are compared


def pose_change(
    poses: Float[np.ndarray, "T J 3"], weights: Float[np.ndarray, "T J"], fps: float
) -> Float[np.ndarray, " T"]:
    """Mean squared distance of the mean poses before and after each frame, after the best rigid
    alignment; at the ends of the nearest frame with both."""
    T = len(poses)
    span = max(1, min(round(CHANGE_S * fps), (T - 1) // 2))
    if T < 3:
        return np.full(T, np.inf)
    w = weights[..., None]
    moments = np.concatenate([np.where(w > 0, poses, 0.0) * w, w], axis=-1)
    total = np.concatenate([np.zeros((1, *moments.shape[1:])), np.cumsum(moments, axis=0)])
    t = np.clip(np.arange(T), span, T - 1 - span)
    before, after = total[t] - total[t - span], total[t + span + 1] - total[t + 1]
    a, b = (m[..., :3] / np.maximum(m[..., 3:], 1e-9) for m in (before, after))
    return _squared_distances(a, b, np.minimum(before[..., 3], after[..., 3]))


def _squared_distances(a: np.ndarray, b: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Mean squared joint distance (T,) of poses (T, J, 3) after the best rigid alignment."""
    total = np.maximum(weights.sum(axis=1), 1e-9)
    x, y = (p - ((p * weights[..., None]).sum(axis=1) / total[:, None])[:, None] for p in (a, b))
    S = np.einsum("tj,tja,tjb->tab", weights, x, y)
    values = np.linalg.svd(S, compute_uv=False)
    best = values[:, 0] + values[:, 1] + np.sign(np.linalg.det(S)) * values[:, 2]
    square = (weights * ((x**2).sum(-1) + (y**2).sum(-1))).sum(axis=1) - 2.0 * best
    return np.asarray(np.maximum(square, 0.0) / total)


TREND_S = 1.0  # heights count relative to their mean over this time (standard deviation)
SIZE_S = 1.0  # over which the size of a person in the picture changes
LEAST_WEIGHT = 1e-3  # of frames at a position, below which nothing is known there
LEAST_JOINTS = 3  # that give a person's size
AMPLITUDE = 95.0  # percentile of the absolute vertical motion


def picture_heights(
    xy_px: Float[np.ndarray, "T J 2"],
    weight: Float[np.ndarray, "T J"],
    poses: Float[np.ndarray, "T J 3"],
    trunk: Sequence[int],
    fps: float,
) -> Float[np.ndarray, " T"]:
    """Height of the trunk in the picture, in the unit of the poses; NaN unknown, from any origin.

    Args:
        xy_px: keypoints, y down; weight: 0 where unknown.
        poses: of the same joints in the camera's axes, which give the unit.
        trunk: joints whose mean is the trunk's place.
    """
    visible = (weight > 0) & np.isfinite(poses).all(axis=-1)
    size = _spread(xy_px, visible) / np.maximum(_spread(poses[..., :2], visible), 1e-9)
    measured = (visible.sum(axis=1) >= LEAST_JOINTS) & (size > 0)
    usual = _smoothed(np.where(measured, size, np.nan), SIZE_S * fps)
    w = weight[:, trunk]
    has_height = (w > 0).all(axis=1)
    if not (has_height & np.isfinite(usual)).any():
        return np.full(len(poses), np.nan)
    y = (w * np.nan_to_num(xy_px[:, trunk, 1])).sum(axis=1) / np.maximum(w.sum(axis=1), 1e-9)
    return np.where(has_height, (np.median(y[has_height]) - y) / usual, np.nan)


def vertical_motion(heights: Float[np.ndarray, " T"], fps: float) -> Float[np.ndarray, " T"]:
    """Heights about their mean over `TREND_S`; fps: of the action. NaN unknown."""
    return np.asarray(heights - _smoothed(heights, TREND_S * fps))


def of_one_amplitude(
    motions: Sequence[Float[np.ndarray, "_T"]], least_m: float
) -> list[Float[np.ndarray, "_T"]]:
    """Vertical motions of all videos with the smallest amplitude of any of them.

    Performers jump to different heights, and from the front a push-up fills more of the picture. An
    amplitude of up to `least_m` fades out.
    """
    amplitudes = [_amplitude(m) for m in motions]
    least = min(amplitudes)
    share = least**2 / max(least**2 + least_m**2, 1e-18)
    return [
        np.sqrt(share) * least / max(a, 1e-9) * m for m, a in zip(motions, amplitudes, strict=True)
    ]


def squared_differences(
    a: Float[np.ndarray, " n"], b: Float[np.ndarray, " m"]
) -> Float[np.ndarray, "n m"]:
    """Of all pairs; 0 where unknown."""
    return np.nan_to_num((a[:, None] - b) ** 2)


def spread_over(
    motion: Float[np.ndarray, " T"], soft_map: BandedMap | None, per_frame: int
) -> Float[np.ndarray, " S"]:
    """Vertical motion at the reference's positions, by a soft map; of the reference itself (None)
    between its frames. NaN unknown."""
    if soft_map is None:
        S = (len(motion) - 1) * per_frame + 1
        return np.interp(np.arange(S) / per_frame, np.arange(len(motion)), motion)
    has_height = np.isfinite(motion)
    columns = np.column_stack([np.where(has_height, motion, 0.0), has_height])
    total, weight = soft_map.spread(columns).T
    return np.where(weight > LEAST_WEIGHT, total / np.maximum(weight, LEAST_WEIGHT), np.nan)


def mean_of_known(motions: Sequence[Float[np.ndarray, " S"]]) -> Float[np.ndarray, " S"]:
    """Mean at each position; NaN where none is known."""
    has_height = np.isfinite(motions)
    total = np.where(has_height, motions, 0.0).sum(axis=0)
    return np.where(has_height.any(axis=0), total / np.maximum(has_height.sum(axis=0), 1), np.nan)


def _amplitude(motion: np.ndarray) -> float:
    has_height = np.isfinite(motion)
    return float(np.percentile(np.abs(motion[has_height]), AMPLITUDE)) if has_height.any() else 0.0


def _spread(points: np.ndarray, visible: np.ndarray) -> np.ndarray:
    """Root of the summed variance (T,) of visible points (T, J, D)."""
    w = visible[..., None].astype(float)
    x = np.where(w > 0, points, 0.0)
    total = np.maximum(w.sum(axis=1, keepdims=True), 1.0)
    about = np.where(w > 0, x - x.sum(axis=1, keepdims=True) / total, 0.0)
    return np.asarray(np.sqrt((about**2).sum(axis=(1, 2)) / total[:, 0, 0]))


def _smoothed(values: np.ndarray, sigma: float) -> np.ndarray:
    """Gaussian mean (T,) of the known ones, which go on as they begin and end."""
    has_height = np.isfinite(values).astype(float)
    total = gaussian_filter1d(np.nan_to_num(values), sigma, mode="nearest")
    share = gaussian_filter1d(has_height, sigma, mode="nearest")
    return np.where(share > 1e-6, total / np.maximum(share, 1e-6), np.nan)
