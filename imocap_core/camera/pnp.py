"""One camera from the joints of all frames at once (perspective-n-point over a whole clip).

The body walks through the scene, so all frames together hold far more depth than any single one.
The order matters. With a rough translation, freeing the rotation at once lets it run tens of
degrees away: first the translation is solved linearly with the rotation held, robustly against
frames that are matched wrongly, then both are refined under a Geman-McClure cost.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from imocap_core.camera.averaging import angle_deg
from imocap_core.camera.projection import camera_from_world, normalised, project
from imocap_core.robust import geman_mcclure, geman_mcclure_weight

Array = NDArray[np.float64]

MIN_POINTS = 6
FARTHEST_PX = 1e9  # error of a point behind the camera
MIN_DEPTH_SHARE = 0.05  # of the median depth: nearer points are held to be behind the camera


@dataclass(frozen=True)
class CameraPose:
    """A camera from world. ``ok`` says whether it may be used, ``status`` why (not)."""

    R: Array
    t: Array
    median_px: float
    inlier_share: float
    ok: bool
    status: str


@dataclass(frozen=True)
class _Evidence:
    """Flat valid points: ``x_world`` (N, 3), ``xy_px`` (N, 2), ``weight`` (N,), ``frame`` (N,)."""

    x_world: Array
    xy_px: Array
    weight: Array
    frame: NDArray[np.int64]
    K: Array

    def of(self, rows: NDArray[np.bool_]) -> _Evidence:
        """The evidence of some rows alone."""
        return _Evidence(
            self.x_world[rows], self.xy_px[rows], self.weight[rows], self.frame[rows], self.K
        )


def pnp_over_frames(
    x_world: Array,
    xy_px: Array,
    confidence: Array,
    K: Array,
    R_start: Array,
    *,
    scale_px: float = 10.0,
    inlier_px: float = 30.0,
    free_rotation: bool = True,
    max_turn_deg: float = 30.0,
    iterations: int = 40,
) -> CameraPose:
    """Camera (R, t from world) from 3D joints (T, J, 3) and their pixels (T, J, 2).

    ``confidence`` (T, J) weighs the points; 0 or NaN coordinates leave them out. ``R_start`` is
    held while the translation is found, and kept in the end if ``free_rotation`` is off or if the
    refinement turns the camera by more than ``max_turn_deg`` (it has then left the basin).
    ``scale_px`` is the Geman-McClure scale, ``inlier_px`` only counts ``inlier_share``.
    """
    evidence = _gather(x_world, xy_px, confidence, K)
    if len(evidence.weight) < MIN_POINTS:
        count = len(evidence.weight)
        said = f"{count} usable points, at least {MIN_POINTS} are needed"
        return CameraPose(np.array(R_start), np.zeros(3), np.inf, 0.0, False, said)
    t = _translation(evidence, R_start, scale_px)
    R_held, t_held, _ = _refine(evidence, R_start, t, scale_px, iterations, turn=False)
    if not free_rotation:
        return _judge(evidence, R_held, t_held, inlier_px, "rotation held")
    R, t, settled = _refine(evidence, R_held, t_held, scale_px, iterations, turn=True)
    turn_deg = float(angle_deg(R_held, R))
    if turn_deg > max_turn_deg:
        said = f"refinement turned the camera by {turn_deg:.0f} degrees: its start is kept"
        return _judge(evidence, R_held, t_held, inlier_px, said)
    said = "converged" if settled else f"not settled after {iterations} iterations"
    return _judge(evidence, R, t, inlier_px, said)


def translation_given_rotation(
    x_world: Array,
    xy_px: Array,
    confidence: Array,
    K: Array,
    R: Array,
    *,
    scale_px: float = 10.0,
    inlier_px: float = 30.0,
) -> CameraPose:
    """`pnp_over_frames` with the rotation held throughout; same shapes."""
    return pnp_over_frames(
        x_world, xy_px, confidence, K, R,
        scale_px=scale_px, inlier_px=inlier_px, free_rotation=False,
    )  # fmt: skip


def _gather(x_world: Array, xy_px: Array, confidence: Array, K: Array) -> _Evidence:
    """Checked, flattened evidence without the missing points."""
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
    return _Evidence(x_world[valid], xy_px[valid], confidence[valid], frame, np.asarray(K, float))


def _linear_translation(evidence: _Evidence, R: Array, row_weight: Array) -> Array:
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


def _translation(evidence: _Evidence, R: Array, scale_px: float, candidates: int = 48) -> Array:
    """Best of linear translations of all frames and of short runs of frames, by robust cost.

    Runs of frames are the samples, because wrong matches come in runs: a right run exists as long
    as any part of the clip is right, and no dice are needed.
    """
    frames = np.unique(evidence.frame)
    groups = [frames]
    for length in sorted({1, min(8, len(frames)), max(1, len(frames) // 4)}):
        starts = np.linspace(0, len(frames) - length, min(candidates, len(frames)))
        groups += [frames[s : s + length] for s in np.unique(starts.astype(int))]
    best_t, best_cost = np.zeros(3), np.inf
    for group in groups:
        part = evidence.of(np.isin(evidence.frame, group))
        if len(part.weight) < 3:
            continue
        t = _linear_translation(part, R, part.weight)
        # the cost is wide here: a candidate from one run is rough everywhere else
        cost = _cost(evidence, R, t, 4.0 * scale_px)
        if cost < best_cost:
            best_t, best_cost = t, cost
    return best_t


def _errors_px(evidence: _Evidence, R: Array, t: Array) -> Array:
    """Pixel distance (N,); infinite for points that are not in front of the camera."""
    predicted = project(evidence.x_world, evidence.K, R, t)
    distance = np.linalg.norm(predicted - evidence.xy_px, axis=-1)
    return np.where(np.isfinite(distance), distance, np.inf)


def _cost(evidence: _Evidence, R: Array, t: Array, scale_px: float) -> float:
    """Weighted Geman-McClure cost, at most ``scale_px**2`` a point."""
    squared = np.minimum(_errors_px(evidence, R, t), FARTHEST_PX) ** 2
    return float(evidence.weight @ geman_mcclure(squared, scale_px)[0])


def _refine(
    evidence: _Evidence, R: Array, t: Array, scale_px: float, iterations: int, *, turn: bool
) -> tuple[Array, Array, bool]:
    """Damped Gauss-Newton on the Geman-McClure cost, its scale shrinking to ``scale_px``."""
    start = float(np.median(_errors_px(evidence, R, t)))
    scale = max(scale_px, min(2.0 * start, 20.0 * scale_px))
    damping, cost = 1e-4, _cost(evidence, R, t, scale)
    for _ in range(iterations):
        normal, gradient = _normal_equations(evidence, R, t, scale, turn=turn)
        lifted = normal + damping * np.diag(np.diag(normal)) + 1e-12 * np.eye(len(normal))
        step = -np.linalg.solve(lifted, gradient)
        R_new = Rotation.from_rotvec(step[3:]).as_matrix() @ R if turn else R
        # the increment turns about the points' middle, see _normal_equations
        pivot = camera_from_world(evidence.x_world.mean(0), R, np.zeros(3))
        t_new = t + step[:3] + (pivot - R_new @ R.T @ pivot)
        new_cost = _cost(evidence, R_new, t_new, scale)
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
            cost = _cost(evidence, R, t, scale)
    return R, t, False


def _normal_equations(
    evidence: _Evidence, R: Array, t: Array, scale_px: float, *, turn: bool
) -> tuple[Array, Array]:
    """J^T W J and J^T W r over (translation, rotation vector about the points' middle).

    Turning about the middle of the points instead of the camera keeps the two blocks nearly
    independent: a far camera otherwise trades rotation against translation.
    """
    K = evidence.K
    x_cam = camera_from_world(evidence.x_world, R, t)
    near = MIN_DEPTH_SHARE * max(float(np.median(x_cam[:, 2])), 1e-6)
    seen = x_cam[:, 2] > near
    x, y, z = x_cam[seen].T
    residual = (x_cam[seen] / z[:, None]) @ K[:2].T - evidence.xy_px[seen]
    by_plane = np.zeros((len(z), 2, 3))
    by_plane[:, 0, 0] = by_plane[:, 1, 1] = 1.0 / z
    by_plane[:, 0, 2], by_plane[:, 1, 2] = -x / z**2, -y / z**2
    by_point = K[:2, :2] @ by_plane
    jacobian = by_point
    if turn:
        lever = (evidence.x_world[seen] - evidence.x_world.mean(0)) @ R.T
        jacobian = np.concatenate([by_point, by_point @ -_cross_matrix(lever)], axis=-1)
    robust = geman_mcclure_weight(np.linalg.norm(residual, axis=-1), scale_px)
    weight = evidence.weight[seen] * robust
    normal = np.einsum("n,nai,naj->ij", weight, jacobian, jacobian)
    return normal, np.einsum("n,nai,na->i", weight, jacobian, residual)


def _cross_matrix(v: Array) -> Array:
    """Matrices (N, 3, 3) with ``_cross_matrix(v) @ w = v x w``."""
    out = np.zeros((len(v), 3, 3))
    out[:, 0, 1], out[:, 0, 2], out[:, 1, 2] = -v[:, 2], v[:, 1], -v[:, 0]
    return out - np.swapaxes(out, 1, 2)


def _judge(evidence: _Evidence, R: Array, t: Array, inlier_px: float, said: str) -> CameraPose:
    """The pose with its median error and the share of points within ``inlier_px``."""
    errors = _errors_px(evidence, R, t)
    share = float(evidence.weight @ (errors <= inlier_px) / evidence.weight.sum())
    median = float(np.median(errors))
    ok = bool(np.isfinite(median) and np.isfinite(t).all())
    return CameraPose(R, t, median, share, ok, said if ok else "most points are behind the camera")
