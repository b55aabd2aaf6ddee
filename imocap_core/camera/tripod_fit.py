"""A camera on one spot fitted to feature tracks: Levenberg-Marquardt under a narrowing loss."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from imocap_core.camera.tripod import (
    PairPoints,
    TrackedPair,
    TripodCamera,
    chained_tripod,
    transfer_errors_px,
    without_zoom,
)
from imocap_core.robust import geman_mcclure, geman_mcclure_weight

FOCAL_SPREAD = 0.7  # standard deviation of the logarithm of an unknown focal length
GIVEN_SPREAD = 0.02  # of a given one
DISTORTION_SPREAD = 0.1  # displacement of the corner, as a share
STRAIGHT_SPREAD = 1e-6  # of a lens without distortion
ZOOM_SPREAD = 0.7  # of the logarithm of a key frame's zoom
SCALES_PX = (8.0, 3.0, 1.0)  # of the Geman-McClure loss
MOST_STEPS = 15  # at each of them
CONVERGED = 1e-4  # share of the cost
DIFFERENCE = 1e-6  # of the finite differences
LEAST_NOISE_PX = 0.1  # of a track, along each axis
RAYLEIGH_MEDIAN = 1.1774  # length of a normal error in the plane, in standard deviations of an axis


@dataclass(frozen=True)
class _Problem:
    """Points, and the prior's mean and standard deviations in the order of the increments."""

    points: PairPoints
    assumed: float
    spread: Float[np.ndarray, " n"]

    def cost(self, camera: TripodCamera, scale: float) -> float:
        squared = (camera.errors_px(self.points) ** 2).sum(axis=1)
        prior = self.prior(camera) / self.spread
        return float(geman_mcclure(squared, scale)[0].sum() + prior @ prior)

    def prior(self, camera: TripodCamera) -> Float[np.ndarray, " n"]:
        """How far the unknowns are from their prior's mean; rotations have none."""
        values = [camera.log_focal - self.assumed, camera.distortion]
        return np.concatenate([values, camera.log_zoom, np.zeros(3 * len(camera.R))])


def fit_tripod(
    pairs: Sequence[TrackedPair],
    keys: int,
    size: tuple[int, int],
    focal_px: float | None,
    *,
    straight: bool = False,
) -> TripodCamera:
    """The better of two minima: started with the zooms of the pictures' scales, and without.

    Args:
        pairs: those of consecutive key frames, (0, 1), (1, 2) ..., among them.
        keys: number of key frames. focal_px: the focal length where it is given.
        straight: whether the lens is taken to have no distortion.
    """
    assumed = focal_px or float(max(size))
    problem = _problem(pairs, keys, size, focal_px, straight)
    chained = chained_tripod(pairs, keys, size, assumed)
    fits = []
    for camera in (chained, without_zoom(chained)):
        for scale in SCALES_PX:
            camera = _minimised(problem, camera, scale)
        fits.append(camera)
    return min(fits, key=lambda fit: problem.cost(fit, SCALES_PX[-1]))


def refit_tripod(
    pairs: Sequence[TrackedPair],
    size: tuple[int, int],
    focal_px: float | None,
    start: TripodCamera,
    *,
    straight: bool = False,
) -> TripodCamera:
    """The minimum near a start, for other tracks of its key frames or without distortion."""
    problem = _problem(pairs, len(start.R), size, focal_px, straight)
    camera = replace(start, distortion=0.0) if straight else start
    for scale in SCALES_PX[1:]:
        camera = _minimised(problem, camera, scale)
    return camera


def distortion_sd(
    pairs: Sequence[TrackedPair],
    size: tuple[int, int],
    focal_px: float | None,
    camera: TripodCamera,
) -> float:
    """Standard deviation of a fitted camera's distortion, by the curvature of the loss and the size
    of the errors; all else unknown too."""
    problem = _problem(pairs, len(camera.R), size, focal_px, straight=False)
    error = np.linalg.norm(camera.errors_px(problem.points), axis=1)
    noise_px = max(LEAST_NOISE_PX, float(np.median(error)) / RAYLEIGH_MEDIAN)
    normal, _ = _normal_equations(problem, camera, SCALES_PX[-1])
    return noise_px * float(np.linalg.inv(normal)[1, 1]) ** 0.5


