"""Calibration of cameras from one event: bundle adjustment of the performer's keypoints.

All videos show the same performance, so a keypoint is one point in space that every camera sees
(Hartley and Zisserman, Multiple View Geometry, 2nd ed., section 18.1). Unknown are all points,
every camera's pose, focal length and radial distortion, and when each video began. A detector's
errors are partly constant over a view's frames, and these are larger than its noise: they are
unknowns too, with a prior, so that they are not taken for evidence of the cameras. Points are
eliminated moment by moment (Schur complement), as bones tie those of one moment to each other.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from imocap_core.camera.pnp import cross_matrix
from imocap_core.motion.event_rig import (
    CAMERA,
    DISTORTION,
    FOCAL,
    OFFSET,
    RATE,
    ROTATION,
    TRANSLATION,
    CameraRig,
    EventVideo,
    KeypointSamples,
    bone_lengths,
    sample,
    typical_lengths,
)
from imocap_core.robust import cauchy

NEAREST_M = 0.01  # a point behind a camera counts as this far in front of it
LEAST_VIEWS = 2  # of a point: fewer do not place it


@dataclass(frozen=True)
class Projection:
    """Residuals of N moments, J points, M cameras, and what their derivatives are made of.

    Attributes:
        error_px: (N, J, M, 2) predicted minus detected, the bias among the prediction.
        x_cam: (N, J, M, 3) metres; flat: (N, J, M, 2) undistorted normalised coordinates.
    """

    error_px: Float[np.ndarray, "N J M 2"]
    x_cam: Float[np.ndarray, "N J M 3"]
    flat: Float[np.ndarray, "N J M 2"]


@dataclass(frozen=True)
class Derivatives:
    """camera: (N, J, M, 2, 12), a camera's columns and then its bias; point: (N, J, M, 2, 3)."""

    camera: Float[np.ndarray, "N J M 2 C"]
    point: Float[np.ndarray, "N J M 2 3"]


def project(rig: CameraRig, samples: KeypointSamples) -> Projection:
    """All points in all cameras, against the keypoints."""
    x_cam = np.einsum("mab,njb->njma", rig.R, rig.points) + rig.t
    depth = np.maximum(x_cam[..., 2:], NEAREST_M)
    flat = x_cam[..., :2] / depth
    bent = flat * (1 + rig.distortion[:, None] * (flat**2).sum(-1, keepdims=True))
    bias = samples.size_px[:, None, :, None] * rig.bias.swapaxes(0, 1)
    predicted = rig.focal_px[:, None] * bent + rig.K[:, :2, 2] + bias
    return Projection(predicted - samples.xy_px, x_cam, flat)


def placed(samples: KeypointSamples) -> Bool[np.ndarray, "N J"]:
    """The points that enough cameras see."""
    return (samples.weight > 0).sum(-1) >= LEAST_VIEWS


def visible(samples: KeypointSamples) -> Float[np.ndarray, "N J M"]:
    """The weights of the points that enough cameras see."""
    return np.where(placed(samples)[..., None], samples.weight, 0.0)


def derivatives(
    rig: CameraRig,
    samples: KeypointSamples,
    projection: Projection,
    moments: Float[np.ndarray, " N"],
) -> Derivatives:
    """Derivatives of the residuals; of the offset and rate by the keypoints' velocity."""
    flat, f = projection.flat, rig.focal_px[:, None]
    depth = np.maximum(projection.x_cam[..., 2], NEAREST_M)
    k, r2 = rig.distortion[:, None], (flat**2).sum(-1, keepdims=True)
    by_flat = 2 * k[..., None] * flat[..., :, None] * flat[..., None, :]
    by_flat[..., [0, 1], [0, 1]] += 1 + k * r2
    by_flat *= f[..., None]
    to_flat = np.zeros((*depth.shape, 2, 3))
    to_flat[..., 0, 0] = to_flat[..., 1, 1] = 1 / depth
    to_flat[..., :, 2] = -flat / depth[..., None]
    by_x_cam = by_flat @ to_flat
    turned = projection.x_cam - rig.t
    camera = np.zeros((*depth.shape, 2, CAMERA + 2))
    camera[..., ROTATION] = -by_x_cam @ cross_matrix(turned)
    camera[..., TRANSLATION] = by_x_cam
    camera[..., FOCAL] = f * (1 + k * r2) * flat
    camera[..., DISTORTION] = f * r2 * flat
    camera[..., OFFSET] = -samples.velocity_px
    camera[..., RATE] = -samples.velocity_px * (rig.rate * moments[:, None])[:, None, :, None]
    camera[..., [0, 1], [CAMERA, CAMERA + 1]] = samples.size_px[:, None, :, None]
    return Derivatives(camera, by_x_cam @ rig.R)


