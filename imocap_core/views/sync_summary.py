"""A synchronisation in one row a video, and the frame of a video that shows each moment."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imocap_core.artifacts.schemas import Keypoints, SyncMap, SyncSummary

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

GAP_S = 0.15
"""A moment of the reference farther than this from every matched frame is unmatched."""
END_FRAMES = 1.0
"""Nor is one that lies further than this before the first or after the last of them."""


@dataclass(frozen=True)
class SyncRow:
    """One video against the reference; NaN where nothing matched.

    matched: share of its frames. rate: seconds of the reference per second of the video, over the
    matched part. confidence: mean over the matched frames. offset_s: median time in the reference
    minus time in the video, both from the first frame of their files.
    """

    video: str
    matched: float
    rate: float
    confidence: float
    offset_s: float


def sync_rows(keypoints: Keypoints, sync: SyncSummary) -> list[SyncRow]:
    """One row for each video, the reference's among them."""
    seen = {v.id: v for v in keypoints.videos}
    reference = seen[sync.reference]
    rows = []
    for found in sync.maps:
        video = seen[found.id]
        at = np.flatnonzero(np.isfinite(found.reference_frame))
        if not len(at):
            rows.append(SyncRow(found.id, 0.0, np.nan, np.nan, np.nan))
            continue
        own_s = video.frames[at] / video.fps
        there_s = seconds_at(found.reference_frame[at], reference.frames, reference.fps)
        lasting = own_s[-1] - own_s[0]
        rows.append(
            SyncRow(
                video=found.id,
                matched=len(at) / len(found.reference_frame),
                rate=float((there_s[-1] - there_s[0]) / lasting) if lasting > 0 else np.nan,
                confidence=float(found.confidence[at].mean()),
                offset_s=float(np.median(there_s - own_s)),
            )
        )
    return rows


def seconds_at(index: Array, frames: Ints, fps: float) -> Array:
    """Seconds since the file's first frame, of fractional indices into its used frames."""
    at: Array = np.interp(index, np.arange(len(frames)), frames / fps)
    return np.where(np.isfinite(index), at, np.nan)


def retimed(found: SyncMap, moments: Sequence[float], fps: float) -> tuple[Ints, NDArray[np.bool_]]:
    """For each moment (index into the reference, increasing) the video's frame that shows it (index
    into its used frames, never going back), and whether one does; `fps` of the reference.

    A moment that nothing shows gets the frame of the nearest one before it that is shown, or the
    first.
    """
    wanted = np.asarray(moments, dtype=np.float64)
    known = np.flatnonzero(np.isfinite(found.reference_frame))
    if not len(known):
        return np.zeros(len(wanted), dtype=np.int64), np.zeros(len(wanted), dtype=bool)
    there = np.maximum.accumulate(found.reference_frame[known])
    index = np.rint(np.interp(wanted, there, known)).astype(np.int64)
    distance = np.abs(there[None, :] - wanted[:, None]).min(axis=1)
    inside = (wanted >= there[0] - END_FRAMES) & (wanted <= there[-1] + END_FRAMES)
    return np.maximum.accumulate(index), inside & (distance <= max(END_FRAMES, GAP_S * fps))


def title_of(sync: SyncSummary, video: str) -> str:
    """A video's id, and what became of it where that is unusual."""
    at = next(m for m in sync.maps if m.id == video).reference_frame
    if video == sync.reference:
        return f"{video} (reference)"
    if video in sync.excluded:
        return f"{video} (excluded)"
    if not np.isfinite(at).any():
        return f"{video} (unmatched)"
    return f"{video} (mirrored)" if video in sync.mirrored else video
