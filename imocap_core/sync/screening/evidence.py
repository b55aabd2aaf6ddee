"""Which videos look mirrored, and which like another action: from poses and weights."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imocap_core.sync.screening.mirror import agreed, find_mirrored, mirror_evidence
from imocap_core.sync.screening.outliers import FITTING_SHARE, find_outliers
from imocap_core.sync.screening.persistent_difference import steady_levels
from imocap_core.sync.screening.temporal_order import alignment_gains, begun, motion_windows
from imocap_core.sync.screening.warp_residual import (
    PairSquares,
    expected_by,
    expected_squares,
    matched_levels,
    soft_maps,
    squares_between,
    typical_squares,
)

Array = NDArray[np.float64]

BEGINS = (0.0, 1 / 6, 1 / 3, 1 / 2, 2 / 3, 5 / 6)  # of a video: where it may begin in the other
FITTING_BEST = 0.6  # of the frames, where cycles that only one video shows are left out


@dataclass(frozen=True)
class Seen:
    """Poses (T_v, J, 3) and weights (T_v, J) of all videos."""

    poses: list[Array]
    weights: list[Array]

    def swapped(self, videos: Sequence[int], other: Seen) -> tuple[Seen, Seen]:
        """Both, with some videos exchanged."""
        mine, theirs = ([list(s.poses), list(s.weights)] for s in (self, other))
        for v in videos:
            for a, b in zip(mine, theirs, strict=True):
                a[v], b[v] = b[v], a[v]
        return Seen(*mine), Seen(*theirs)

    def in_motion(self, fps: Sequence[float]) -> Seen:
        """The same as windows of motion."""
        return Seen(*motion_windows(self.poses, self.weights, fps))


def mirrored_among(
    straight: Seen,
    turned: Seen,
    fps: Sequence[float],
    max_rate: float,
    pinned: Sequence[bool],
) -> tuple[list[int], Array]:
    """The mirrored videos and all margins; what costs more is looked at only on suspicion."""
    first = _evidence(straight, turned, fps, max_rate, begins=(0.0,))[0]
    found, margins = find_mirrored(first, pinned)
    if not found:
        return found, margins
    kinds = [
        kind
        for a, b in ((straight, turned), (straight.in_motion(fps), turned.in_motion(fps)))
        for kind in _evidence(a, b, fps, max_rate, begins=BEGINS)
    ]
    return find_mirrored(agreed(kinds), pinned)


def _evidence(
    straight: Seen, turned: Seen, fps: Sequence[float], max_rate: float, begins: Sequence[float]
) -> list[Array]:
    """`mirror_evidence` in the order of time, with each video begun where it fits best, and the
    same of the frames that fit best."""
    plain = squares_between(straight.poses, straight.weights, straight.poses, straight.weights)
    other = squares_between(straight.poses, straight.weights, turned.poses, turned.weights)
    near = typical_squares(plain)
    upright, reflected = (
        [expected_squares(s, fps, near, max_rate, begun(share)) for share in begins]
        for s in (plain, other)
    )
    return [
        mirror_evidence(_least(upright[:1]), _least(reflected[:1])),
        mirror_evidence(_least(upright), _least(reflected)),
        mirror_evidence(_least(upright, FITTING_BEST), _least(reflected, FITTING_BEST)),
    ]


def _least(expected: Sequence[PairSquares], share: float = 1.0) -> Array:
    """The smallest matched level (M, M), mean of both directions."""
    count = 1 + max(max(pair) for pair in expected[0])
    levels = [matched_levels(e, count, share=share) for e in expected]
    return np.asarray(np.min([0.5 * (level + level.T) for level in levels], axis=0))


def outliers_among(
    seen: Seen, fps: Sequence[float], max_rate: float, kept: NDArray[np.bool_]
) -> tuple[list[int], Array]:
    """The videos of another action and all scores; `kept` (M,) are none."""
    squares = squares_between(seen.poses, seen.weights, seen.poses, seen.weights)
    near = typical_squares(squares)
    maps = soft_maps(squares, fps, near, max_rate)
    levels = matched_levels(expected_by(maps, squares), len(fps), share=FITTING_SHARE)
    moving = seen.in_motion(fps)
    motion = squares_between(moving.poses, moving.weights, moving.poses, moving.weights)
    gains = alignment_gains(motion, fps, typical_squares(motion), max_rate)
    steady = steady_levels(seen.poses, seen.weights, maps, fps, FITTING_SHARE)
    return find_outliers(levels, gains, steady, kept)
