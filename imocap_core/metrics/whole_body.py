"""Errors of the whole body: joints that are not aligned on, and the vertices of the surface."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from imocap_core.alignment import similarity
from imocap_core.metrics.position import MM_PER_M, mean_joint_errors_mm, pa_mpjpe_mm


def aligned_joint_errors_mm(
    predicted_m: Float[np.ndarray, "T J 3"],
    true_m: Float[np.ndarray, "T J 3"],
    anchors: Sequence[int],
) -> Float[np.ndarray, " J"]:
    """Mean error of each joint after a similarity alignment of each frame on some of the joints.

    Joints that are no anchors do not influence the alignment, so their errors are not spread over
    the others as by P-MPJPE. Invariant to a similarity transform of the prediction in each frame.

    Args:
        anchors: indices of the joints that are aligned on, at least three.

    Returns:
        Millimetres; NaN for a joint that is missing throughout.
    """
    on = list(anchors)
    aligned = similarity(predicted_m[:, on], true_m[:, on]).apply(predicted_m)
    return mean_joint_errors_mm(aligned, true_m)


def vertex_distances_mm(
    predicted_m: Float[np.ndarray, "T V 3"],
    true_m: Float[np.ndarray, "T V 3"],
    predicted_root_m: Float[np.ndarray, "T 3"],
    true_root_m: Float[np.ndarray, "T 3"],
) -> Float[np.ndarray, "T V"]:
    """Distance of every vertex to its truth, the roots of both bodies at the origin, in mm.

    Their mean (`mean_over_frames`) is the per-vertex error (PVE): as MPJPE, of all vertices of the
    surface (Pavlakos et al., "Learning to estimate 3D human pose and shape from a single color
    image", CVPR 2018). Invariant to a translation of each frame.
    """
    distances = np.empty(predicted_m.shape[:2])
    for t, (predicted, true) in enumerate(zip(predicted_m, true_m, strict=True)):
        about_root = predicted.T - predicted_root_m[t][:, None]
        distances[t] = _distances_mm(about_root, true.T - true_root_m[t][:, None])
    return distances


def pa_pve_mm(predicted_m: Float[np.ndarray, "T V 3"], true_m: Float[np.ndarray, "T V 3"]) -> float:
    """Per-vertex error after a similarity Procrustes alignment of each frame, in mm."""
    return pa_mpjpe_mm(predicted_m, true_m)


def _distances_mm(
    predicted_m: Float[np.ndarray, "3 V"], true_m: Float[np.ndarray, "3 V"]
) -> Float[np.ndarray, " V"]:
    """Distance of every vertex to its truth; coordinates in rows."""
    x, y, z = np.square(predicted_m - true_m)
    return np.asarray(MM_PER_M * np.sqrt(x + y + z))
