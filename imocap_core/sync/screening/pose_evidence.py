"""Evidence for mirrored videos and for videos of another action, from poses and weights.

Warp residual: the root-mean-square pose distance between a video's frames and their counterparts in
another along the best warp, each frame forced to have one: the estimates' noise and what differs
between performances; above that for another action, however its frames are warped.

Temporal order: a free warp finds similar poses in almost any two videos. Similar windows of motion
(about 0.8 s, aligned by one rotation) are rarer by chance. Where the other video's time runs
backwards or begins elsewhere, a video of the same action fits clearly worse, and one of another
action as well as before.

Persistent pose difference, excluding slow rotation and noise: the warp residual aligns every pose
by its own rotation, which absorbs part of any difference, and counts the noise of both videos. Here
the rotation between two videos changes slowly, and a frame is compared with the mean of its
possible counterparts, in which noise is averaged out.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from imocap_core.sync.procrustes import centred, procrustes_distances, rotations_onto
from imocap_core.sync.screening.decisions import FITTING_SHARE, Decisions, find_outliers
from imocap_core.sync.screening.mirror import CLEAR_MARGIN, agreed, find_mirrored, mirror_evidence
from imocap_core.sync.warp.monotone import monotone_posterior
from imocap_core.sync.warp.soft_maps import step_prior

PairArrays = dict[tuple[int, int], np.ndarray]  # per pair of videos, (T_i, T_j) or (T_i,)
PairNumbers = dict[tuple[int, int], float]

# estimates err for about a quarter of a second: more frames carry little more information
RATE_PER_S = 15.0
OBSERVATIONS_PER_S = 15.0
LEAST_SQUARE_M2 = 1e-4  # of matching poses, 1 cm


def thinned(
    poses: Sequence[Float[np.ndarray, "_T J _"]],
    weights: Sequence[Float[np.ndarray, "_T J"]],
    fps: Sequence[float],
) -> tuple[list[Float[np.ndarray, "_T J _"]], list[Float[np.ndarray, "_T J"]], list[float]]:
    """Every n-th frame of each video, so that about RATE_PER_S are left; with their frame rates."""
    stride = [max(1, round(f / RATE_PER_S)) for f in fps]
    return (
        [x[::n] for x, n in zip(poses, stride, strict=True)],
        [w[::n] for w, n in zip(weights, stride, strict=True)],
        [f / n for f, n in zip(fps, stride, strict=True)],
    )


def squares_between(
    poses: Sequence[Float[np.ndarray, "_T J 3"]],
    weights: Sequence[Float[np.ndarray, "_T J"]],
    others: Sequence[Float[np.ndarray, "_T J 3"]],
    others_weights: Sequence[Float[np.ndarray, "_T J"]],
) -> PairArrays:
    """Squared pose distances (T_i, T_j) of all videos i < j to the `others` j."""
    return {
        (i, j): procrustes_distances(poses[i], others[j], weights[i], others_weights[j]) ** 2
        for i in range(len(poses))
        for j in range(i + 1, len(poses))
    }


def typical_squares(squares: PairArrays) -> PairNumbers:
    """Typical squared distance of the nearest pose of the other video, for each pair of videos."""
    typical = {}
    for pair, square in squares.items():
        valid = square[np.isfinite(square).any(axis=1)]
        nearest = float(np.median(np.nanmin(valid, axis=1))) if valid.size else 1.0
        typical[pair] = max(nearest, LEAST_SQUARE_M2)
    return typical


def expected_squares(
    squares: PairArrays,
    fps: Sequence[float],
    typical: PairNumbers,
    max_rate: float,
    scramble: Callable[[np.ndarray], np.ndarray] | None = None,
) -> PairArrays:
    """Expected squared distance (T_i,) of each frame of video i to its counterpart in video j, for
    all i != j: the mean over all monotone warps, frames without any valid distance left out.

    Args:
        squares: of i < j as from `squares_between`.
        typical: squared distance of matching poses.
        max_rate: largest rate, seconds of one video per second of another.
        scramble: change of the time of the second video, the columns of (T_i, T_j).
    """
    out = {}
    for (i, j), square in squares.items():
        for a, b, directed in ((i, j, square), (j, i, square.T)):
            scrambled = directed if scramble is None else scramble(directed)
            out[a, b] = _expected(scrambled, fps[a], fps[b], typical[i, j], max_rate)
    return out


def soft_maps(
    squares: PairArrays, fps: Sequence[float], typical: PairNumbers, max_rate: float
) -> PairArrays:
    """Soft maps (T_i, T_j) of all i != j, rows of sum 1.

    Arguments as of `expected_squares`; pairs without any valid distance are left out.
    """
    return {
        (a, b): _soft_map(_filled(directed), fps[a], fps[b], typical[i, j], max_rate)
        for (i, j), square in squares.items()
        if np.isfinite(square).any()
        for a, b, directed in ((i, j, square), (j, i, square.T))
    }


def expected_by(maps: PairArrays, squares: PairArrays) -> PairArrays:
    """`expected_squares` from `soft_maps` that are computed already."""
    return {
        (a, b): _expected_of(soft_map, squares[a, b] if a < b else squares[b, a].T)
        for (a, b), soft_map in maps.items()
    }


def warp_residuals(
    expected: PairArrays, count: int, *, share: float = 1.0
) -> Float[np.ndarray, "M M"]:
    """Warp residual of video i in video j, in the unit of the poses, over the `share` of the frames
    that fit best. NaN where two videos share no joints, and on the diagonal."""
    residuals = np.full((count, count), np.nan)
    for (i, j), square in expected.items():
        if len(square):
            best = np.sort(square)[: max(1, int(np.ceil(share * len(square))))]
            residuals[i, j] = np.sqrt(best.mean())
    return residuals


def _expected(
    square: np.ndarray, fps: float, fps_to: float, typical: float, max_rate: float
) -> np.ndarray:
    if not np.isfinite(square).any():
        return np.zeros(0)
    return _expected_of(_soft_map(_filled(square), fps, fps_to, typical, max_rate), square)


def _expected_of(soft_map: np.ndarray, square: np.ndarray) -> np.ndarray:
    valid = np.isfinite(square).any(axis=1)
    return np.asarray((soft_map * _filled(square)).sum(axis=1)[valid])


def _filled(square: np.ndarray) -> np.ndarray:
    """Squared distances with the mean for the missing ones."""
    valid = np.isfinite(square)
    return np.where(valid, square, square[valid].mean())


def _soft_map(
    filled: np.ndarray, fps: float, fps_to: float, typical: float, max_rate: float
) -> np.ndarray:
    cost = OBSERVATIONS_PER_S / fps / typical * filled
    return monotone_posterior(cost, unmatched=np.inf, steps=step_prior(fps_to / fps, max_rate))[0]


OFFSETS_S = (-0.4, -0.2, 0.0, 0.2, 0.4)


def motion_windows(
    poses: Sequence[Float[np.ndarray, "_T J 3"]],
    weights: Sequence[Float[np.ndarray, "_T J"]],
    fps: Sequence[float],
) -> tuple[list[Float[np.ndarray, "_T 5*J 3"]], list[Float[np.ndarray, "_T 5*J"]]]:
    """Each frame with its neighbours as one pose of 5 J points, every pose about its centroid, and
    their weights; before the first frame and after the last one these are repeated."""
    windows, window_weights = [], []
    for x, w, f in zip(poses, weights, fps, strict=True):
        about = centred(x, w)
        rows = [np.clip(np.arange(len(x)) + round(s * f), 0, len(x) - 1) for s in OFFSETS_S]
        windows.append(np.concatenate([about[k] for k in rows], axis=1))
        window_weights.append(np.concatenate([w[k] for k in rows], axis=1))
    return windows, window_weights


def begun(share: float) -> Callable[[np.ndarray], np.ndarray]:
    """Squares (N, S) with the second video begun at another moment, its beginning last."""
    return lambda square: np.roll(square, round(share * square.shape[1]), axis=1)


def order_gains(
    squares: PairArrays, fps: Sequence[float], typical: PairNumbers, max_rate: float
) -> Float[np.ndarray, "M M"]:
    """How much better two videos fit in their order of time than out of it, symmetric.

    The logarithm of the mean warp residual with one of them run backwards or begun at another
    moment, over the warp residual; the better of the two directions. About 0 for a video of
    another action. Arguments as of `expected_squares`, squares of motion windows.
    """
    residuals, *scrambled = (
        warp_residuals(expected_squares(squares, fps, typical, max_rate, change), len(fps))
        for change in (None, _backwards, begun(1 / 3), begun(1 / 2), begun(2 / 3))
    )
    gains = np.log(np.mean(scrambled, axis=0) / np.maximum(residuals, 1e-12))
    return np.asarray(np.fmax(gains, gains.T))


def _backwards(square: np.ndarray) -> np.ndarray:
    return square[:, ::-1]


ROTATION_S = 1.0  # time over which an estimate's orientation error changes


def persistent_differences(
    poses: Sequence[Float[np.ndarray, "_T J 3"]],
    weights: Sequence[Float[np.ndarray, "_T J"]],
    maps: PairArrays,
    fps: Sequence[float],
    share: float,
) -> Float[np.ndarray, "M M"]:
    """Persistent difference of video i to video j in the unit of the poses, over the `share` of the
    frames that fit best; NaN where two videos share no joints, and on the diagonal.

    `maps` (T_i, T_j) of all i != j as of `soft_maps`.
    """
    squares = {
        (i, j): persistent_squares(
            poses[i], weights[i], poses[j], weights[j], soft_map, ROTATION_S * fps[i]
        )
        for (i, j), soft_map in maps.items()
    }
    valid = {pair: square[np.isfinite(square)] for pair, square in squares.items()}
    return warp_residuals(valid, len(poses), share=share)


def persistent_squares(
    poses: Float[np.ndarray, "N J 3"],
    weights: Float[np.ndarray, "N J"],
    others: Float[np.ndarray, "S J 3"],
    others_weights: Float[np.ndarray, "S J"],
    soft_map: Float[np.ndarray, "N S"],
    window: float,
) -> Float[np.ndarray, " N"]:
    """Mean squared joint distance of each frame to its mean counterpart, slowly rotated.

    `soft_map` with rows of sum 1, `window` in frames as in `rotations_onto`. NaN where no joint is
    shared.
    """
    S = len(others)
    visible = soft_map @ others_weights
    weighted = others_weights[..., None] * centred(others, others_weights)
    mean = (soft_map @ weighted.reshape(S, -1)).reshape(poses.shape)
    mean = mean / np.maximum(visible, 1e-12)[..., None]
    both = weights * visible
    x, y = centred(poses, both), centred(mean, both)
    R_other_from_video = rotations_onto(x, y, both, window)
    residual = x - np.einsum("nab,nja->njb", R_other_from_video, y)
    total = both.sum(axis=1)
    square = (both * (residual**2).sum(axis=-1)).sum(axis=1) / np.where(total > 0, total, 1.0)
    return np.where(total > 0, square, np.nan)


BEGINS = (0.0, 1 / 6, 1 / 3, 1 / 2, 2 / 3, 5 / 6)  # of a video: where it may begin in the other
FITTING_BEST = 0.6  # of the frames: cycles that only one video shows are left out


@dataclass(frozen=True)
class WeightedPoses:
    """Poses and weights of all videos."""

    poses: list[Float[np.ndarray, "_T J 3"]]
    weights: list[Float[np.ndarray, "_T J"]]

    def swapped(
        self, videos: Sequence[int], other: WeightedPoses
    ) -> tuple[WeightedPoses, WeightedPoses]:
        """Both, with some videos swapped."""
        first, second = ([list(s.poses), list(s.weights)] for s in (self, other))
        for v in videos:
            for a, b in zip(first, second, strict=True):
                a[v], b[v] = b[v], a[v]
        return WeightedPoses(*first), WeightedPoses(*second)

    def in_motion(self, fps: Sequence[float]) -> WeightedPoses:
        """The same as windows of motion."""
        return WeightedPoses(*motion_windows(self.poses, self.weights, fps))

    def squares_to(self, other: WeightedPoses) -> PairArrays:
        """`squares_between` these poses and others."""
        return squares_between(self.poses, self.weights, other.poses, other.weights)


def mirrored_among(
    plain: WeightedPoses,
    reflected: WeightedPoses,
    fps: Sequence[float],
    max_rate: float,
    pinned: Sequence[bool],
) -> tuple[list[int], Float[np.ndarray, " M"]]:
    """The mirrored videos and all margins; the costly kinds of evidence only on suspicion.

    `pinned`: videos whose reflection is given.
    """
    first = _mirror_evidence(plain, reflected, fps, max_rate, begins=(0.0,))[0]
    mirrored, margins = find_mirrored(first, pinned)
    if not mirrored:
        return mirrored, margins
    return find_mirrored(agreed(mirror_kinds(plain, reflected, fps, max_rate)), pinned)


def mirror_kinds(
    plain: WeightedPoses, reflected: WeightedPoses, fps: Sequence[float], max_rate: float
) -> list[Float[np.ndarray, "M M"]]:
    """All six kinds of `mirror_evidence`, of poses and of motion."""
    return [
        kind
        for a, b in ((plain, reflected), (plain.in_motion(fps), reflected.in_motion(fps)))
        for kind in _mirror_evidence(a, b, fps, max_rate, begins=BEGINS)
    ]


def _mirror_evidence(
    plain: WeightedPoses,
    reflected: WeightedPoses,
    fps: Sequence[float],
    max_rate: float,
    begins: Sequence[float],
) -> list[np.ndarray]:
    """`mirror_evidence` (M, M) in the order of time, with each video begun where it fits best, and
    the same of the frames that fit best."""
    squares, reflected_squares = plain.squares_to(plain), plain.squares_to(reflected)
    typical = typical_squares(squares)
    upright, mirrored = (
        [expected_squares(s, fps, typical, max_rate, begun(share)) for share in begins]
        for s in (squares, reflected_squares)
    )
    return [
        mirror_evidence(_least(upright[:1]), _least(mirrored[:1])),
        mirror_evidence(_least(upright), _least(mirrored)),
        mirror_evidence(_least(upright, FITTING_BEST), _least(mirrored, FITTING_BEST)),
    ]


def _least(expected: Sequence[PairArrays], share: float = 1.0) -> np.ndarray:
    """The smallest warp residual (M, M), mean of both directions."""
    count = 1 + max(max(pair) for pair in expected[0])
    residuals = [warp_residuals(e, count, share=share) for e in expected]
    return np.asarray(np.min([0.5 * (r + r.T) for r in residuals], axis=0))


def outliers_among(
    videos: WeightedPoses, fps: Sequence[float], max_rate: float, never: Bool[np.ndarray, " M"]
) -> tuple[list[int], Float[np.ndarray, " M"]]:
    """The videos of another action and all scores; `never`: videos that are none."""
    squares = videos.squares_to(videos)
    maps = soft_maps(squares, fps, typical_squares(squares), max_rate)
    residuals = warp_residuals(expected_by(maps, squares), len(fps), share=FITTING_SHARE)
    moving = videos.in_motion(fps)
    motion = moving.squares_to(moving)
    gains = order_gains(motion, fps, typical_squares(motion), max_rate)
    persistent = persistent_differences(videos.poses, videos.weights, maps, fps, FITTING_SHARE)
    return find_outliers(residuals, gains, persistent, never)


def decide_by_poses(
    plain: WeightedPoses,
    reflected: WeightedPoses,
    rates: Sequence[float],
    max_rate: float,
    pinned: Sequence[bool],
    never_outliers: Bool[np.ndarray, " M"],
    *,
    look_mirrored: bool,
    look_outliers: bool,
) -> Decisions:
    """Mirrored videos, then, with those reflected, videos of another action.

    Args:
        rates: frame rates of the poses; max_rate: as `sync.max_rate`.
        pinned: videos whose reflection is given; never_outliers: videos that stay in any case.
    """
    margin, score = np.full((2, len(rates)), np.nan)
    mirrored: list[int] = []
    outliers: list[int] = []
    if look_mirrored:
        mirrored, margin = mirrored_among(plain, reflected, rates, max_rate, pinned)
    if look_outliers:
        upright, _ = plain.swapped(mirrored, reflected)
        outliers, score = outliers_among(upright, rates, max_rate, never_outliers)
        # another action has no mirror image here
        mirrored = [v for v in mirrored if v not in outliers]
    return Decisions(
        mirrored=tuple(mirrored),
        outliers=tuple(outliers),
        margin=margin,
        score=score,
        clearly_mirrored=tuple(v for v in mirrored if margin[v] > CLEAR_MARGIN),
    )
