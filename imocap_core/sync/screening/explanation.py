"""How well the other videos' common motion explains a video: as it is, in a mirror, or not at all.

A video's monocular poses may be wrong; its keypoints are what the joint solve has to explain. So
each video is left out in turn, the others' keypoints are linearly triangulated (scaled
orthographic), and its keypoints registered with that motion, at its own speed. One video's
monocular motion gives the time and a weak prior of every joint; registration with it tells each
camera's direction, the corresponding frames, and each frame's scale and place. A second round
registers with the motion of the first. Four measures tell all:

* the residual of the video's keypoints;
* the residual beside that of the reflected keypoints: a mirrored video has more as it is. Where the
  action is its own mirror image both are equal but for noise. A walk is that half a cycle later, so
  for this the motion is repeated and may begin anywhere;
* how much of the keypoints' change over time the motion explains: nothing of another action's, and
  much of the action's, also where poses are wrong in a lasting way, as a monocular depth is;
* the residual of the others' keypoints under the video's monocular motion, beside that under each
  other's.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import reduce
from operator import add

import numpy as np
from jaxtyping import Bool, Complex, Float, Int

from imocap_core.alignment import refined_rotation
from imocap_core.sync.screening.registration import (
    Keypoints2D,
    best_warp,
    centred_plane,
    matched_residuals,
    pose_residuals,
    reflected_keypoints,
    registration_residual,
    unbiased_directions,
    warp_costs,
)

SWAPPED = 0.1  # residual that a frame costs whose left and right are taken as swapped
FITTING_SHARE = 0.8  # of the frames, in which change is compared
TURNS_DEG = (10.0, 5.0, 2.5)  # of the best direction's refinement


@dataclass(frozen=True)
class Registration:
    """The camera and the warp under which a motion explains a video's keypoints best.

    Attributes:
        residual: mean a frame, costs of the warp included, 0 (explained) to 1.
        explained_change: of the keypoints over time; about 0 where chance alone matches them.
        axes: image axes (right, down) in the motion's axes.
        frames: (T,) of the motion.
    """

    residual: float
    explained_change: float
    axes: Float[np.ndarray, "2 3"]
    frames: Int[np.ndarray, " T"]


def mirrored_poses(
    poses: Float[np.ndarray, "T J 3"], twins: Sequence[int]
) -> Float[np.ndarray, "T J 3"]:
    """The mirror image of poses: x -> -x, and joint j becomes its twin `twins[j]`."""
    reflected: np.ndarray = poses[:, list(twins)] * np.array([-1.0, 1.0, 1.0])
    return reflected


def registered(
    motion: Float[np.ndarray, "N J 3"],
    keypoints: Keypoints2D,
    directions: Float[np.ndarray, "D 2 3"],
) -> Registration:
    """The best of some directions, refined, and its warp."""
    plane, weight = centred_plane(keypoints), keypoints.weight
    residuals = pose_residuals(motion, keypoints, directions)
    best = int(warp_costs(residuals).argmin())
    frames = best_warp(residuals[best])[1]
    of_frames = matched_residuals(np.nan_to_num(motion)[frames], keypoints)
    start = np.concatenate([directions[best], np.cross(*directions[best])[None]])
    R, _ = refined_rotation(start, lambda near: of_frames(near[:, :2]).mean(axis=1), TURNS_DEG)
    axes = R[:2]
    refined = pose_residuals(motion, keypoints, axes[None])
    cost, frames = best_warp(refined[0])
    change = explained_change(np.nan_to_num(motion)[frames] @ axes.T, plane, weight)
    return Registration(cost / len(frames), change, axes, frames)


def explained_change(
    projected: Float[np.ndarray, "T J 2"],
    plane: Complex[np.ndarray, "T J"],
    weight: Float[np.ndarray, "T J"],
) -> float:
    """Coefficient of determination of the keypoints' change over time, at most 1.

    Keypoints and projected poses are scaled and placed alike in every frame and taken about each
    joint's mean over time, so what a motion has wrong throughout, such as its depth, costs nothing.
    Of both the frames that lie farthest out do not count: stretches that are detected badly, or
    that only this video shows.

    Args:
        plane: the keypoints about each frame's mean (`centred_plane`).
    """
    visible = weight.sum(axis=1) > 0
    x, w = plane[visible], weight[visible]
    total = w.sum(axis=1, keepdims=True)
    pose = projected[visible, :, 0] + 1j * projected[visible, :, 1]
    pose = pose - (w * pose).sum(1, keepdims=True) / total
    spread = np.maximum((w * np.abs(pose) ** 2).sum(1, keepdims=True), 1e-12)
    scale = np.maximum((w * (x.conj() * pose).real).sum(1, keepdims=True), 0.0) / spread
    size = np.sqrt(np.maximum((w * np.abs(x) ** 2).sum(1, keepdims=True) / total, 1e-12))
    if not len(x):
        return 0.0
    return 1.0 - _change((x - scale * pose) / size, w) / max(_change(x / size, w), 1e-12)


def _change(values: Complex[np.ndarray, "T J"], weight: Float[np.ndarray, "T J"]) -> float:
    """Mean square about each joint's mean over time, of the FITTING_SHARE of frames next to it."""
    mean = (weight * values).sum(axis=0) / np.maximum(weight.sum(axis=0), 1e-12)
    square = (weight * np.abs(values - mean) ** 2).sum(axis=1) / weight.sum(axis=1)
    return float(np.sort(square)[: max(1, round(FITTING_SHARE * len(square)))].mean())


