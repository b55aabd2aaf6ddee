"""Evidence for mirrored videos and for videos of another action, from poses and weights."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from imocap_core.sync.screening.mirror import agreed, find_mirrored, mirror_evidence
from imocap_core.sync.screening.outliers import FITTING_SHARE, find_outliers
from imocap_core.sync.screening.persistent_difference import persistent_differences
from imocap_core.sync.screening.temporal_order import begun, motion_windows, order_gains
from imocap_core.sync.screening.warp_residual import (
    PairArrays,
    expected_by,
    expected_squares,
    soft_maps,
    squares_between,
    typical_squares,
    warp_residuals,
)

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
