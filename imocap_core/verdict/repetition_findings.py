"""Videos that nothing places in one repetition of the action rather than in the next."""

from __future__ import annotations

import numpy as np

from imocap_core.artifacts.schemas import SyncSummary, VideoTrust
from imocap_core.verdict.advice import anchor_advice
from imocap_core.verdict.findings import Finding, listed

# Squared distance of a map shifted by a repetition over the map's own. Of 48 videos of walks that
# begin in any cycle it names 34, among them 11 of the 13 that are matched a cycle off; of 72 videos
# of other training clips 9, one of the 2 that are more than 0.35 s off among them
NEARLY = 1.4


def repeating_videos(sync: SyncSummary) -> list[VideoTrust]:
    """Those whose maps fit nearly as well when shifted by a repetition."""
    videos = [] if sync.trust is None else sync.trust.videos
    return [v for v in videos if v.repetition_ratio < NEARLY and v.id not in sync.excluded]


def repetition_clause(sync: SyncSummary) -> str:
    """What the sentence on timing has to add; empty where the action does not repeat."""
    repeating = repeating_videos(sync)
    if not repeating:
        return ""
    period_s = float(np.median([abs(v.repetition_s) for v in repeating]))
    names = listed([v.id for v in repeating], "or")
    return f", but the action repeats, and {names} may be matched {period_s:.1f} s off"


def repetition_findings(sync: SyncSummary) -> list[Finding]:
    """A remark on each of these videos."""
    return [_finding(video, sync.reference) for video in repeating_videos(sync)]


def _finding(video: VideoTrust, reference: str) -> Finding:
    direction = "later" if video.repetition_s > 0 else "earlier"
    return Finding(
        "remark",
        video.id,
        f"the action repeats: {abs(video.repetition_s):.1f} s {direction} in {reference} the video "
        f"fits nearly as well (squared distances of poses {video.repetition_ratio:.1f} times as "
        "large)",
        "may be matched a repetition off",
        f"if it is, {anchor_advice(video.id, reference)}",
    )
