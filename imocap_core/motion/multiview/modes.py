"""Modes: how the performances of one action differ (Eq. 4 as a distribution).

A performance is ``X_v = M + sum_k s_vk B_k + r_v``: the mean motion, K modes of variation with a
score a performance, and a rest of its own. It is Eq. 4 with the mean removed, and noise in it.

Modes are principal components of places, which keypoints determine; turns follow by regression on
the scores, as a limb's twist would otherwise pass for a way to differ. A mode counts if half of the
places and moments of a performance that it was not learned from predict the rest. The rest, and all
where nothing is learned, is the spread of each keypoint in its view.

The joint solve learns them from the videos' motions of an earlier one, and solves for the scores
with the cameras: what many performances have in common in how they differ would otherwise pass for
a camera that stands elsewhere.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from imocap_core.alignment import procrustes
from imocap_core.motion.multiview.scene import Cameras, Scene, to_world
from imocap_core.motion.state import MotionState
from imocap_core.robust import finite_median, geman_mcclure_weight

_ROUND_OFF = 1e-9  # singular values below this share of the largest are round-off


@dataclass(frozen=True, eq=False)
class Modes:
    """K modes of variation, the strongest first.

    Performance m is about the mean motion turned by ``sum_k scores[m, k] * turns[k]``.

    Attributes:
        share: of the performances' summed squared displacements.
        scores: in standard deviations; they sum to 0 over the performances.
        turns: rotation vectors from the mean, in the joint's own axes, radians, at a score of 1.
        shifts: of P points from their mean places, metres, at a score of 1.
    """

    share: Float[np.ndarray, " K"]
    scores: Float[np.ndarray, "M K"]
    turns: Float[np.ndarray, "K N J 3"]
    shifts: Float[np.ndarray, "K N P 3"]

    def of_joints(self) -> Float[np.ndarray, "K J"]:
        """Size of each mode in each joint at one standard deviation, degrees, root mean square
        over the moments."""
        return np.asarray(np.rad2deg(np.sqrt((self.turns**2).sum(-1).mean(1))))

    def first(self, count: int) -> Modes:
        """The strongest of them."""
        return Modes(
            self.share[:count], self.scores[:, :count], self.turns[:count], self.shifts[:count]
        )


def modes(turns: Float[np.ndarray, "M N J 3"], shifts: Float[np.ndarray, "M N P 3"]) -> Modes:
    """Principal components over the performances of their displacements; at most M - 1.

    Args:
        turns, shifts: deviations from the mean (`technique.MeanMotion`): radians, metres. Moments
            that a performance does not show are 0, like the mean.
    """
    scores, squares = _principal_scores(shifts)
    share = squares / max(float(squares.sum()), 1e-300)
    return Modes(share, scores, _at_one(scores, turns), _at_one(scores, shifts))


def _principal_scores(
    shifts: Float[np.ndarray, "M N P 3"],
) -> tuple[Float[np.ndarray, "M K"], Float[np.ndarray, " K"]]:
    """Scores of variance 1, the largest of each positive, and squared singular values."""
    M = len(shifts)
    U, sigma, _ = np.linalg.svd(_centred(shifts), full_matrices=False)
    chosen = np.flatnonzero(sigma > _ROUND_OFF * max(float(sigma.max(initial=0.0)), 1e-12))[: M - 1]
    scores = U[:, chosen] * np.sqrt(max(M - 1, 1))
    largest = np.abs(scores).argmax(0)
    return scores * np.sign(scores[largest, np.arange(len(chosen))]), sigma[chosen] ** 2


def _at_one(
    scores: Float[np.ndarray, "M K"], deviations: Float[np.ndarray, "M N P 3"]
) -> Float[np.ndarray, "K N P 3"]:
    """Deviations at a score of 1, by regression on scores of variance 1."""
    at_one = scores.T @ _centred(deviations) / max(len(scores) - 1, 1)
    return at_one.reshape(-1, *deviations.shape[1:])


def _centred(deviations: Float[np.ndarray, "M N P 3"]) -> Float[np.ndarray, "M D"]:
    rows = deviations.reshape(len(deviations), -1)
    return np.asarray(rows - rows.mean(0))


_MOST_MODES = 6
LEAST_PERFORMANCES = 4  # of fewer nothing is left to learn modes from
_LEAST_GAIN = 0.05  # of the error of a held-out performance: what a further mode has to predict
_BLOCK_S = 0.25  # of a point's course: neighbouring moments do not count as held out
_DIVISIONS = 4


def held_out_errors(
    shifts: Float[np.ndarray, "M N P 3"], fps: float, rng: np.random.Generator
) -> Float[np.ndarray, " K1"]:
    """Squared error of held-out halves of held-out performances by 0, 1, 2, ... modes of the
    others, as shares of the error by none; 0 modes alone of fewer than `LEAST_PERFORMANCES`.

    shifts: deviations from the mean, metres; fps: moments a second.
    """
    M, N, J, _ = shifts.shape
    if M < LEAST_PERFORMANCES:
        return np.ones(1)
    rows = shifts.reshape(M, -1)
    blocks = np.arange(N) // max(1, round(_BLOCK_S * fps))
    count = min(_MOST_MODES, M - 3)
    errors = np.zeros(count + 1)
    for m in range(M):
        others = np.delete(rows, m, axis=0)
        mean = others.mean(0)
        _, sigma, Vh = np.linalg.svd(others - mean, full_matrices=False)
        for _division in range(_DIVISIONS):
            given = rng.random((blocks[-1] + 1, J))[blocks] < 0.5
            mask = np.repeat(given.ravel(), 3)
            errors += _errors_by_modes(rows[m] - mean, mask, sigma[: M - 2], Vh, count)
    return np.asarray(errors / max(errors[0], 1e-300))


def _errors_by_modes(
    deviation: Float[np.ndarray, " D"],
    given: Bool[np.ndarray, " D"],
    sigma: Float[np.ndarray, " K"],
    Vh: Float[np.ndarray, "R D"],
    count: int,
) -> Float[np.ndarray, " K1"]:
    """Squared error of the rest of a deviation, by 0 to ``count`` modes of which the given part
    tells the scores: least squares, with the scores' variances and that of the rest as prior."""
    variance, rest = sigma**2 / max(len(sigma) - 1, 1), ~given
    errors = [float((deviation[rest] ** 2).sum())]
    for k in range(1, count + 1):
        B, noise = Vh[:k].T, max(float(variance[k:].sum()) / Vh.shape[1], 1e-12)
        prior = np.diag(noise / np.maximum(variance[:k], 1e-12))
        scores = np.linalg.solve(B[given].T @ B[given] + prior, B[given].T @ deviation[given])
        errors.append(float(((deviation[rest] - B[rest] @ scores) ** 2).sum()))
    return np.array(errors)