ROBUST_SIGMAS = 1.0  # Cauchy scale, in standard deviations of a detection or a bone
# Standard deviations: of a detector's constant error at one point of one video, as a share of the
# person's size; of a bone's length, as detected, about its mean; of that mean about the bone's
# length in the body; of the logarithms of unknown focal lengths about their mean, among cameras
# whose pictures have one size; of a lens's radial distortion (coefficient of the squared distance
# from the middle, in focal lengths); of the logarithm of a video's frame rate against its header's.
BIAS_SHARE = 0.02
BONE_NOISE_M = 0.01
BONE_LENGTH_SPREAD_M = 0.05
COMMON_FOCAL_SPREAD = 0.07
DISTORTION_SPREAD = 0.05
RATE_SPREAD = 0.001


@dataclass(frozen=True)
class EventProblem:
    """Everything that stays fixed while a rig is solved for.

    Attributes:
        videos: M of them; moments: (N,) frames of the reference that are used.
        bones: (B, 2) columns of the points.
        reference: the video whose camera is the world and whose frames are the time.
        focal_log_sd: (M,) standard deviations of the prior's focal lengths' logarithms; 0: known.
        alike: (M,) number of the kind of camera; those of one kind have similar focal lengths.
        prior: the rig that priors are about: its focal lengths, offsets, rates and bone lengths.
        offset_sd: (M,) standard deviation of its offsets, frames.
        fixed_distortion: (M,) the lenses that stay as they are in ``prior``.
    """

    videos: Sequence[EventVideo]
    moments: Float[np.ndarray, " N"]
    bones: Int[np.ndarray, "B 2"]
    reference: int
    focal_log_sd: Float[np.ndarray, " M"]
    alike: Int[np.ndarray, " M"]
    prior: CameraRig
    offset_sd: Float[np.ndarray, " M"]
    fixed_distortion: Bool[np.ndarray, " M"]

    def samples(self, rig: CameraRig) -> KeypointSamples:
        """The keypoints at the rig's offsets and rates."""
        return sample(self.videos, rig.offset, rig.rate, self.moments)

    @property
    def fixed(self) -> Bool[np.ndarray, "M C"]:
        """The columns of the cameras that stay as they are."""
        out = np.zeros((len(self.videos), CAMERA), dtype=bool)
        out[self.reference, [*range(6), OFFSET, RATE]] = True
        out[:, FOCAL] = self.focal_log_sd <= 0
        out[:, DISTORTION] = self.fixed_distortion
        return out

    def prior_terms(
        self, rig: CameraRig
    ) -> tuple[float, Float[np.ndarray, "M C M C"], Float[np.ndarray, "M C"]]:
        """Cost, curvature and gradient of the priors of the cameras' columns."""
        M = len(self.videos)
        away = np.zeros((M, CAMERA))
        away[:, FOCAL] = np.log(rig.focal_px / self.prior.focal_px)
        away[:, DISTORTION] = rig.distortion
        away[:, OFFSET] = rig.offset - self.prior.offset
        away[:, RATE] = np.log(rig.rate / self.prior.rate)
        precision = np.zeros((M, CAMERA))
        free = self.focal_log_sd > 0
        precision[free, FOCAL] = self.focal_log_sd[free] ** -2.0
        precision[:, DISTORTION] = DISTORTION_SPREAD**-2
        precision[:, OFFSET] = self.offset_sd**-2.0
        precision[:, RATE] = RATE_SPREAD**-2
        curvature = np.zeros((M, CAMERA, M, CAMERA))
        videos, columns = np.indices((M, CAMERA))
        curvature[videos, columns, videos, columns] = precision
        gradient = precision * away
        cost = float((precision * away**2).sum())
        same = (self.alike[:, None] == self.alike) & free[:, None] & free
        centring = np.diag(free.astype(float)) - same / np.maximum(same.sum(axis=1), 1)
        alike = centring / COMMON_FOCAL_SPREAD**2
        log_f = np.log(rig.focal_px)
        curvature[:, FOCAL, :, FOCAL] += alike
        gradient[:, FOCAL] += alike @ log_f
        return cost + float(log_f @ alike @ log_f), curvature, gradient

    def cost(self, rig: CameraRig) -> float:
        """The objective: minus twice the logarithm of the posterior, up to a constant."""
        samples = self.samples(rig)
        weight = visible(samples)
        squared = weight * (project(rig, samples).error_px ** 2).sum(-1)
        bones = bone_lengths(rig.points, placed(samples), self.bones)
        off = np.where(bones.present, (bones.length_m - rig.lengths) / BONE_NOISE_M, 0.0)
        biases = float((rig.bias**2).sum()) / BIAS_SHARE**2
        from_body = ((rig.lengths - self.prior.lengths) / BONE_LENGTH_SPREAD_M) ** 2
        robust = sum(cauchy(x, ROBUST_SIGMAS)[0].sum() for x in (squared, off**2))
        return float(robust) + biases + float(from_body.sum()) + self.prior_terms(rig)[0]


