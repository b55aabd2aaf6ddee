"""A synchronisation as one row per video, and the frame of a video that shows each moment."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int, Real

from imocap_core.artifacts.schemas import Keypoints, SyncSummary

_GAP_S = 0.15
"""A moment further than this from every frame of a video is unmatched in it."""
_END_FRAMES = 1.0
"""So is a moment further than this before the first or after the last of them."""


@dataclass(frozen=True)
class SyncRow:
    """One video against the reference; NaN when nothing matched.

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
    videos = {v.id: v for v in keypoints.videos}
    reference = videos[sync.reference]
    rows = []
    for sync_map in sync.maps:
        video = videos[sync_map.id]
        matched = np.flatnonzero(np.isfinite(sync_map.reference_frame))
        if not len(matched):
            rows.append(SyncRow(video.id, 0.0, np.nan, np.nan, np.nan))
            continue
        here_s = video.time_s[matched]
        there_s = seconds_at(sync_map.reference_frame[matched], reference.time_s)
        duration_s = here_s[-1] - here_s[0]
        rows.append(
            SyncRow(
                video=video.id,
                matched=len(matched) / len(sync_map.reference_frame),
                rate=float((there_s[-1] - there_s[0]) / duration_s) if duration_s > 0 else np.nan,
                confidence=float(sync_map.confidence[matched].mean()),
                offset_s=float(np.median(there_s - here_s)),
            )
        )
    return rows


def seconds_at(
    index: Float[np.ndarray, " N"], time_s: Real[np.ndarray, " T"]
) -> Float[np.ndarray, " N"]:
    """Times of fractional indices into a video's used frames, whose times are `time_s`."""
    seconds = np.interp(index, np.arange(len(time_s)), time_s)
    return np.where(np.isfinite(index), seconds, np.nan)


def common_moments(keypoints: Keypoints, sync: SyncSummary) -> Float[np.ndarray, " M"]:
    """All moments of the action, one per frame of the reference and in its frames: those of the
    reference, and those before and after it at which other videos have frames."""
    reference = next(v for v in keypoints.videos if v.id == sync.reference)
    every = [positions_on_axis(sync, i, reference.fps) for i in sync.ids]
    finite = np.concatenate([position[np.isfinite(position)] for position in every])
    last = len(reference.frames) - 1
    ends = np.rint([finite.min(initial=0.0), finite.max(initial=last)])
    return np.arange(ends[0], ends[1] + 1)


def positions_on_axis(sync: SyncSummary, video: str, fps: float) -> Float[np.ndarray, " T"]:
    """Positions of a video's used frames on the common time axis, in frames of the reference, whose
    rate is `fps`; NaN where unknown."""
    if sync.trust is not None:
        return sync.phases[video] * fps
    return sync.map_of(video).reference_frame


def retimed(
    position: Float[np.ndarray, " T"], moments: Real[np.ndarray, " M"], fps: float
) -> tuple[Int[np.ndarray, " M"], Bool[np.ndarray, " M"]]:
    """For each moment the frame (index) of a video that shows it, and whether one does.

    Args:
        position: the video's frames on the common axis, in frames of the reference, never
            decreasing; NaN where unknown.
        moments: increasing, in frames of the reference, whose rate is `fps`.

    A moment that no frame shows gets the frame of the nearest earlier moment that is shown, or the
    first.
    """
    placed = np.flatnonzero(np.isfinite(position))
    if not len(placed):
        return np.zeros(len(moments), dtype=np.int64), np.zeros(len(moments), dtype=bool)
    there = np.maximum.accumulate(position[placed])
    index = np.rint(np.interp(moments, there, placed)).astype(np.int64)
    distance = np.abs(there[None, :] - moments[:, None]).min(axis=1)
    inside = (moments >= there[0] - _END_FRAMES) & (moments <= there[-1] + _END_FRAMES)
    return np.maximum.accumulate(index), inside & (distance <= max(_END_FRAMES, _GAP_S * fps))


def title_of(sync: SyncSummary, video: str) -> str:
    """A video's id, with its role or treatment: reference, excluded, unmatched, mirrored."""
    reference_frame = sync.map_of(video).reference_frame
    if video == sync.reference:
        return f"{video} (reference)"
    if video in sync.excluded:
        return f"{video} (excluded)"
    if not np.isfinite(reference_frame).any():
        return f"{video} (unmatched)"
    return f"{video} (mirrored)" if video in sync.mirrored else video
