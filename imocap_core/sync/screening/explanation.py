"""How well the other videos' common motion explains a video: as it is, in a mirror, or not at all.

A video's monocular poses may be wrong; its keypoints are what the joint solve has to explain. So
each video is left out in turn, the others' keypoints are triangulated (`common_motion`), and the
video's keypoints registered with that motion, at its own speed. Three measures tell all:

* the residual beside that of the reflected keypoints: a mirrored video has more as it is. Where the
  action is its own mirror image both are equal but for noise, and nothing can be decided. A walk is
  that half a cycle later, so for this the motion is repeated and may begin anywhere;
* the residual beside that of one static pose of the same motion: another action fits no better than
  a pose that stands still;
* how much of the keypoints' change over time the motion explains: nothing of another action's, and
  much of the action's, also where the poses are wrong in a lasting way, as a monocular depth is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from imocap_core.sync.screening.best_camera import registered, sides_corrected
from imocap_core.sync.screening.common_motion import motions_without
from imocap_core.sync.screening.mirror import mirrored_poses, signs_of
from imocap_core.sync.screening.registration import (
    Keypoints2D,
    reflected_keypoints,
    registration_residual,
    unbiased_directions,
)

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
        static: residual over that of one static pose; negative is usual, 0 for another action.
        change: share of the keypoints' change that is explained (`explained_change`).
        videos: as they were explained; motions: the others' common motion, for each.
    """

    residual: Float[np.ndarray, " M"]
    reflected: Float[np.ndarray, " M"]
    asymmetry: Float[np.ndarray, " M"]
    static: Float[np.ndarray, " M"]
    change: Float[np.ndarray, " M"]
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
        rows.append(
            (
                as_it_is.residual,
                _ratio(begun, begun_mirrored),
                np.sign(squares) * np.sqrt(abs(squares)),
                _ratio(as_it_is.residual, as_it_is.static_residual),
                as_it_is.explained_change,
            )
        )
    residual, reflected, asymmetry, static, change = np.array(rows).T
    return Explanations(residual, reflected, asymmetry, static, change, upright, common)


def with_sides_corrected(
    explained: Explanations, video: int, twins: Sequence[int]
) -> tuple[float, float, float]:
    """`residual`, `static` and `change` of a video whose left and right may be swapped at times.

    The static pose is held against the keypoints as they are.
    """
    motion, directions = explained.motions[video], unbiased_directions()
    keypoints = explained.videos[video].keypoints
    corrected, cost = sides_corrected(motion, keypoints, directions, twins)
    view = registered(motion, corrected, directions)
    residual = view.residual + cost
    gain = _ratio(residual, float(explained.residual[video]))
    return residual, float(explained.static[video]) + gain, view.explained_change


def _ratio(first: float, second: float) -> float:
    return float(np.log(max(first, LEAST_RESIDUAL) / max(second, LEAST_RESIDUAL)))
