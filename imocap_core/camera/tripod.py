"""A camera on one spot: rotations and zooms of key frames, one focal length, radial distortion.

The most that a background can show without parallax. Its parameters are fitted to feature tracks
over pairs of key frames (`tripod_fit`): a point of one is where the other's ray, rotated, meets its
picture.

Radial distortion of a camera on one spot, estimated from how its background moves as it turns. A
rotation moves the picture of a pinhole camera by a homography of three parameters; what is left,
the same in every pair of frames, is the lens. It counts only where tracks that took no part in the
fit agree with it, in both halves of them, by far more than by chance.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Literal

import cv2
import numpy as np
from jaxtyping import Float, Int64
from scipy.spatial.transform import Rotation

from imocap_core.camera.averaging import nearest_rotation
from imocap_core.camera.background import FeatureTracks
from imocap_core.camera.projection import Lens, intrinsics, lens_of_corner, rays
from imocap_core.robust import geman_mcclure, geman_mcclure_weight

FAR_PX = 1000.0  # error of a point behind the camera


@dataclass(frozen=True)
class TrackedPair:
    """Tracks that two key frames (by their indices) share, in pixels of both."""

    a: int
    b: int
    xy_a: Float[np.ndarray, "P 2"]
    xy_b: Float[np.ndarray, "P 2"]


@dataclass(frozen=True)
class PairPoints:
    """The points of several pairs, each with the indices of its two key frames.

    xy_a, xy_b: pixels relative to the picture's middle; corner_px: from there to its corner.
    """

    a: Int64[np.ndarray, " P"]
    b: Int64[np.ndarray, " P"]
    xy_a: Float[np.ndarray, "P 2"]
    xy_b: Float[np.ndarray, "P 2"]
    corner_px: float

    @classmethod
    def of(cls, pairs: Sequence[TrackedPair], size: tuple[int, int]) -> PairPoints:
        """Points of pictures of a size."""
        counts = [len(pair.xy_a) for pair in pairs]
        middle = (np.array(size) - 1) / 2
        return cls(
            np.repeat([pair.a for pair in pairs], counts),
            np.repeat([pair.b for pair in pairs], counts),
            np.concatenate([pair.xy_a for pair in pairs]) - middle,
            np.concatenate([pair.xy_b for pair in pairs]) - middle,
            float(np.linalg.norm(middle)),
        )

    def straightened(self, distortion: float) -> tuple[PairPoints, Lens | None]:
        """The same without the distortion of b's picture, and the lens; None for a pinhole."""
        if not distortion:
            return self, None
        lens = Lens.of([distortion], np.diag([self.corner_px, self.corner_px, 1.0]))
        return replace(self, xy_b=lens.undistorted(self.xy_b)), lens


@dataclass(frozen=True)
class TripodCamera:
    """Key frames of a camera on one spot.

    Attributes:
        log_focal: logarithm of the first key frame's focal length, pixels.
        distortion: the lens shows an undistorted point ``1 + distortion r^2`` times as far from the
            middle, r = 1 in the picture's corner (OpenCV's k1 of a focal length as long as that).
        log_zoom: (F,) of each key frame's focal length over the first one's.
        R: (F, 3, 3) from each key frame's axes to the first one's.
    """

    log_focal: float
    distortion: float
    log_zoom: Float[np.ndarray, " F"]
    R: Float[np.ndarray, "F 3 3"]

    @property
    def focal_px(self) -> float:
        """Focal length of the first key frame."""
        return float(np.exp(self.log_focal))

    def errors_px(self, points: PairPoints) -> Float[np.ndarray, "P 2"]:
        """Where a's picture should show the points of b, less where it does."""
        log_focal = self.log_focal + self.log_zoom
        focal = log_focal[points.a], log_focal[points.b]
        straight = points.straightened(self.distortion)
        return _transfer_errors_px(*straight, *focal, self.R[points.a], self.R[points.b])

    def retracted(self, change: Float[np.ndarray, " n"]) -> TripodCamera:
        """After increments [focal, distortion, zooms, rotations ``R <- R exp(change)``]."""
        keys = len(self.R)
        turn = Rotation.from_rotvec(change[2 + keys :].reshape(-1, 3)).as_matrix()
        return TripodCamera(
            self.log_focal + float(change[0]),
            self.distortion + float(change[1]),
            self.log_zoom + change[2 : 2 + keys],
            self.R @ turn,
        )


