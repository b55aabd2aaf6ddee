"""Time that collapses: frames of a moving video that are all matched to one moment of another."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from imocap_core.runs import runs
from imocap_core.verdict.person_size import person_size

STOPPED = 0.1  # of the video's usual rate
LEAST_S = 0.25
LEAST_FRAMES = 6
MOVED = 0.1  # of the person's size, root-relative: more than a detector's noise


@dataclass(frozen=True)
class Collapse:
    """Frames `first` to `last` (indices, both within) that are matched to `moment` of another."""

    first: int
    last: int
    moment: float


def collapses(
    position: Float[np.ndarray, " T"], xy_px: Float[np.ndarray, "T K 2"], fps: float
) -> list[Collapse]:
    """Spans in which the person moves and the matched moment does not.

    A person who stands still, or a freeze frame, is none; a video in slow motion is none either,
    because rates are compared with the video's usual one.

    Args:
        position: matched frame of the other video (fractional index), NaN unmatched.
        xy_px: keypoints in the same frames, NaN where not detected.
    """
    rate = np.diff(position)
    usual = rate[np.isfinite(rate) & (rate > 0)]
    if not len(usual):
        usual = np.ones(1)
    stopped = np.abs(np.nan_to_num(rate, nan=np.inf)) < STOPPED * np.median(usual)
    least = max(LEAST_FRAMES, round(LEAST_S * fps))
    spans = []
    for first, last in runs(stopped, least - 1):
        if pose_change(xy_px[first : last + 2], person_size(xy_px)) > MOVED:
            moment = float(np.median(position[first : last + 2]))
            spans.append(Collapse(first, last + 1, moment))
    return spans


def pose_change(xy_px: Float[np.ndarray, "T K 2"], size_px: float) -> float:
    """Largest mean distance of the keypoints, about their centre, from those of the first frame,
    in body sizes; 0 where nothing can be compared."""
    centred = xy_px - np.nanmedian(xy_px, axis=1, keepdims=True) if len(xy_px) else xy_px
    distance = np.linalg.norm(centred - centred[:1], axis=-1)
    enough = np.isfinite(distance).sum(1) >= 3
    if not enough.any():
        return 0.0
    return float(np.nanmean(distance[enough], axis=1).max() / size_px)