def sides_corrected(
    motion: Float[np.ndarray, "N J 3"],
    keypoints: Keypoints2D,
    directions: Float[np.ndarray, "D 2 3"],
    twins: Sequence[int],
) -> tuple[Keypoints2D, float]:
    """The keypoints with left and right swapped where that fits a motion clearly better.

    Also what the swap costs, mean a frame: a detector that takes the back for the front.
    """
    columns = list(twins)
    other = Keypoints2D(keypoints.xy_px[:, columns], keypoints.weight[:, columns])
    as_given, other_sides = (pose_residuals(motion, k, directions) for k in (keypoints, other))
    least = np.minimum(as_given, other_sides + SWAPPED)
    best = int(warp_costs(least).argmin())
    frames = best_warp(least[best])[1]
    rows = np.arange(len(frames))
    swapped = (other_sides[best] + SWAPPED < as_given[best])[rows, frames]
    corrected = Keypoints2D(
        np.where(swapped[:, None, None], other.xy_px, keypoints.xy_px),
        np.where(swapped[:, None], other.weight, keypoints.weight),
    )
    return corrected, SWAPPED * float(swapped.mean())


PRIOR = 0.3  # weight of the monocular motion's joints; a visible keypoint weighs up to 1
ROUNDS = 2
IMAGE_AXES = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])  # right, down of a camera in its own axes


@dataclass(frozen=True)
class NormalMatrices:
    """Normal equations of every joint at every moment."""

    matrix: Float[np.ndarray, "N J 3 3"]
    right_side: Float[np.ndarray, "N J 3"]

    def __add__(self, other: NormalMatrices) -> NormalMatrices:
        return NormalMatrices(self.matrix + other.matrix, self.right_side + other.right_side)

    def solved(self) -> Float[np.ndarray, "N J 3"]:
        """The joints."""
        return np.asarray(np.linalg.solve(self.matrix, self.right_side[..., None])[..., 0])


def motions_without(
    motions: Sequence[Float[np.ndarray, "_ J 3"]],
    keypoints: Sequence[Keypoints2D],
    residuals: Float[np.ndarray, "M M"],
    directions: Float[np.ndarray, "D 2 3"],
) -> list[Float[np.ndarray, "_ J 3"]]:
    """For every video the common motion of all others.

    Args:
        motions, keypoints: of two videos or more, none of them a mirror image of another.
        residuals: of video j's keypoints with video i's motion (`registration_residual`).
    """
    every = list(range(len(motions)))
    first = _central(every, residuals)
    rest = [v for v in every if v != first]
    second = _central(rest, residuals)
    common: dict[int, np.ndarray] = {}
    for reference, members, left_out in ((first, every, rest), (second, rest, [first])):
        others = [v for v in members if v != reference]
        parts = _parts(reference, others, motions, keypoints, residuals, directions)
        for v in left_out:
            common[v] = _total([part for u, part in parts.items() if u != v]).solved()
    return [common[v] for v in every]