def _transfer_errors_px(
    points: PairPoints,
    lens: Lens | None,
    log_focal_a: Float[np.ndarray, " P"],
    log_focal_b: Float[np.ndarray, " P"],
    R_a: Float[np.ndarray, "P 3 3"],
    R_b: Float[np.ndarray, "P 3 3"],
) -> Float[np.ndarray, "P 2"]:
    """Errors of `TripodCamera.errors_px`, with each straightened point's own two cameras.

    In the picture as it is: errors of undistorted points would be smallest for the lens that
    shrinks the picture.
    """
    focal_a, focal_b = np.exp(log_focal_a)[:, None], np.exp(log_focal_b)[:, None]
    ray = np.concatenate([points.xy_b / focal_b, np.ones_like(focal_b)], axis=1)
    ray = np.einsum("pji,pj->pi", R_a, np.einsum("pij,pj->pi", R_b, ray))
    shown = focal_a * ray[:, :2] / np.maximum(ray[:, 2:], 1e-3)
    if lens is not None:
        shown = lens.distorted(shown)
    return np.asarray(np.clip(shown - points.xy_a, -FAR_PX, FAR_PX))


def _chained_tripod(
    pairs: Sequence[TrackedPair], keys: int, size: tuple[int, int], focal_px: float
) -> TripodCamera:
    """Rotations and zooms from one key frame to the next, at an assumed focal length.

    Args:
        pairs: those of consecutive key frames, (0, 1), (1, 2) ..., among them.
    """
    steps = {(pair.a, pair.b): pair for pair in pairs}
    R, log_zoom = [np.eye(3)], [0.0]
    for k in range(1, keys):
        pair = steps[k - 1, k]
        log_zoom.append(log_zoom[-1] + _log_scale(pair))
        ray_a, ray_b = (
            rays(xy, intrinsics(focal_px * float(np.exp(zoom)), size))
            for xy, zoom in zip((pair.xy_a, pair.xy_b), log_zoom[-2:], strict=True)
        )
        R.append(R[-1] @ _rotation(ray_a, ray_b))
    return TripodCamera(float(np.log(focal_px)), 0.0, np.array(log_zoom), np.stack(R))


def _rotation(
    ray_a: Float[np.ndarray, "P 3"], ray_b: Float[np.ndarray, "P 3"]
) -> Float[np.ndarray, "3 3"]:
    """R_a_from_b of the robust Wahba problem."""
    weight, R = np.ones(len(ray_a)), np.eye(3)
    for _ in range(6):
        R = nearest_rotation((ray_a * weight[:, None]).T @ ray_b)
        angle = np.linalg.norm(ray_b @ R.T - ray_a, axis=1)
        weight = geman_mcclure_weight(angle, max(1e-4, 2 * float(np.median(angle))))
    return R


def _log_scale(pair: TrackedPair) -> float:
    """Logarithm of b's magnification relative to a, by a robust similarity."""
    A, _ = cv2.estimateAffinePartial2D(pair.xy_a, pair.xy_b, ransacReprojThreshold=2.0)
    return 0.0 if A is None else 0.5 * float(np.log(max(np.linalg.det(A[:, :2]), 1e-3)))


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
    chained = _chained_tripod(pairs, keys, size, assumed)
    fits = []
    for camera in (chained, replace(chained, log_zoom=np.zeros(keys))):
        for scale in SCALES_PX:
            camera = _minimised(problem, camera, scale)
        fits.append(camera)
    return min(fits, key=lambda fit: problem.cost(fit, SCALES_PX[-1]))


