"""A synchronisation in one row a video, and the frame of a video that shows each moment."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from imocap_core.artifacts.schemas import Keypoints, SyncSummary

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

GAP_S = 0.15
"""A moment farther than this from every frame of a video is unmatched in it."""
END_FRAMES = 1.0
"""So is one that lies further than this before the first or after the last of them."""


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


def common_moments(keypoints: Keypoints, sync: SyncSummary) -> Array:
    """The moments (M,) at which a film of all videos shows them, in frames of the reference: its
    own, and those before and after at which other videos have a place on the common axis."""
    reference = next(v for v in keypoints.videos if v.id == sync.reference)
    every = [positions_on_axis(sync, i, reference.fps) for i in sync.ids]
    known = np.concatenate([place[np.isfinite(place)] for place in every])
    last = len(reference.frames) - 1
    ends = np.rint([known.min(initial=0.0), known.max(initial=last)])
    return np.arange(ends[0], ends[1] + 1)


def positions_on_axis(sync: SyncSummary, video: str, fps: float) -> Array:
    """Where a video's used frames (T,) lie on the time axis of all, in frames of the reference,
    whose rate is `fps`; NaN where nowhere."""
    if sync.trust is not None:
        return next(v.phase_s for v in sync.trust.videos if v.id == video) * fps
    return next(m.reference_frame for m in sync.maps if m.id == video)


def retimed(place: Array, moments: ArrayLike, fps: float) -> tuple[Ints, NDArray[np.bool_]]:
    """For each moment the frame of a video that shows it (M,), and whether one does (M,).

    Args:
        place: (T,) the video's frames on the common axis, in frames of the reference, never
            decreasing; NaN where they have no position.
        moments: (M,) increasing, in frames of the reference, whose rate is `fps`.

    A moment that no frame shows gets the frame of the nearest earlier moment that is shown, or the
    first.
    """
    wanted = np.asarray(moments, dtype=np.float64)
    known = np.flatnonzero(np.isfinite(place))
    if not len(known):
        return np.zeros(len(wanted), dtype=np.int64), np.zeros(len(wanted), dtype=bool)
    there = np.maximum.accumulate(place[known])
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