def _total(parts: Sequence[NormalMatrices]) -> NormalMatrices:
    return reduce(add, parts)


def _central(videos: Sequence[int], residuals: Float[np.ndarray, "M M"]) -> int:
    """The video whose motion explains the others' keypoints best."""
    totals = {v: sum(residuals[v, u] for u in videos if u != v) for v in videos}
    return min(totals, key=lambda v: totals[v])


def _parts(
    reference: int,
    others: Sequence[int],
    motions: Sequence[np.ndarray],
    keypoints: Sequence[Keypoints2D],
    residuals: Float[np.ndarray, "M M"],
    directions: np.ndarray,
) -> dict[int, NormalMatrices]:
    """What each video adds to the normal equations, the reference's prior included."""
    joints = np.nan_to_num(motions[reference])
    motion = joints - joints.mean(axis=1, keepdims=True)
    own_view = Registration(0.0, 1.0, IMAGE_AXES, np.arange(len(motion)))
    eye = np.broadcast_to(PRIOR * np.eye(3), (*motion.shape[:2], 3, 3))
    fixed = NormalMatrices(eye, PRIOR * motion)
    fixed += _normal_matrices(motion, keypoints[reference], own_view, 1.0)
    least = min((residuals[reference, u] for u in others), default=1.0)
    parts = {reference: fixed}
    for _ in range(ROUNDS):
        for u in others:
            view = registered(motion, keypoints[u], directions)
            weight = float((least / max(residuals[reference, u], 1e-9)) ** 2)
            parts[u] = _normal_matrices(motion, keypoints[u], view, weight)
        motion = _total(list(parts.values())).solved()
    return parts


def _normal_matrices(
    motion: Float[np.ndarray, "N J 3"], keypoints: Keypoints2D, view: Registration, share: float
) -> NormalMatrices:
    """Normal equations of one video's keypoints, scaled and placed like the projected motion."""
    weight, axes = keypoints.weight, view.axes
    projected = motion[view.frames] @ axes.T
    total = np.maximum(weight.sum(1), 1e-12)[:, None, None]
    w = weight[..., None]
    given = np.where(w > 0, keypoints.xy_px, 0.0)
    x = np.where(w > 0, given - (w * given).sum(1, keepdims=True) / total, 0.0)
    middle = (w * projected).sum(1, keepdims=True) / total
    p = projected - middle
    product, spread = (w * x * p).sum((1, 2)), (w * p * p).sum((1, 2))
    scale = np.maximum(product, 1e-9) / np.maximum(spread, 1e-9)
    placed = x / np.maximum(scale, 1e-6)[:, None, None] + middle
    repeats = np.bincount(view.frames, minlength=len(motion))[view.frames]
    weight = share * weight / np.maximum(repeats, 1)[:, None]
    matrix, right_side = np.zeros((*motion.shape, 3)), np.zeros(motion.shape)
    np.add.at(matrix, view.frames, weight[..., None, None] * (axes.T @ axes))
    np.add.at(right_side, view.frames, weight[..., None] * (placed @ axes))
    return NormalMatrices(matrix, right_side)


MOST_FRAMES = 60  # of each video that are compared
COARSE = 2  # every second of them, for pairs of videos
LEAST_RESIDUAL = 1e-6


@dataclass(frozen=True)
class ScreenedVideo:
    """A video's monocular motion in its camera's axes (y down) and its keypoints, as they are."""

    motion: Float[np.ndarray, "N J 3"]
    keypoints: Keypoints2D

    def mirrored(self, twins: Sequence[int]) -> ScreenedVideo:
        """The video seen in a mirror."""
        return ScreenedVideo(
            mirrored_poses(self.motion, twins), reflected_keypoints(self.keypoints, twins)
        )

    def thinned(self, stride: int) -> ScreenedVideo:
        """Every n-th frame."""
        keypoints = Keypoints2D(self.keypoints.xy_px[::stride], self.keypoints.weight[::stride])
        return ScreenedVideo(self.motion[::stride], keypoints)