def _refit_tripod(
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


def _distortion_sd(
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

    straight, bent = (points.straightened(camera.distortion + d) for d in (0.0, DIFFERENCE))

    def change(of: Any = straight, **moved: Float[np.ndarray, "P ..."]) -> np.ndarray:
        values = dict(zip(("focal_a", "focal_b", "R_a", "R_b"), now, strict=True)) | moved
        return (_transfer_errors_px(*of, *values.values()) - error) / DIFFERENCE

    J = np.zeros((len(error), 2, 2 + 4 * keys))
    by_a, by_b = change(focal_a=now[0] + DIFFERENCE), change(focal_b=now[1] + DIFFERENCE)
    J[..., 0], J[..., 1] = by_a + by_b, change(bent)
    J[rows, :, 2 + points.a] += by_a
    J[rows, :, 2 + points.b] += by_b
    for axis in range(3):
        turn = Rotation.from_rotvec(DIFFERENCE * np.eye(3)[axis]).as_matrix()
        J[rows, :, 2 + keys + 3 * points.a + axis] += change(R_a=now[2] @ turn)
        J[rows, :, 2 + keys + 3 * points.b + axis] += change(R_b=now[3] @ turn)
    return J


LEAST = 0.015  # displacement of the picture's corner, as a share, that is worth correcting
WORTH_A_WORD = 0.04
CERTAIN_SIGMAS = 3.0
LEAST_GAIN = 0.1  # of the held-out tracks' cost
GAIN_SIGMAS = 3.0  # of the mean gain of a held-out track
HALVES_APART = 0.35  # of the distortion, at most
LOSS_PX = 1.0
MODEL_SD = 0.005  # of the distortion: noise of the tracks, and lenses of more than one coefficient
FEWEST_OF_A_PAIR = 8  # tracks of a half that two consecutive key frames share


@dataclass(frozen=True)
class TurningLens:
    """The estimate of a turning camera's lens.

    Attributes:
        distortion: `TripodCamera.distortion`; sd: its standard deviation, as if the tracks' errors
            were all of one kind: a camera that hardly turns tells nothing.
        gain: share of held-out tracks' cost that it removes; sigmas: this over its standard error.
        apart: difference between the distortions of two halves of the tracks.
    """

    source: ClassVar[Literal["rotation"]] = "rotation"

    distortion: float
    sd: float
    gain: float
    sigmas: float
    apart: float

    @property
    def words(self) -> str:
        """What is said of a lens that is clearly far from a pinhole, its size uncertain."""
        clear = abs(self.distortion) >= max(WORTH_A_WORD, CERTAIN_SIGMAS * self.sd)
        if self.certain or not clear or self.sigmas < GAIN_SIGMAS:
            return ""
        return (
            "; its lens seems to displace the picture's corners by about "
            f"{abs(self.distortion):.0%}, too uncertain to be corrected: give `distortion` and "
            "`focal_px`"
        )

    def lens(self, K: Float[np.ndarray, "3 3"], size: tuple[int, int]) -> tuple[Lens, float]:
        """The lens of pictures of a size whose focal length is K's, and the standard deviation of
        its k1."""
        return lens_of_corner(self.distortion, self.sd, K, size)

    @property
    def certain(self) -> bool:
        """Whether the evidence is clear enough to correct the pictures."""
        size = abs(self.distortion)
        return bool(
            size >= max(LEAST, CERTAIN_SIGMAS * self.sd, self.apart / HALVES_APART)
            and self.gain >= LEAST_GAIN
            and self.sigmas >= GAIN_SIGMAS
        )


def turning_lens(
    tracks: FeatureTracks,
    pairs_of: Callable[[FeatureTracks], Sequence[TrackedPair]],
    size: tuple[int, int],
    focal_px: float | None,
    tripod: TripodCamera,
) -> TurningLens | None:
    """The lens by two halves of the tracks, each against what the other half was fitted to.

    Args:
        pairs_of: pairs of its key frames from tracks. tripod: fitted to all of them.

    None where a half has too few tracks.
    """
    halves = [tracks.some(tracks.track % 2 == part) for part in (0, 1)]
    pairs = [list(pairs_of(half)) for half in halves]
    if min(len(pair.xy_a) for half in pairs for pair in half) < FEWEST_OF_A_PAIR:
        return None
    gains, before, fitted = [], [], []
    for fit_to, other in (pairs, pairs[::-1]):
        bent = _refit_tripod(fit_to, size, focal_px, tripod)
        straight = _refit_tripod(fit_to, size, focal_px, tripod, straight=True)
        points = PairPoints.of(other, size)
        costs = [_cost(camera, points) for camera in (straight, bent)]
        gains.append(costs[0] - costs[1])
        before.append(costs[0])
        fitted.append(bent.distortion)
    gain, cost = np.concatenate(gains), np.concatenate(before)
    together = np.sqrt(np.mean([len(half) for half in pairs]))  # a track is in several pairs
    error = together * float(gain.std()) / np.sqrt(len(gain))
    return TurningLens(
        distortion=tripod.distortion,
        sd=float(
            np.linalg.norm(
                [
                    MODEL_SD,
                    _distortion_sd([*pairs[0], *pairs[1]], size, focal_px, tripod),
                    _systematic_sd([*pairs[0], *pairs[1]], size, tripod),
                ]
            )
        ),
        gain=float(gain.sum() / max(cost.sum(), 1e-12)),
        sigmas=float(gain.mean() / max(error, 1e-12)),
        apart=abs(fitted[0] - fitted[1]),
    )


def _systematic_sd(
    pairs: Sequence[TrackedPair], size: tuple[int, int], tripod: TripodCamera
) -> float:
    """Of the distortion, where all tracks err alike, as by a step aside: their error over how far
    the widest pair moves the picture."""
    error = np.linalg.norm(tripod.errors_px(PairPoints.of(pairs, size)), axis=1)
    moved = (np.linalg.norm(pair.xy_a - pair.xy_b, axis=1) for pair in pairs)
    return float(np.median(error) / max(max(float(np.median(m)) for m in moved), 1e-9))


def _cost(camera: TripodCamera, points: PairPoints) -> Float[np.ndarray, " P"]:
    """Robust cost of every point."""
    squared = (camera.errors_px(points) ** 2).sum(axis=1)
    return np.asarray(geman_mcclure(squared, LOSS_PX)[0])