CHUNK = 64  # moments at once
UNSEEN = 1e-6  # precision of a point or camera that nothing places: it stays where it is


@dataclass(frozen=True)
class ReducedSystem:
    """The system of cameras, biases and lengths (P unknowns), and how the points follow.

    Attributes:
        matrix: (P, P) curvature; gradient: (P,).
        fixed: (P,) unknowns that stay.
        follow: (N, 3J, P) and rest: (N, 3J): points step by ``-rest - follow @ step``.
    """

    matrix: Float[np.ndarray, "P P"]
    gradient: Float[np.ndarray, " P"]
    fixed: Bool[np.ndarray, " P"]
    follow: Float[np.ndarray, "N Q P"]
    rest: Float[np.ndarray, "N Q"]

    def step(self, damping: float) -> tuple[Float[np.ndarray, " P"], Float[np.ndarray, "N J 3"]]:
        """Damped step of all unknowns."""
        free = ~self.fixed
        matrix = self.matrix[np.ix_(free, free)]
        lifted = matrix + damping * np.diag(np.diag(matrix))
        out = np.zeros(len(free))
        out[free] = -np.linalg.solve(lifted, self.gradient[free])
        points = -self.rest - self.follow @ out
        return out, points.reshape(len(points), -1, 3)

    def covariance(self) -> Float[np.ndarray, "P P"]:
        """Of the unknowns, 0 where fixed."""
        free = np.ix_(~self.fixed, ~self.fixed)
        out = np.zeros_like(self.matrix)
        out[free] = np.linalg.inv(self.matrix[free])
        return out


def reduced(problem: EventProblem, rig: CameraRig, damping: float = 0.0) -> ReducedSystem:
    """The system about a rig; ``damping`` of the points' own curvature."""
    M = len(rig.K)
    first, last = CAMERA * M, CAMERA * M + rig.bias.size
    unknowns = last + len(problem.bones)
    matrix, gradient = np.zeros((unknowns, unknowns)), np.zeros(unknowns)
    samples, follow, rest = problem.samples(rig), [], []
    for begin in range(0, len(problem.moments), CHUNK):
        part = slice(begin, begin + CHUNK)
        block = _moments(problem, rig, samples, part, unknowns)
        matrix += block.matrix
        gradient += block.gradient
        of_points = block.points
        diagonal = np.einsum("nqq->nq", of_points)
        diagonal *= 1 + damping
        diagonal += UNSEEN
        solved = np.linalg.solve(
            of_points, np.concatenate([block.mixed, block.pull[..., None]], -1)
        )
        follow.append(solved[..., :-1])
        rest.append(solved[..., -1])
        matrix -= np.tensordot(block.mixed, follow[-1], axes=([0, 1], [0, 1]))
        gradient -= np.einsum("nqp,nq->p", block.mixed, rest[-1])
    _, curvature, pull = problem.prior_terms(rig)
    matrix[:first, :first] += curvature.reshape(first, first) + UNSEEN * np.eye(first)
    gradient[:first] += pull.ravel()
    biases = np.arange(first, last)
    matrix[biases, biases] += BIAS_SHARE**-2
    gradient[biases] += rig.bias.ravel() / BIAS_SHARE**2
    lengths, precision = np.arange(last, unknowns), BONE_LENGTH_SPREAD_M**-2
    matrix[lengths, lengths] += precision
    gradient[lengths] += precision * (rig.lengths - problem.prior.lengths)
    fixed = np.zeros(unknowns, dtype=bool)
    fixed[:first] = problem.fixed.ravel()
    return ReducedSystem(matrix, gradient, fixed, np.concatenate(follow), np.concatenate(rest))


