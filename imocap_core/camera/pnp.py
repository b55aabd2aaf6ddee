"""Perspective-n-point (PnP) over a whole clip, and resection: cameras from points and pixels.

The body moves through the scene, so all frames together have far more depth variation than any
single one. The order of the steps matters: refining the rotation from a rough translation lets it
diverge by tens of degrees. So the translation is solved first, linearly with the rotation fixed and
robustly against wrongly matched frames; then both are refined under a Geman-McClure cost.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int64
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from imocap_core.camera.averaging import angle_deg
from imocap_core.camera.projection import camera_from_world, normalised, project
from imocap_core.robust import geman_mcclure, geman_mcclure_weight

MIN_DEPTH_SHARE = 0.05  # of the median depth: nearer points count as behind the camera
FARTHEST_PX = 1e9  # error of a point behind the camera


@dataclass(frozen=True)
class PointEvidence:
    """The valid points of all frames, N in total."""

    x_world: Float[np.ndarray, "N 3"]
    xy_px: Float[np.ndarray, "N 2"]
    weight: Float[np.ndarray, " N"]
    frame: Int64[np.ndarray, " N"]
    K: Float[np.ndarray, "3 3"]

    def of(self, rows: Bool[np.ndarray, " N"]) -> PointEvidence:
        """Some of the points."""
        return PointEvidence(
            self.x_world[rows], self.xy_px[rows], self.weight[rows], self.frame[rows], self.K
        )


def errors_px(
    evidence: PointEvidence, R: Float[np.ndarray, "3 3"], t: Float[np.ndarray, "3"]
) -> Float[np.ndarray, " N"]:
    """Reprojection errors in pixels; infinite for points behind the camera."""
    predicted = project(evidence.x_world, evidence.K, R, t)
    distance = np.linalg.norm(predicted - evidence.xy_px, axis=-1)
    return np.where(np.isfinite(distance), distance, np.inf)


def _robust_cost(
    evidence: PointEvidence, R: Float[np.ndarray, "3 3"], t: Float[np.ndarray, "3"], scale_px: float
) -> float:
    """Weighted Geman-McClure cost, at most ``scale_px**2`` a point."""
    squared = np.minimum(errors_px(evidence, R, t), FARTHEST_PX) ** 2
    return float(evidence.weight @ geman_mcclure(squared, scale_px)[0])


def refine(
    evidence: PointEvidence,
    R: Float[np.ndarray, "3 3"],
    t: Float[np.ndarray, "3"],
    scale_px: float,
    iterations: int,
    *,
    turn: bool,
) -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, "3"], bool]:
    """Levenberg-Marquardt on the Geman-McClure cost, its scale shrinking to ``scale_px``.

    Returns R, t, and whether it converged; without ``turn`` the rotation is fixed.
    """
    start = float(np.median(errors_px(evidence, R, t)))
    scale = max(scale_px, min(2.0 * start, 20.0 * scale_px))
    damping, cost = 1e-4, _robust_cost(evidence, R, t, scale)
    for _ in range(iterations):
        normal, gradient = _normal_equations(evidence, R, t, scale, turn=turn)
        lifted = normal + damping * np.diag(np.diag(normal)) + 1e-12 * np.eye(len(normal))
        step = -np.linalg.solve(lifted, gradient)
        R_new = Rotation.from_rotvec(step[3:]).as_matrix() @ R if turn else R
        # the increment rotates about the points' centroid, see _normal_equations
        pivot = camera_from_world(evidence.x_world.mean(0), R, np.zeros(3))
        t_new = t + step[:3] + (pivot - R_new @ R.T @ pivot)
        new_cost = _robust_cost(evidence, R_new, t_new, scale)
        if new_cost <= cost:
            small = cost - new_cost <= 1e-9 * cost
            R, t, cost, damping = R_new, t_new, new_cost, max(damping * 0.2, 1e-9)
            if small and scale == scale_px:
                return R, t, True
        else:
            damping = damping * 8.0
            if damping > 1e8:
                return R, t, scale == scale_px
        if scale > scale_px:
            scale = max(scale_px, 0.8 * scale)
            cost = _robust_cost(evidence, R, t, scale)
    return R, t, False


def _normal_equations(
    evidence: PointEvidence,
    R: Float[np.ndarray, "3 3"],
    t: Float[np.ndarray, "3"],
    scale_px: float,
    *,
    turn: bool,
) -> tuple[Float[np.ndarray, "P P"], Float[np.ndarray, " P"]]:
    """J^T W J and J^T W r over (translation, rotation vector about the points' centroid).

    Rotating about the centroid instead of about the camera keeps the two blocks nearly
    independent: a far camera otherwise trades rotation against translation.
    """
    K = evidence.K
    x_cam = camera_from_world(evidence.x_world, R, t)
    near = MIN_DEPTH_SHARE * max(float(np.median(x_cam[:, 2])), 1e-6)
    in_front = x_cam[:, 2] > near
    x, y, z = x_cam[in_front].T
    residual = (x_cam[in_front] / z[:, None]) @ K[:2].T - evidence.xy_px[in_front]
    by_plane = np.zeros((len(z), 2, 3))
    by_plane[:, 0, 0] = by_plane[:, 1, 1] = 1.0 / z
    by_plane[:, 0, 2], by_plane[:, 1, 2] = -x / z**2, -y / z**2
    by_point = K[:2, :2] @ by_plane
    jacobian = by_point
    if turn:
        lever = (evidence.x_world[in_front] - evidence.x_world.mean(0)) @ R.T
        jacobian = np.concatenate([by_point, by_point @ -cross_matrix(lever)], axis=-1)
    robust = geman_mcclure_weight(np.linalg.norm(residual, axis=-1), scale_px)
    weight = evidence.weight[in_front] * robust
    normal = np.einsum("n,nai,naj->ij", weight, jacobian, jacobian)
    return normal, np.einsum("n,nai,na->i", weight, jacobian, residual)


def cross_matrix(v: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch 3 3"]:
    """Cross-product matrices: ``cross_matrix(v) @ w = v x w``."""
    out = np.zeros((*v.shape, 3))
    out[..., 0, 1], out[..., 0, 2], out[..., 1, 2] = -v[..., 2], v[..., 1], -v[..., 0]
    return out - np.swapaxes(out, -1, -2)


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
        cost = _robust_cost(evidence, R, t, 4.0 * scale_px)
        if cost < best_cost:
            best_t, best_cost = t, cost
    return best_t


def _judge(
    evidence: PointEvidence, R: Float[np.ndarray, "3 3"], t: Float[np.ndarray, "3"], status: str
) -> CameraPose:
    """The pose with its median error."""
    median = float(np.median(errors_px(evidence, R, t)))
    ok = bool(np.isfinite(median) and np.isfinite(t).all())
    reason = status if ok else "most points are behind the camera"
    return CameraPose(R, t, median, ok, reason)
