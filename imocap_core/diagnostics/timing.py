"""How well the videos' times agree, what collapses, repeats, or was decided about whole videos."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence, Set
from math import remainder

import numpy as np
from jaxtyping import Bool, Float

from imocap_core.adapters.synchronisation import distinct_pictures
from imocap_core.artifacts.schemas import (
    EventCameras,
    SyncMap,
    SyncSummary,
    VideoCameraMotion,
    VideoKeypoints,
    VideoTrust,
)
from imocap_core.diagnostics.contradictions import (
    MeasuredSpan,
    anchor_advice,
    forbidden_advice,
    frames_of,
    limbs_px,
    person_size,
    stretches,
)
from imocap_core.diagnostics.findings import DOUBTFUL_S, Finding, listed
from imocap_core.sequences import index_at, runs
from imocap_core.sync.repetition import find_picture_repetitions
from imocap_core.sync.screening.screening import NO_BODY

LEAST_MATCHED = 0.5  # of a video's frames
UNCERTAIN = 0.5  # confidence
LEAST_S = 0.5


def disagreement_s(sync: SyncSummary, predicted: Set[str]) -> float | None:
    """Median over the videos' round trips and left-out differences, where that is doubtful over
    those of videos that are not `predicted_videos`; None without any, or a third video. Whole
    repetitions do not count: `repetition_clause` tells of them."""
    if sync.trust is None or len(sync.used) < 3:
        return None
    period_s = _period_s(repeating_videos(sync))
    triples = [(set(t.videos), abs(remainder(t.seconds, period_s))) for t in sync.trust.triples]
    for right in (frozenset(), predicted):
        trips = [seconds for videos, seconds in triples if len(videos - right) > 1]
        left_out = [_left_out_s(v) for v in sync.trust.videos if v.id not in right]
        medians = [np.nanmedian(x) for x in (trips, left_out) if np.isfinite(x).any()]
        apart_s = float(max(medians)) if medians else None
        if apart_s is None or apart_s <= DOUBTFUL_S:
            break
    return apart_s


def _left_out_s(video: VideoTrust) -> float:
    """How far a video's two maps are apart but for whole repetitions."""
    repeating = [video] if video.repetition_ratio < NEARLY else []
    return abs(remainder(video.left_out_s, _period_s(repeating)))


def timing_sentence(
    sync: SyncSummary, fps: float, left_out: int, predicted: Set[str], apart_s: float | None
) -> str:
    """How well the videos are synchronised.

    Args:
        fps: of the reference; left_out: the number of videos that could not be used; apart_s:
            `disagreement_s`.
    """
    used = sync.used
    if len(used) == 1:
        alone = "One video" if len(sync.ids) == 1 else f"Only {used[0]} is used"
        return (
            f"{alone}: depth, the way the person faces and the path rest on what bodies usually "
            "do, and nothing checks them."
        )
    shown = [np.isfinite(m.reference_frame) for m in maps_of_others(sync)]
    matched = float(np.concatenate([*shown, _reference_shown(sync)]).mean())
    if len(used) == 2:
        check = "with two videos nothing checks the timing"
        if predicted >= set(used):
            check = "each is predicted by the other's motion"
        matches = f"{listed(used)} are matched in {matched:.0%} of their frames"
        return f"{matches}{repetition_clause(sync)}; {check}."
    declared = len(sync.ids) + left_out
    count = f"{len(used)} videos" if len(used) == declared else f"{len(used)} of {declared} videos"
    if apart_s is None and not predicted & set(used):
        return f"{count} are matched in {matched:.0%} of their frames; nothing checks the timing."
    rest = [i for i in used if i not in predicted]
    others = f"each but {listed(rest, 'or')}" if rest else "each"
    checked = f"{others} is predicted by the others' motion"
    if apart_s is not None:
        size = f"{1000 * apart_s:.0f} ms ({apart_s * fps:.1f} frames)"
        if apart_s > DOUBTFUL_S:
            whose = f" of {listed(rest)}" if len(rest) < len(used) - 1 else ""
            doubt = f"the matches of {count} contradict each other by {size}"
            return f"The timing{whose} is doubtful: {doubt}."
        checked = f"their matches agree with one another within {size}"
    return (
        f"{count} are synchronised: {checked}, and {matched:.0%} of the frames have a counterpart"
        f"{repetition_clause(sync)}."
    )


def _reference_shown(sync: SyncSummary) -> Bool[np.ndarray, " T"]:
    """Whether another video shows each frame of the reference."""
    frames = np.arange(next(len(m.confidence) for m in sync.maps if m.id == sync.reference))
    others = [index_at(m.reference_frame, frames) for m in maps_of_others(sync)]
    return np.asarray(np.isfinite(others).any(axis=0))