@dataclass(frozen=True)
class _Block:
    """Some moments' share of the system: of the P unknowns, of the points, and of both."""

    matrix: Float[np.ndarray, "P P"]
    gradient: Float[np.ndarray, " P"]
    points: Float[np.ndarray, "N Q Q"]
    pull: Float[np.ndarray, "N Q"]
    mixed: Float[np.ndarray, "N Q P"]


def _moments(
    problem: EventProblem, rig: CameraRig, samples: KeypointSamples, part: slice, unknowns: int
) -> _Block:
    some, here = samples.part(part), replace(rig, points=rig.points[part])
    projection = project(here, some)
    slopes = derivatives(here, some, projection, problem.moments[part])
    base = visible(some)
    error = projection.error_px
    weight = base * cauchy(base * (error**2).sum(-1), ROBUST_SIGMAS)[1]
    N, J, M = weight.shape
    weighted = weight[..., None, None] * slopes.camera
    of_camera = np.einsum("njmac,njmad->jmcd", weighted, slopes.camera, optimize=True)
    pull = np.einsum("njmac,njma->jmc", weighted, error)
    mixed_ = np.einsum("njmax,njmac->njmxc", slopes.point, weighted, optimize=True)
    matrix, gradient = np.zeros((unknowns, unknowns)), np.zeros(unknowns)
    mixed = np.zeros((N, J, 3, unknowns))
    for m in range(M):
        camera = np.arange(CAMERA * m, CAMERA * (m + 1))
        for j in range(J):
            bias = CAMERA * M + 2 * (m * J + j)
            columns = np.concatenate([camera, [bias, bias + 1]])
            matrix[np.ix_(columns, columns)] += of_camera[j, m]
            gradient[columns] += pull[j, m]
            mixed[:, j][:, :, columns] += mixed_[:, j, m]
    points = np.zeros((N, J, 3, J, 3))
    each = np.arange(J)
    by_point = np.einsum("njm,njmax,njmay->njxy", weight, slopes.point, slopes.point, optimize=True)
    points[:, each, :, each, :] = by_point.swapaxes(0, 1)
    point_pull = np.einsum("njm,njmax,njma->njx", weight, slopes.point, error)
    block = _Block(
        matrix, gradient, points.reshape(N, 3 * J, 3 * J), point_pull.reshape(N, 3 * J),
        mixed.reshape(N, 3 * J, unknowns),
    )  # fmt: skip
    _add_bones(problem, here, placed(some), block)
    return block


