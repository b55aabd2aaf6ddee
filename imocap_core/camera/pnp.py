"""Perspective-n-point (PnP) over a whole clip: one camera pose from the joints of all frames.

The body moves through the scene, so all frames together have far more depth variation than any
single one. The order of the steps matters: refining the rotation from a rough translation lets it
diverge by tens of degrees. So the translation is solved first, linearly with the rotation fixed and
robustly against wrongly matched frames; then both are refined under a Geman-McClure cost.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from imocap_core.camera.averaging import angle_deg
from imocap_core.camera.pose_refinement import PointEvidence, errors_px, refine, robust_cost
from imocap_core.camera.projection import normalised

MIN_POINTS = 6
ITERATIONS = 40
CANDIDATES = 48  # runs of frames of one length that propose a translation


@dataclass(frozen=True)
class CameraPose:
    """A camera pose, camera from world, with its reprojection error.

    ``ok``: whether it may be used; ``status``: a sentence that says why, or why not.
    """

    R: Float[np.ndarray, "3 3"]
    t: Float[np.ndarray, "3"]
    median_px: float
    ok: bool
    status: str


def pnp_over_frames(
    x_world: ArrayLike,
    xy_px: ArrayLike,
    confidence: ArrayLike,
    K: Float[np.ndarray, "3 3"],
    R_start: Float[np.ndarray, "3 3"],
    *,
    scale_px: float = 10.0,
    max_turn_deg: float = 30.0,
) -> CameraPose:
    """Camera pose from 3D joints and their pixels in all frames.

    Args:
        x_world: (T, J, 3) joints in the world, metres, NaN where missing.
        xy_px: (T, J, 2) their pixels, NaN where missing.
        confidence: (T, J) weights; 0 leaves a point out.
        K: intrinsic matrix.
        R_start: rotation, camera from world, at which to start. It is fixed while the translation
            is solved, and is the result if the refinement turns the camera by more than
            ``max_turn_deg`` (it has then left the basin of attraction).
        scale_px: Geman-McClure scale.

    Raises:
        ValueError: shapes that do not fit together.
    """
    evidence = _gather(x_world, xy_px, confidence, K)
    if len(evidence.weight) < MIN_POINTS:
        count = len(evidence.weight)
        status = f"{count} usable points, at least {MIN_POINTS} are needed"
        return CameraPose(np.array(R_start), np.zeros(3), np.inf, False, status)
    t = _translation(evidence, R_start, scale_px)
    R_fixed, t_fixed, _ = refine(evidence, R_start, t, scale_px, ITERATIONS, turn=False)
    R, t, converged = refine(evidence, R_fixed, t_fixed, scale_px, ITERATIONS, turn=True)
    turn_deg = float(angle_deg(R_fixed, R))
    if turn_deg > max_turn_deg:
        status = (
            f"refinement rotated the camera by {turn_deg:.0f} degrees, so its start is returned"
        )
        return _judge(evidence, R_fixed, t_fixed, status)
    status = "converged" if converged else f"not converged after {ITERATIONS} iterations"
    return _judge(evidence, R, t, status)


def _gather(
    x_world: ArrayLike, xy_px: ArrayLike, confidence: ArrayLike, K: Float[np.ndarray, "3 3"]
) -> PointEvidence:
    """The valid points of checked arrays."""
    x_world, xy_px = np.asarray(x_world, float), np.asarray(xy_px, float)
    confidence = np.asarray(confidence, float)
    if (
        x_world.shape != (*confidence.shape, 3)
        or xy_px.shape != (*confidence.shape, 2)
        or confidence.ndim != 2
    ):
        raise ValueError(
            "expected x_world (T, J, 3), xy_px (T, J, 2) and confidence (T, J), got "
            f"{x_world.shape}, {xy_px.shape} and {confidence.shape}"
        )
    valid = np.isfinite(x_world).all(-1) & np.isfinite(xy_px).all(-1) & (confidence > 0)
    frame = np.nonzero(valid)[0].astype(np.int64)
    return PointEvidence(
        x_world[valid], xy_px[valid], confidence[valid], frame, np.asarray(K, float)
    )


def _linear_translation(
    evidence: PointEvidence, R: Float[np.ndarray, "3 3"], row_weight: Float[np.ndarray, " N"]
) -> Float[np.ndarray, "3"]:
    """Weighted least squares for t in ``p_xy + t_xy = uv (p_z + t_z)``, p = R x (linear in t)."""
    uv = normalised(evidence.xy_px, evidence.K)
    p = evidence.x_world @ R.T
    rows = np.zeros((len(p), 2, 3))
    rows[:, 0, 0] = rows[:, 1, 1] = 1.0
    rows[:, :, 2] = -uv
    right = uv * p[:, 2:] - p[:, :2]
    normal = np.einsum("n,nai,naj->ij", row_weight, rows, rows)
    moment = np.einsum("n,nai,na->i", row_weight, rows, right)
    return np.linalg.lstsq(normal, moment, rcond=None)[0]


def _translation(
    evidence: PointEvidence, R: Float[np.ndarray, "3 3"], scale_px: float
) -> Float[np.ndarray, "3"]:
    """Best of linear translations of all frames and of short runs of frames, by robust cost.

    Runs of frames are the samples, because wrong matches come in runs: a run without any exists as
    long as some part of the clip is matched correctly, so random sampling is not needed.
    """
    frames = np.unique(evidence.frame)
    groups = [frames]
    for length in sorted({1, min(8, len(frames)), max(1, len(frames) // 4)}):
        starts = np.linspace(0, len(frames) - length, min(CANDIDATES, len(frames)))
        groups += [frames[s : s + length] for s in np.unique(starts.astype(int))]
    best_t, best_cost = np.zeros(3), np.inf
    for group in groups:
        part = evidence.of(np.isin(evidence.frame, group))
        if len(part.weight) < 3:
            continue
        t = _linear_translation(part, R, part.weight)
        # with a wide scale: a candidate from one run is inaccurate in all other frames
        cost = robust_cost(evidence, R, t, 4.0 * scale_px)
        if cost < best_cost:
            best_t, best_cost = t, cost
    return best_t


def _judge(
    evidence: PointEvidence,
    R: Float[np.ndarray, "3 3"],
    t: Float[np.ndarray, "3"],
    status: str,
) -> CameraPose:
    """The pose with its median error."""
    median = float(np.median(errors_px(evidence, R, t)))
    ok = bool(np.isfinite(median) and np.isfinite(t).all())
    reason = status if ok else "most points are behind the camera"
    return CameraPose(R, t, median, ok, reason)