@dataclass(frozen=True)
class Explanations:
    """Residuals under the others' common motion, and logarithms of their ratios, per video.

    Attributes:
        residual: as it is, 0 to 1.
        reflected: residual as it is over residual reflected; negative is usual.
        asymmetry: root of the difference of their squares, with the sign of `reflected`: how far
            the action is from its mirror image, in shares of the keypoints' spread.
        change: share of the keypoints' change that is explained (`explained_change`).
        dissimilarity: residual of the others' keypoints under its monocular motion over that under
            each other's; 0 is usual.
        videos: as they were explained; motions: the others' common motion, for each.
    """

    residual: Float[np.ndarray, " M"]
    reflected: Float[np.ndarray, " M"]
    asymmetry: Float[np.ndarray, " M"]
    change: Float[np.ndarray, " M"]
    dissimilarity: Float[np.ndarray, " M"]
    videos: Sequence[ScreenedVideo]
    motions: Sequence[Float[np.ndarray, "_ J 3"]]


@dataclass(frozen=True)
class PairResiduals:
    """Residuals of video j's keypoints with video i's monocular motion, 0 on the diagonal.

    Attributes:
        plain: as they are; reflected: seen in a mirror.
    """

    plain: Float[np.ndarray, "M M"]
    reflected: Float[np.ndarray, "M M"]

    def among(self, videos: Sequence[int]) -> PairResiduals:
        """Those of some videos."""
        pairs = np.ix_(videos, videos)
        return PairResiduals(self.plain[pairs], self.reflected[pairs])