def _add_bones(
    problem: EventProblem, rig: CameraRig, present: Bool[np.ndarray, "N J"], block: _Block
) -> None:
    """The bones' share, in place."""
    bones = bone_lengths(rig.points, present, problem.bones)
    N, first = len(rig.points), len(block.gradient) - len(problem.bones)
    off = bones.length_m - rig.lengths
    precision = BONE_NOISE_M**-2
    robust = cauchy(precision * off**2, ROBUST_SIGMAS)[1]
    weight = np.where(bones.present, precision * robust, 0.0)
    points = block.points.reshape(N, -1, 3, block.points.shape[1] // 3, 3)
    pull = block.pull.reshape(N, -1, 3)
    mixed = block.mixed.reshape(N, -1, 3, len(block.gradient))
    for k, (a, b) in enumerate(problem.bones):
        u, w = bones.direction[:, k], weight[:, k, None]
        outer = w[..., None] * u[:, :, None] * u[:, None, :]
        for row, sign in ((a, 1.0), (b, -1.0)):
            points[:, row, :, row] += outer
            pull[:, row] += sign * w * off[:, k, None] * u
            mixed[:, row, :, first + k] -= sign * w * u
        points[:, a, :, b] -= outer
        points[:, b, :, a] -= outer
        block.matrix[first + k, first + k] += w.sum()
        block.gradient[first + k] -= (w[:, 0] * off[:, k]).sum()


MOST_STEPS = 60
TOLERANCE = 1e-5  # share of the objective that the last step lowers it by
CERTAIN_SIGMAS = 3.0  # of a distortion: below, the lens counts as straight

Progress = Callable[[str], None]


@dataclass(frozen=True)
class EventCalibration:
    """A solved rig.

    Attributes:
        sd: (M, 10) standard deviations of the cameras' columns (`rig`).
        median_px: (M,) median reprojection error of each video, its biases taken off.
        cost: the objective; status: a sentence.
    """

    rig: CameraRig
    sd: Float[np.ndarray, "M C"]
    median_px: Float[np.ndarray, " M"]
    cost: float
    status: str


def calibrate(
    problem: EventProblem, start: CameraRig, progress: Progress = lambda _: None
) -> EventCalibration:
    """Solve for the rig from a start; a lens whose distortion is not certain is solved as straight.

    Args:
        start: its points, cameras and offsets; bone lengths are found from the points.
    """
    progress("calibrating the cameras from the event")
    visible_points = placed(problem.samples(start))
    lengths = typical_lengths(bone_lengths(start.points, visible_points, problem.bones))
    solved, status = _descend(problem, replace(start, lengths=lengths))
    sd = _column_sd(problem, solved)
    straight = np.abs(solved.distortion) < CERTAIN_SIGMAS * sd[:, DISTORTION]
    if (straight & ~problem.fixed_distortion).any():
        progress("calibrating the cameras from the event, with straight lenses")
        problem = replace(problem, fixed_distortion=problem.fixed_distortion | straight)
        again = replace(solved, distortion=np.where(straight, 0.0, solved.distortion))
        solved, status = _descend(problem, again)
        sd = _column_sd(problem, solved)
    return EventCalibration(
        solved, sd, _median_errors(problem, solved), problem.cost(solved), status
    )


def _descend(problem: EventProblem, rig: CameraRig) -> tuple[CameraRig, str]:
    """Levenberg and Marquardt's damped steps."""
    damping, cost = 1e-3, problem.cost(rig)
    for step in range(MOST_STEPS):
        moved = rig.moved(*reduced(problem, rig, damping).step(damping))
        now = problem.cost(moved)
        if now < cost:
            small = cost - now < TOLERANCE * cost
            rig, cost, damping = moved, now, max(damping / 4, 1e-7)
            if small:
                return rig, f"converged after {step + 1} steps"
        else:
            damping *= 6
            if damping > 1e4:
                return rig, f"no step lowers the objective after {step + 1} steps"
    return rig, f"stopped after {MOST_STEPS} steps, before it converged"


def _column_sd(problem: EventProblem, rig: CameraRig) -> Float[np.ndarray, "M C"]:
    count = len(rig.K) * CAMERA
    variance = reduced(problem, rig).covariance().diagonal()[:count]
    return np.sqrt(np.maximum(variance, 0.0)).reshape(-1, CAMERA)


def _median_errors(problem: EventProblem, rig: CameraRig) -> Float[np.ndarray, " M"]:
    samples = problem.samples(rig)
    visible_points = visible(samples) > 0
    error = np.linalg.norm(project(rig, samples).error_px, axis=-1)
    videos = range(len(rig.K))
    return np.array(
        [
            np.median(error[..., m][visible_points[..., m]])
            if visible_points[..., m].any()
            else np.nan
            for m in videos
        ]
    )