def maps_of_others(sync: SyncSummary) -> list[SyncMap]:
    """The maps of the videos that take part, without the reference's."""
    return [m for m in sync.maps if m.id != sync.reference and m.id not in sync.excluded]


def timing_findings(
    sync: SyncSummary, videos: Sequence[VideoKeypoints], predicted: Set[str]
) -> list[Finding]:
    """Videos whose timing is contradicted, hardly matched, or uncertain for a while."""
    by_id = {video.id: video for video in videos}
    findings = []
    for sync_map in maps_of_others(sync):
        is_predicted = sync_map.id in predicted
        trust = None if is_predicted else sync.trusts.get(sync_map.id)
        whole = _of_video(sync_map, trust, sync.reference)
        spans = _of_spans(sync_map, by_id[sync_map.id])
        findings += whole or [f for f in spans if not (is_predicted and f.serious)]
    if len(sync.used) > 1:
        findings += _alone(by_id[sync.reference], _reference_shown(sync))
    return findings


def _of_video(sync_map: SyncMap, trust: VideoTrust | None, reference: str) -> list[Finding]:
    matched = float(np.isfinite(sync_map.reference_frame).mean())
    if matched < LEAST_MATCHED:
        text = f"only {matched:.0%} of its frames have a counterpart in {reference}"
        return [Finding("time", sync_map.id, text, "few frames matched")]
    if trust is not None and _left_out_s(trust) > DOUBTFUL_S:
        return [
            Finding(
                "time",
                sync_map.id,
                f"its match with {reference} and the one through the other videos disagree by "
                f"{1000 * _left_out_s(trust):.0f} ms",
                f"timing contradicted by {1000 * _left_out_s(trust):.0f} ms",
                anchor_advice(sync_map.id, reference),
            )
        ]
    return []


def _of_spans(sync_map: SyncMap, video: VideoKeypoints) -> list[Finding]:
    """Spans without a counterpart, and spans of low confidence."""
    matched = np.isfinite(sync_map.reference_frame)
    # frames of one picture share the confidence of one observation
    confidence = sync_map.confidence * distinct_pictures(video).times_shown
    uncertain = matched & (confidence < UNCERTAIN)
    findings = _alone(video, matched)
    for a, b in stretches(uncertain, video.fps, LEAST_S, 0.1):
        mean = float(confidence[a : b + 1].mean())
        text = f"the timing is uncertain (confidence {mean:.2f} on average)"
        place = frames_of(video, a, b)
        findings.append(Finding("time", video.id, text, "timing uncertain", "", *place))
    return findings


def _alone(video: VideoKeypoints, matched: Bool[np.ndarray, " T"]) -> list[Finding]:
    text = "no counterpart in another video; this part rests on this video alone"
    spans = stretches(~matched, video.fps, LEAST_S)
    return [
        Finding("remark", video.id, text, "no counterpart", "", *frames_of(video, a, b))
        for a, b in spans
    ]


STOPPED = 0.1  # of the video's usual rate
LEAST_COLLAPSED_S = 0.25
LEAST_FRAMES = 6
MOVED = 0.1  # of the person's size, root-relative: more than a detector's noise