def number_of_modes(errors: Float[np.ndarray, " K1"]) -> int:
    """As many modes as each lower the held-out error by `_LEAST_GAIN` of that by none."""
    gains = errors[:-1] - errors[1:]
    worse: Int[np.ndarray, " _"] = np.flatnonzero(gains < _LEAST_GAIN)
    return int(worse[0]) if len(worse) else len(gains)


# Of fewer performances the joint solve learns no modes: a mode takes as many numbers as a motion.
LEAST_SOLVED = 5
ALIGNMENTS, ALIKE_M = 4, 0.03  # in the last ones a keypoint so far off counts a quarter


def mode_shifts(
    scene: Scene, state: MotionState, cameras: Cameras, mean: MotionState
) -> Float[np.ndarray, "k N P 3"] | None:
    """Shifts of the keypoints at a score of 1 in each mode, metres, world's axes; None where no
    mode counts. From the motions of an earlier joint solve, after the rotation and shift of each
    frame that most keypoints agree with: performances also differ in where they stand and face
    (`terms.view`).

    Args:
        state: every video's motion in its own camera's axes; mean: their consensus.
    """
    if len(cameras.R) < LEAST_SOLVED:
        return None
    world = to_world(scene.aligned(state), cameras)
    path = (x.expand(len(world.root), *x.shape[1:]) for x in (mean.trans, mean.betas, mean.valid))
    each = MotionState.of(world.R_local, *path)
    points, body = scene.body.keypoints, scene.body
    xyz, of_mean = (body.positions(points, motion).cpu().numpy() for motion in (each, mean))
    used = (scene.keypoints.weight > 0).any((0, 1)).astype(np.float64)
    weight = np.broadcast_to(used, xyz.shape[:-1])
    for _ in range(ALIGNMENTS):
        shifts = procrustes(xyz, of_mean, weight).apply(xyz) - of_mean
        weight = geman_mcclure_weight(np.linalg.norm(shifts, axis=-1), ALIKE_M, prior=used)
    shifts *= (world.weight > 0).cpu().numpy()[..., None, None]
    errors = held_out_errors(shifts[:, :, used > 0], scene.fps, np.random.default_rng(0))
    count = number_of_modes(errors)
    return _at_one(_principal_scores(shifts)[0][:, :count], shifts) if count else None