def _problem(
    pairs: Sequence[TrackedPair],
    keys: int,
    size: tuple[int, int],
    focal_px: float | None,
    straight: bool,
) -> _Problem:
    spread = np.full(2 + 4 * keys, 1e3)
    spread[0] = GIVEN_SPREAD if focal_px else FOCAL_SPREAD
    spread[1] = STRAIGHT_SPREAD if straight else DISTORTION_SPREAD
    spread[2 : 2 + keys] = ZOOM_SPREAD
    spread[[2, *range(2 + keys, 5 + keys)]] = 1e-4  # the first key frame is the origin
    assumed = float(np.log(focal_px or float(max(size))))
    return _Problem(PairPoints.of(pairs, size), assumed, spread)


def _minimised(problem: _Problem, camera: TripodCamera, scale: float) -> TripodCamera:
    cost, damping = problem.cost(camera, scale), 1e-3
    for _ in range(MOST_STEPS):
        normal, gradient = _normal_equations(problem, camera, scale)
        while True:
            damped = normal + damping * np.diag(np.diag(normal))
            candidate = camera.retracted(-np.linalg.solve(damped, gradient))
            lower = problem.cost(candidate, scale)
            if lower < cost:
                break
            damping *= 10
            if damping > 1e4:
                return camera
        converged = cost - lower < CONVERGED * cost
        camera, cost, damping = candidate, lower, damping / 10
        if converged:
            break
    return camera


def _normal_equations(
    problem: _Problem, camera: TripodCamera, scale: float
) -> tuple[Float[np.ndarray, "n n"], Float[np.ndarray, " n"]]:
    """J^T W J and J^T W r of points and prior."""
    error = camera.errors_px(problem.points)
    root = np.sqrt(geman_mcclure_weight(np.linalg.norm(error, axis=1), scale))[:, None]
    J = _jacobian(problem.points, camera, error) * root[..., None]
    flat, residual = J.reshape(-1, J.shape[-1]), (error * root).ravel()
    weight = problem.spread**-2
    return flat.T @ flat + np.diag(weight), flat.T @ residual + weight * problem.prior(camera)


def _jacobian(
    points: PairPoints, camera: TripodCamera, error: Float[np.ndarray, "P 2"]
) -> Float[np.ndarray, "P 2 n"]:
    """Finite differences: a point's error depends on ten unknowns, changed for all at once."""
    keys, rows = len(camera.R), np.arange(len(error))
    log_focal = camera.log_focal + camera.log_zoom
    now = (log_focal[points.a], log_focal[points.b], camera.R[points.a], camera.R[points.b])

    def change(more: float = 0.0, **moved: Float[np.ndarray, "P ..."]) -> np.ndarray:
        values = dict(zip(("focal_a", "focal_b", "R_a", "R_b"), now, strict=True)) | moved
        moved_px = transfer_errors_px(points, camera.distortion + more, *values.values())
        return (moved_px - error) / DIFFERENCE

    J = np.zeros((len(error), 2, 2 + 4 * keys))
    by_a, by_b = change(focal_a=now[0] + DIFFERENCE), change(focal_b=now[1] + DIFFERENCE)
    J[..., 0], J[..., 1] = by_a + by_b, change(DIFFERENCE)
    J[rows, :, 2 + points.a] += by_a
    J[rows, :, 2 + points.b] += by_b
    for axis in range(3):
        turn = Rotation.from_rotvec(DIFFERENCE * np.eye(3)[axis]).as_matrix()
        J[rows, :, 2 + keys + 3 * points.a + axis] += change(R_a=now[2] @ turn)
        J[rows, :, 2 + keys + 3 * points.b + axis] += change(R_b=now[3] @ turn)
    return J
