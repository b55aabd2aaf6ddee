"""Refinement of one camera pose: Levenberg-Marquardt on a robust reprojection cost."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int64
from scipy.spatial.transform import Rotation

from imocap_core.camera.projection import camera_from_world, project
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


def robust_cost(
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
    damping, cost = 1e-4, robust_cost(evidence, R, t, scale)
    for _ in range(iterations):
        normal, gradient = _normal_equations(evidence, R, t, scale, turn=turn)
        lifted = normal + damping * np.diag(np.diag(normal)) + 1e-12 * np.eye(len(normal))
        step = -np.linalg.solve(lifted, gradient)
        R_new = Rotation.from_rotvec(step[3:]).as_matrix() @ R if turn else R
        # the increment rotates about the points' centroid, see _normal_equations
        pivot = camera_from_world(evidence.x_world.mean(0), R, np.zeros(3))
        t_new = t + step[:3] + (pivot - R_new @ R.T @ pivot)
        new_cost = robust_cost(evidence, R_new, t_new, scale)
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
            cost = robust_cost(evidence, R, t, scale)
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
