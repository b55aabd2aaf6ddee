"""How well the videos' times agree: round trips over three videos, and each video left out."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from imocap_core.artifacts.schemas import SyncMap, SyncSummary, VideoKeypoints, VideoTrust
from imocap_core.problem.synchronisation import distinct_pictures
from imocap_core.runs import runs
from imocap_core.verdict.advice import anchor_advice
from imocap_core.verdict.findings import Finding, listed
from imocap_core.verdict.repetition_findings import repetition_clause

DOUBTFUL_S = 0.1  # of disagreement
LEAST_MATCHED = 0.5  # of a video's frames
UNCERTAIN = 0.5  # confidence
LEAST_S = 0.5


def disagreement_s(sync: SyncSummary) -> float | None:
    """Median over the videos' round trips and left-out differences; None without a third video."""
    if sync.trust is None or len(sync.ids) - len(sync.excluded) < 3:
        return None
    trips = [t.seconds for t in sync.trust.triples]
    left_out = [v.left_out_s for v in sync.trust.videos]
    medians = [np.median(x) for x in (_finite(trips), _finite(left_out)) if len(x)]
    return float(max(medians)) if medians else None


def timing_sentence(sync: SyncSummary, fps: float, left_out: int = 0) -> str:
    """How well the videos are synchronised; fps: of the reference; left_out: the number of videos
    that could not be used."""
    used = [i for i in sync.ids if i not in sync.excluded]
    if len(used) == 1:
        alone = "One video" if len(sync.ids) == 1 else f"Only {used[0]} is used"
        return (
            f"{alone}: depth, the way the person faces and the path rest on what bodies usually "
            "do, and nothing checks them."
        )
    every = np.concatenate([m.reference_frame for m in maps_of_others(sync)])
    matched = float(np.isfinite(every).mean())
    if len(used) == 2:
        return (
            f"{listed(used)} are matched in {matched:.0%} of their frames"
            f"{repetition_clause(sync)}; with two videos nothing checks the timing."
        )
    declared = len(sync.ids) + left_out
    count = f"{len(used)} videos" if len(used) == declared else f"{len(used)} of {declared} videos"
    apart_s = disagreement_s(sync)
    if apart_s is None:
        return f"{count} are matched in {matched:.0%} of their frames; nothing checks the timing."
    size = f"{1000 * apart_s:.0f} ms ({apart_s * fps:.1f} frames)"
    if apart_s > DOUBTFUL_S:
        return f"The timing is doubtful: the matches of {count} contradict each other by {size}."
    return (
        f"{count} are synchronised: their matches agree with one another within {size}, and "
        f"{matched:.0%} of the frames have a counterpart{repetition_clause(sync)}."
    )


def maps_of_others(sync: SyncSummary) -> list[SyncMap]:
    """The maps of the videos that take part, without the reference's."""
    return [m for m in sync.maps if m.id != sync.reference and m.id not in sync.excluded]


def timing_findings(sync: SyncSummary, videos: Sequence[VideoKeypoints]) -> list[Finding]:
    """Videos whose timing is contradicted, hardly matched, or uncertain for a while."""
    by_id = {video.id: video for video in videos}
    trusts = {} if sync.trust is None else {v.id: v for v in sync.trust.videos}
    findings = []
    for sync_map in maps_of_others(sync):
        whole = _of_video(sync_map, trusts.get(sync_map.id), sync.reference)
        findings += whole or _of_spans(sync_map, by_id[sync_map.id])
    return findings


def _of_video(sync_map: SyncMap, trust: VideoTrust | None, reference: str) -> list[Finding]:
    matched = float(np.isfinite(sync_map.reference_frame).mean())
    if matched < LEAST_MATCHED:
        return [
            Finding(
                "time",
                sync_map.id,
                f"only {matched:.0%} of its frames have a counterpart in {reference}",
                "few frames matched",
            )
        ]
    if trust is not None and trust.left_out_s > DOUBTFUL_S:
        return [
            Finding(
                "time",
                sync_map.id,
                f"its match with {reference} and the one through the other videos disagree by "
                f"{1000 * trust.left_out_s:.0f} ms",
                f"timing contradicted by {1000 * trust.left_out_s:.0f} ms",
                anchor_advice(sync_map.id, reference),
            )
        ]
    return []


def _of_spans(sync_map: SyncMap, video: VideoKeypoints) -> list[Finding]:
    """Spans without a counterpart, and spans of low confidence."""
    least, gap = max(2, round(LEAST_S * video.fps)), round(0.1 * video.fps)
    matched = np.isfinite(sync_map.reference_frame)
    # frames of one picture share the confidence of one observation
    confidence = sync_map.confidence * distinct_pictures(video).times_shown
    uncertain = matched & (confidence < UNCERTAIN)
    findings = []
    for a, b in runs(~matched, least):
        findings.append(
            Finding(
                "remark",
                video.id,
                "no counterpart in another video; this part rests on this video alone",
                "no counterpart",
                "",
                int(video.frames[a]),
                int(video.frames[b]),
            )
        )
    for a, b in runs(uncertain, least, gap):
        mean = float(confidence[a : b + 1].mean())
        findings.append(
            Finding(
                "time",
                video.id,
                f"the timing is uncertain (confidence {mean:.2f} on average)",
                "timing uncertain",
                "",
                int(video.frames[a]),
                int(video.frames[b]),
            )
        )
    return findings


def _finite(values: Sequence[float]) -> list[float]:
    return [value for value in values if np.isfinite(value)]