UNSEEN_SPREAD_M = 0.1  # of a video whose keypoints are missing throughout


def spread_beyond_noise_m(
    errors_px: Float[np.ndarray, "M N K 2"],
    sigma_px: Float[np.ndarray, "M N"],
    depth_m: Float[np.ndarray, "M N"],
    focal_px: Float[np.ndarray, " M"],
    *,
    window: int,
) -> Float[np.ndarray, "M N K"]:
    """Standard deviation per coordinate, metres, of what detector noise does not explain.

    Args:
        errors_px: NaN where missing; sigma_px: detector noise.
        window: frames over which squared errors are pooled (median, so outliers do not count).
    """
    squared = (errors_px**2).sum(-1) / 2
    half = max(1, window // 2)
    padded = np.pad(squared, ((0, 0), (half, half), (0, 0)), mode="reflect")
    windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * half + 1, axis=1)
    usable = np.isfinite(windows).sum(-1) >= 3
    # the median of an exponential distribution is ln 2 times its mean
    pooled = finite_median(np.where(usable[..., None], windows, 0.0)) / np.log(2)
    inflated = pooled * len(errors_px) / max(len(errors_px) - 1, 1)
    excess = np.maximum(inflated - sigma_px[..., None] ** 2, 0.0)
    spread = np.sqrt(excess) * (depth_m / focal_px[:, None])[..., None]
    typical = [
        np.median(s[k]) if k.any() else UNSEEN_SPREAD_M for s, k in zip(spread, usable, strict=True)
    ]
    return np.where(usable, spread, np.array(typical)[:, None, None])


def lasting_m(
    errors_px: Float[np.ndarray, "M N K 2"],
    depth_m: Float[np.ndarray, "M N"],
    focal_px: Float[np.ndarray, " M"],
) -> Float[np.ndarray, "M 1 K"]:
    """How far each keypoint of a view is off for as long as the action lasts, beyond what half of
    the view's are, per coordinate, metres; 0 where missing (NaN)."""
    errors = errors_px * (depth_m / focal_px[:, None])[..., None, None]
    detected = np.isfinite(errors)
    mean = np.where(detected, errors, 0.0).sum(1) / np.maximum(detected.sum(1), 1)
    square = np.where(detected.any((1, 3)), (mean**2).sum(-1) / 2, np.nan)
    beyond = np.nan_to_num(square - finite_median(square)[:, None])
    return np.asarray(np.sqrt(beyond.clip(min=0.0))[:, None])
