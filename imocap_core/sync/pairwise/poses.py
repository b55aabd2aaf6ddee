"""Poses of all videos made comparable: input checks, weights of missing joints, body scale."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from imocap_core.sync.blocks import Blocks

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
    joint_weights: Float[np.ndarray, " J"] | None,
) -> list[Float[np.ndarray, "_T J"]]:
    """Per video: each joint's weight times its confidence, 0 where the joint is missing (NaN)."""
    weights = []
    for v, x in enumerate(poses):
        w = np.isfinite(x).all(axis=-1).astype(float)
        if confidence is not None:
            w = w * np.nan_to_num(confidence[v])
        # a pair multiplies both frames' weights, so each contributes the square root of the joint's
        weights.append(w if joint_weights is None else w * np.sqrt(joint_weights))
    return weights


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
