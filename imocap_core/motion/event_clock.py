"""When the videos of one event began: one offset a video, from correspondences or from sound."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

AGREEMENT_S = 0.1  # a match farther from a video's line does not count for its offset


@dataclass(frozen=True)
class Clock:
    """Frame n of the reference shows what frame ``offset + rate * n`` of each video shows.

    Attributes:
        offset: (M,) frames of the video, NaN where it is unmatched; rate: (M,) frames a frame.
        agreement: (M,) share of the matches, by confidence, that are within 0.1 s of that line; 1
            where the offset is known by sound.
    """

    offset: Float[np.ndarray, " M"]
    rate: Float[np.ndarray, " M"]
    agreement: Float[np.ndarray, " M"]

    def moments(self, v: int, frames: int) -> Float[np.ndarray, " T"]:
        """(T,) fractional reference frames of a video's frames, also outside the reference."""
        return np.asarray((np.arange(frames) - self.offset[v]) / self.rate[v])

    def reference_frames(self, v: int, frames: int, last: int) -> Float[np.ndarray, " T"]:
        """(T,) fractional reference frames of a video's frames, NaN outside 0 to ``last``."""
        position = self.moments(v, frames)
        inside = (position >= -0.5) & (position <= last + 0.5)
        return np.where(inside, np.clip(position, 0, last), np.nan)


def clock_of(
    to_reference: Sequence[Float[np.ndarray, " _"]],
    confidence: Sequence[Float[np.ndarray, " _"]],
    fps: Sequence[float],
    reference: int,
    start_s: Float[np.ndarray, " M"] | None = None,
) -> Clock:
    """The clock of videos whose frame rates are known.

    Each video's offset is the one that most of its matches agree on: where the sum of their
    confidences under a quadratic (Epanechnikov) kernel of 0.1 s is largest.

    Args:
        to_reference: per video (T_v,) fractional reference frames, NaN unmatched.
        confidence: per video (T_v,) of the matches.
        start_s: (M,) when each video's first frame was filmed, by its sound, s; NaN where that does
            not tell.
    """
    rate = np.array([f / fps[reference] for f in fps])
    offset, agreement = np.full(len(fps), np.nan), np.zeros(len(fps))
    for v, (position, weight) in enumerate(zip(to_reference, confidence, strict=True)):
        matched = np.isfinite(position) & (weight > 0)
        away = np.arange(len(position))[matched] - rate[v] * position[matched]
        reach, w = max(1.0, AGREEMENT_S * fps[v]), weight[matched]
        if start_s is not None and np.isfinite(start_s[[v, reference]]).all():
            offset[v], agreement[v] = fps[v] * (start_s[reference] - start_s[v]), 1.0
        elif len(away):
            near = np.maximum(1 - ((away[:, None] - away) / reach) ** 2, 0.0)
            densest = int((near @ w).argmax())
            share = near[densest] * w
            offset[v] = float((share @ away) / share.sum())
            agreement[v] = float(w[np.abs(away - offset[v]) <= reach].sum() / w.sum())
    offset[reference], rate[reference], agreement[reference] = 0.0, 1.0, 1.0
    return Clock(offset, rate, agreement)
