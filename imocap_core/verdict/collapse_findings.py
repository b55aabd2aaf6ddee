"""Spans of a video that collapse onto one moment of another, named."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float

from imocap_core.artifacts.schemas import SyncSummary, VideoKeypoints
from imocap_core.verdict.advice import anchor_advice, forbidden_advice
from imocap_core.verdict.agreement import maps_of_others
from imocap_core.verdict.collapsed_time import Collapse, collapses
from imocap_core.verdict.findings import Finding
from imocap_core.verdict.limbs import limbs_px

BESIDE = 2  # frames


def collapse_findings(sync: SyncSummary, videos: Mapping[str, VideoKeypoints]) -> list[Finding]:
    """Spans of a video in which it moves and its match does not, in either direction.

    Where a video's time stands still it jumps afterwards, so that the reference's stands still as
    well: that is not named again.
    """
    findings = []
    reference = videos[sync.reference]
    for sync_map in maps_of_others(sync):
        video = videos[sync_map.id]
        spans = collapses(sync_map.reference_frame, limbs_px(video), video.fps)
        inverse = _inverse(sync_map.reference_frame, len(reference.frames))
        others = [
            back
            for back in collapses(inverse, limbs_px(reference), reference.fps)
            if not any(s.first - BESIDE <= back.moment <= s.last + BESIDE for s in spans)
        ]
        findings += [_finding(video, reference, span) for span in spans]
        findings += [_finding(reference, video, span) for span in others]
    return findings


def _finding(video: VideoKeypoints, other: VideoKeypoints, span: Collapse) -> Finding:
    first, last = int(video.frames[span.first]), int(video.frames[span.last])
    return Finding(
        "time",
        video.id,
        f"the person moves, but all these frames are matched to one moment of {other.id} (frame "
        f"{int(other.frames[round(span.moment)])})",
        f"time collapses onto one moment of {other.id}",
        f"{anchor_advice(video.id, other.id)}, or {forbidden_advice(video.id, first, last)}",
        first,
        last,
    )


def _inverse(position: Float[np.ndarray, " _"], length: int) -> Float[np.ndarray, " _"]:
    """The inverse (length,) of an increasing map; NaN outside of it."""
    matched = np.flatnonzero(np.isfinite(position))
    if len(matched) < 2:
        return np.full(length, np.nan)
    return np.interp(
        np.arange(length), position[matched], matched, left=np.nan, right=np.nan
    ).astype(float)