def prepared(
    motions: Sequence[Float[np.ndarray, "_ J 3"]],
    keypoints: Sequence[Keypoints2D],
    twins: Sequence[int],
) -> tuple[list[ScreenedVideo], list[int]]:
    """The videos with at most MOST_FRAMES frames and the joints that have keypoints; their twins.

    Args:
        motions, keypoints: of the same frames and joints.
    """
    visible = np.any([(k.weight > 0).any(axis=0) for k in keypoints], axis=0)
    joints = [j for j in range(len(twins)) if visible[j] and visible[twins[j]]]
    stride = -(-max(map(len, motions)) // MOST_FRAMES)
    videos = [
        ScreenedVideo(x[:, joints], Keypoints2D(k.xy_px[:, joints], k.weight[:, joints]))
        for x, k in zip(motions, keypoints, strict=True)
    ]
    return [v.thinned(stride) for v in videos], [joints.index(twins[j]) for j in joints]


def pair_residuals(videos: Sequence[ScreenedVideo], twins: Sequence[int]) -> PairResiduals:
    """All pairs of videos, on every second frame."""
    directions, M = unbiased_directions(), len(videos)
    coarse = [v.thinned(COARSE) for v in videos]
    residuals = np.zeros((2, M, M))
    for j, video in enumerate(coarse):
        both = (video.keypoints, reflected_keypoints(video.keypoints, twins))
        for i, other in enumerate(coarse):
            if i != j:
                residuals[:, i, j] = [
                    registration_residual(other.motion, k, directions) for k in both
                ]
    return PairResiduals(*residuals)


SIGN_SWEEPS = 20


def signs_of(
    evidence: Float[np.ndarray, "M M"], pinned: Sequence[bool] | Bool[np.ndarray, " M"]
) -> Int[np.ndarray, " M"]:
    """Signs of +1 and -1 that maximise the sum over pairs of s_i s_j evidence_ij.

    Videos that are `pinned` keep +1. Without any, the larger side is +1; of equal sides the one
    with the first video.
    """
    fixed = np.asarray(pinned, dtype=bool)
    M = len(evidence)
    leading = np.linalg.eigh(evidence)[1][:, -1]
    starts = [np.ones(M, dtype=np.int64), np.where(leading >= 0, 1, -1)]
    best, best_value = starts[0], -np.inf
    for start in starts:
        signs = np.where(fixed, 1, start)
        for _ in range(SIGN_SWEEPS):
            before = signs.copy()
            for v in np.flatnonzero(~fixed):
                pull = evidence[v] @ signs - evidence[v, v] * signs[v]
                signs[v] = signs[v] if pull == 0 else np.sign(pull)
            if (signs == before).all():
                break
        value = float(signs @ evidence @ signs)
        if value > best_value + 1e-12:
            best, best_value = signs, value
    if not fixed.any():
        total = int(best.sum())
        best = -best if total < 0 or (total == 0 and best[0] < 0) else best
    return best


def likely_signs(
    pairs: PairResiduals, pinned: Sequence[bool] | Bool[np.ndarray, " M"]
) -> Int[np.ndarray, " M"]:
    """-1 for the videos that look mirrored to the others; `pinned` as of `signs_of`."""
    first, second = (np.maximum(x, LEAST_RESIDUAL) for x in (pairs.reflected, pairs.plain))
    evidence = np.log(first / second)
    return signs_of(0.5 * (evidence + evidence.T), pinned)


def explanations(
    videos: Sequence[ScreenedVideo],
    twins: Sequence[int],
    pairs: PairResiduals,
    signs: Int[np.ndarray, " M"],
) -> Explanations:
    """Each video, with its sign, against the common motion of all others, with theirs.

    signs: -1 for videos taken as mirrored.
    """
    upright = [
        video.mirrored(twins) if s < 0 else video for video, s in zip(videos, signs, strict=True)
    ]
    residuals = np.where(np.equal.outer(signs, signs), pairs.plain, pairs.reflected)
    directions = unbiased_directions()
    common = motions_without(
        [v.motion for v in upright], [v.keypoints for v in upright], residuals, directions
    )
    rows = []
    for motion, video in zip(common, upright, strict=True):
        as_it_is = registered(motion, video.keypoints, directions)
        again = np.concatenate([motion, motion])
        begun, begun_mirrored = (
            registered(again, k, directions).residual
            for k in (video.keypoints, reflected_keypoints(video.keypoints, twins))
        )
        squares = begun**2 - begun_mirrored**2
        signed = np.sign(squares) * np.sqrt(abs(squares))
        ratio = _ratio(begun, begun_mirrored)
        rows.append((as_it_is.residual, ratio, signed, as_it_is.explained_change))
    residual, reflected, asymmetry, change = np.array(rows).T
    return Explanations(
        residual, reflected, asymmetry, change, _dissimilarity(residuals), upright, common
    )


def _dissimilarity(residuals: Float[np.ndarray, "M M"]) -> Float[np.ndarray, " M"]:
    """`Explanations.dissimilarity`; residuals: of video j's keypoints under video i's motion."""
    M = len(residuals)
    if M < 3:
        return np.zeros(M)
    pairs = np.where(np.eye(M, dtype=bool), np.nan, np.maximum(residuals, LEAST_RESIDUAL))
    others = [np.delete(np.arange(M), v) for v in range(M)]
    among = [np.nanmedian(pairs[np.ix_(u, u)]) for u in others]
    return np.asarray(np.log(np.nanmedian(pairs, axis=1)) - np.log(among))


def with_sides_corrected(explained: Explanations, video: int, twins: Sequence[int]) -> Explanations:
    """With `residual` and `change` of a video whose left and right may be swapped at times."""
    motion, directions = explained.motions[video], unbiased_directions()
    keypoints = explained.videos[video].keypoints
    corrected, cost = sides_corrected(motion, keypoints, directions, twins)
    view = registered(motion, corrected, directions)
    residual, change = explained.residual.copy(), explained.change.copy()
    residual[video], change[video] = view.residual + cost, view.explained_change
    return replace(explained, residual=residual, change=change)


def _ratio(first: float, second: float) -> float:
    return float(np.log(max(first, LEAST_RESIDUAL) / max(second, LEAST_RESIDUAL)))
