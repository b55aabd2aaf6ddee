"""Spans of a video that collapse onto one moment of another, named."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float

from imocap_core.artifacts.schemas import SyncSummary, VideoKeypoints
from imocap_core.verdict.agreement import anchor_advice, maps_of_others
from imocap_core.verdict.collapsed_time import collapses
from imocap_core.verdict.findings import Finding
from imocap_core.verdict.limbs import limbs_px


def collapse_findings(sync: SyncSummary, videos: Mapping[str, VideoKeypoints]) -> list[Finding]:
    """Spans of a video in which it moves and its match does not, in either direction."""
    findings = []
    reference = videos[sync.reference]
    for sync_map in maps_of_others(sync):
        video = videos[sync_map.id]
        findings += _collapses(video, reference, sync_map.reference_frame)
        inverse = _inverse(sync_map.reference_frame, len(reference.frames))
        findings += _collapses(reference, video, inverse)
    return findings


def _collapses(
    video: VideoKeypoints, other: VideoKeypoints, position: Float[np.ndarray, " _"]
) -> list[Finding]:
    return [
        Finding(
            "time",
            video.id,
            f"the person moves, but all these frames are matched to one moment of {other.id} "
            f"(frame {int(other.frames[round(span.moment)])})",
            f"time collapses onto one moment of {other.id}",
            f"{anchor_advice(video.id, other.id)}, or leave them out: `forbidden: [{{video: "
            f"{video.id}, frames: [{int(video.frames[span.first])}, "
            f"{int(video.frames[span.last]) + 1}]}}]`",
            int(video.frames[span.first]),
            int(video.frames[span.last]),
        )
        for span in collapses(position, limbs_px(video), video.fps)
    ]


def _inverse(position: Float[np.ndarray, " _"], length: int) -> Float[np.ndarray, " _"]:
    """The inverse (length,) of an increasing map; NaN outside of it."""
    matched = np.flatnonzero(np.isfinite(position))
    if len(matched) < 2:
        return np.full(length, np.nan)
    return np.interp(
        np.arange(length), position[matched], matched, left=np.nan, right=np.nan
    ).astype(float)
