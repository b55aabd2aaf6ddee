"""Normal equations of a rig, the points eliminated (Schur complement).

Bones tie the points of one moment to each other, so that a moment's points are eliminated together;
moments are independent given cameras, biases and lengths.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from imocap_core.motion.event.bones import bone_lengths
from imocap_core.motion.event.keypoints import KeypointSamples
from imocap_core.motion.event.problem import ROBUST_SIGMAS, EventProblem
from imocap_core.motion.event.reprojection import derivatives, placed, project, visible
from imocap_core.motion.event.rig import CAMERA, CameraRig
from imocap_core.robust import cauchy

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
    matrix[biases, biases] += problem.spreads.bias_share**-2
    gradient[biases] += rig.bias.ravel() / problem.spreads.bias_share**2
    lengths, precision = np.arange(last, unknowns), problem.spreads.bone_length_spread_m**-2
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
    precision = problem.spreads.bone_noise_m**-2
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