def collapses(
    position: Float[np.ndarray, " T"], xy_px: Float[np.ndarray, "T K 2"], fps: float
) -> list[MeasuredSpan]:
    """Spans in which the person moves and the matched moment does not, and that moment.

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
    least = max(LEAST_FRAMES, round(LEAST_COLLAPSED_S * fps))
    spans = []
    for first, last in runs(stopped, least - 1):
        if pose_change(xy_px[first : last + 2], person_size(xy_px)) > MOVED:
            moment = float(np.median(position[first : last + 2]))
            spans.append(MeasuredSpan(first, last + 1, moment))
    return spans


def pose_change(xy_px: Float[np.ndarray, "T K 2"], size_px: float) -> float:
    """Largest mean distance of centred keypoints from the first that are shown, in body sizes."""
    shown = xy_px[np.isfinite(xy_px).all(-1).sum(1) >= 3]
    if not len(shown):
        return 0.0
    centred = shown - np.nanmedian(shown, axis=1, keepdims=True)
    distance = np.linalg.norm(centred - centred[:1], axis=-1)
    enough = np.isfinite(distance).sum(1) >= 3
    return float(np.nanmean(distance[enough], axis=1).max() / size_px)


NEAR_FRAMES = 2  # frames
_SEVERAL = 3  # collapses between two videos: not an accident of one moment


def collapse_findings(sync: SyncSummary, videos: Mapping[str, VideoKeypoints]) -> list[Finding]:
    """Spans of a video in which it moves and its match does not, in either direction; several
    between two videos are one finding.

    Where a video's time stands still it jumps afterwards, so that the reference's stands still as
    well: that is not named again.
    """
    findings = []
    reference = videos[sync.reference]
    for sync_map in maps_of_others(sync):
        video = videos[sync_map.id]
        spans = collapses(sync_map.reference_frame, limbs_px(video), video.fps)
        inverse = index_at(sync_map.reference_frame, np.arange(len(reference.frames)))
        others = [
            back
            for back in collapses(inverse, limbs_px(reference), reference.fps)
            if not any(s.first - NEAR_FRAMES <= back.value <= s.last + NEAR_FRAMES for s in spans)
        ]
        of_pair = [_finding(video, reference, span) for span in spans]
        of_pair += [_finding(reference, video, span) for span in others]
        several = len(of_pair) >= _SEVERAL
        findings += [_unlike(video.id, reference.id, len(of_pair))] if several else of_pair
    return findings


def _unlike(video: str, reference: str, count: int) -> Finding:
    return Finding(
        "time",
        video,
        f"{count} times it moves while its time in {reference} stands still, or the other way "
        "round: one of them shows movement that the other does not",
        f"shows other movement than {reference}",
        f"leave {video} out, or {anchor_advice(video, reference)}",
    )


def _finding(video: VideoKeypoints, other: VideoKeypoints, span: MeasuredSpan) -> Finding:
    first, last = frames_of(video, span.first, span.last)
    return Finding(
        "time",
        video.id,
        f"the person moves, but all these frames are matched to one moment of {other.id} (frame "
        f"{int(other.frames[round(span.value)])})",
        f"time collapses onto one moment of {other.id}",
        f"{anchor_advice(video.id, other.id)}, or {forbidden_advice(video.id, first, last)}",
        first,
        last,
    )


# Squared distance of a map shifted by a repetition over the map's own. Of 48 videos of walks that
# begin in any cycle it names 34, among them 11 of the 13 that are matched a cycle off; of 72 videos
# of other training clips 9, one of the 2 that are more than 0.35 s off among them
NEARLY = 1.4


def repeating_videos(sync: SyncSummary) -> list[VideoTrust]:
    """Those whose maps fit nearly as well when shifted by a repetition."""
    used = [v for v in sync.trusts.values() if v.id not in sync.excluded]
    return [v for v in used if v.repetition_ratio < NEARLY]


def _period_s(repeating: Sequence[VideoTrust]) -> float:
    """Length of a repetition, infinite where nothing repeats."""
    return float(np.median([abs(v.repetition_s) for v in repeating])) if repeating else np.inf


def repetition_clause(sync: SyncSummary) -> str:
    """What the sentence on timing has to add; empty where the action does not repeat."""
    repeating = repeating_videos(sync)
    if not repeating:
        return ""
    names = listed([v.id for v in repeating], "or")
    return f", but the action repeats, and {names} may be matched {_period_s(repeating):.1f} s off"


def repetition_findings(sync: SyncSummary) -> list[Finding]:
    """A finding on each of these videos."""
    return [_repetition_finding(video, sync.reference) for video in repeating_videos(sync)]


def _repetition_finding(video: VideoTrust, reference: str) -> Finding:
    direction = "later" if video.repetition_s > 0 else "earlier"
    return Finding(
        "repetition",
        video.id,
        f"the action repeats: {abs(video.repetition_s):.1f} s {direction} in {reference} the video "
        f"fits nearly as well (squared pose distances {video.repetition_ratio:.1f} times as large)",
        "may be matched a repetition off",
        f"if it is, {anchor_advice(video.id, reference)}",
    )


# Undeclared repetitions count from this score and length (halves of a throw look alike); up to the
# second score there is one. The first seconds of a video are counted.
_COUNTED, _SHORTEST_S, _SINGLE, _COUNTED_S = 0.75, 0.8, 0.5, 30.0


def count_findings(
    videos: Sequence[VideoKeypoints], cameras: Sequence[VideoCameraMotion], used: Collection[str]
) -> list[Finding]:
    """Videos, of those that are used, with at least twice as many repetitions as another one."""
    counts = {}
    for video, camera in zip(videos, cameras, strict=False):
        some, fps = slice(round(_COUNTED_S * video.fps)), video.fps
        cut = find_picture_repetitions(camera.xy_first_px[some], video.confidence[some], fps)
        several = cut.score >= _COUNTED and np.median(np.diff(cut.spans)) >= _SHORTEST_S * fps
        if video.id in used and (several or cut.score <= _SINGLE):
            counts[video.id] = len(cut.spans) if several else 1
    fewest = min(counts, key=lambda video: counts[video], default="")
    repeated = [video for video, count in counts.items() if count > 1]
    where = f" for {listed(repeated)}" if len(repeated) > 1 else ""
    return [
        Finding(
            "time",
            video,
            f"shows {count} repetitions of the action, {fewest} only {counts[fewest]}",
            f"{count} repetitions, fewer in {fewest}",
            f"`repetitions: true`{where} in action.yaml makes each repetition a performance",
        )
        for video, count in counts.items()
        if count >= 2 * counts[fewest]
    ]


KEEP = "`--set sync.outliers=report` (in action.yaml `params: {sync: {outliers: report}}`)"


def decision_findings(sync: SyncSummary) -> list[Finding]:
    """Videos that were left out or mirrored, and what else was noticed about whole videos."""
    findings = [_excluded(sync, video) for video in sync.excluded]
    findings += [_mirrored(sync, video) for video in sync.mirrored if video not in sync.excluded]
    treated = {*sync.excluded, *sync.mirrored}
    for note in sync.notes:
        video = next((i for i in sync.ids if note.startswith(f"{i} ")), "")
        if video in treated:
            continue
        text = note.removeprefix(f"{video} ") if video else note
        findings.append(Finding("remark", video, text, text))
    return findings


def _excluded(sync: SyncSummary, video: str) -> Finding:
    if any(note.startswith(f"{video} {NO_BODY}") for note in sync.notes):
        why = (
            "its detections fit no body, not even from this video alone: much of the person is "
            "hidden or out of the picture, or it is not one person"
        )
        brief = "left out: its detections fit no body"
        remedy = "use another clip instead, in which most of the person is visible"
    else:
        why = (
            f"it seems to show another action{_score(sync, video)}; its motion is that of this "
            "video alone and not in the others' time"
        )
        brief, remedy = "left out as another action", f"if it shows this action, run with {KEEP}"
    return Finding("decision", video, f"left out, because {why}", brief, remedy)


def _mirrored(sync: SyncSummary, video: str) -> Finding:
    if any(note.startswith(f"{video} is declared mirrored") for note in sync.notes):
        return Finding("remark", video, "mirrored, as action.yaml declares", "mirrored as declared")
    return Finding(
        "decision",
        video,
        f"treated as its mirror image{_margin(sync, video)}",
        "treated as mirrored",
        f"if its picture is not flipped, write `mirrored: false` below `id: {video}` in "
        "action.yaml, and `mirrored: true` if it is",
    )


def _score(sync: SyncSummary, video: str) -> str:
    value = sync.trusts[video].outlier_score if video in sync.trusts else np.nan
    return f" (score {value:.2f}; usual videos stay below 0.9)" if np.isfinite(value) else ""


def _margin(sync: SyncSummary, video: str) -> str:
    value = sync.trusts[video].mirror_margin if video in sync.trusts else np.nan
    if not np.isfinite(value):
        return ""
    return f", because it fits the others {100 * (np.exp(value) - 1):.0f} % better so"


UNCERTAIN_S = 0.1


def event_sentence(
    event: EventCameras, fps: float, left_out: int = 0, *, doubtful: bool = False
) -> str:
    """How well the videos of one event are synchronised and their cameras calibrated; fps: of the
    reference; left_out: the number of videos that could not be used."""
    ids = [camera.id for camera in event.cameras]
    count = f"{len(ids)} of {len(ids) + left_out} videos" if left_out else f"{len(ids)} videos"
    offset_s = max(camera.offset_sd_s for camera in event.cameras)
    turned = max(camera.rotation_sd_deg for camera in event.cameras)
    focal = max(camera.focal_sd for camera in event.cameras)
    lens = f"; focal lengths to {focal:.0%}" if focal > 0 else ""
    doubt = "The timing is doubtful: " if doubtful or offset_s > UNCERTAIN_S else ""
    kind = "of one event" if event.declared else "look like one event (if not, event: false) and"
    return (
        f"{doubt}{count} {kind} are synchronised to about {1000 * offset_s:.0f} ms "
        f"({offset_s * fps:.1f} frames), and their cameras are calibrated from the performer: "
        f"directions to about {turned:.1f} degrees{lens}."
    )
