"""The verdict on an action, from its artifacts, and its three sentences."""

from __future__ import annotations

from collections.abc import Sequence

from imocap_core.artifacts.schemas import CameraMotion, Keypoints, RefineSync, Uncertainty
from imocap_core.diagnostics.bodies import (
    body_findings,
    feet_findings,
    floor_findings,
    leap_findings,
    performer_findings,
    picture_findings,
    speed_findings,
    up_findings,
)
from imocap_core.diagnostics.contradictions import (
    behind_findings,
    contradicted_findings,
    predicted_videos,
    prediction_findings,
)
from imocap_core.diagnostics.detection_findings import (
    camera_findings,
    damage_findings,
    detection_findings,
    hidden_findings,
    left_out_findings,
    view_findings,
)
from imocap_core.diagnostics.findings import DOUBTFUL_S, Finding, Verdict, listed
from imocap_core.diagnostics.same_take import said_first, take_findings
from imocap_core.diagnostics.timing import (
    collapse_findings,
    count_findings,
    decision_findings,
    disagreement_s,
    event_sentence,
    repetition_findings,
    timing_findings,
    timing_sentence,
)
from imocap_core.diagnostics.weak_joints import further_view, least_certain, weak_findings

NAMED = 3  # faults that the second sentence names, and places of each


def summary_of(
    timing: str, findings: Sequence[Finding], least_certain: str, further: str, doubtful: bool
) -> tuple[str, ...]:
    """How well synchronised, what not to trust, what to do next.

    Args:
        timing: the first sentence.
        findings: the most serious first.
        least_certain, further: clauses on the least certain joint and on what to film; or empty.
        doubtful: whether the first sentence calls the timing so.
    """
    serious = [finding for finding in findings if finding.serious]
    first = {"same take", "view", "repetition"}  # kinds that the first sentence names
    rest = [finding for finding in serious if finding.kind not in first]
    warned = doubtful or any(finding.kind in first for finding in findings)
    second = distrust(rest) or _nothing_found(least_certain, warned)
    return tuple(s for s in (timing, second, next_step(serious, further)) if s)


def distrust(serious: Sequence[Finding]) -> str:
    """A sentence that names the parts not to be trusted, and why; empty when there are none."""
    if not serious:
        return ""
    parts = _parts(without_consequences(serious))
    more = len(parts) - NAMED
    named = parts[:NAMED] + ([f"{more} more part{'s' * (more > 1)}"] if more > 0 else [])
    return f"Do not trust {listed(named)}."


def without_consequences(findings: Sequence[Finding]) -> list[Finding]:
    """Those that do not mostly lie within an earlier, more serious one of the same video."""
    causes: list[Finding] = []
    for finding in findings:
        if not any(_within(finding, cause) for cause in causes):
            causes.append(finding)
    return causes


def _within(finding: Finding, cause: Finding) -> bool:
    """Whether half of the finding's frames lie within the cause's."""
    if finding.video != cause.video or finding.subject:
        return False
    if cause.first_frame is None or cause.last_frame is None:
        return True
    if finding.first_frame is None or finding.last_frame is None:
        return False
    common = min(finding.last_frame, cause.last_frame) - max(finding.first_frame, cause.first_frame)
    return 2 * (common + 1) >= finding.last_frame - finding.first_frame + 1


def next_step(serious: Sequence[Finding], further: str) -> str:
    """A sentence on what to do: the first remedy, else what to film."""
    remedy = next((f"{f.place}: {f.remedy}" for f in serious if f.remedy), "")
    if remedy and any(f.kind == "decision" for f in serious):
        further = ""  # first settle what was left out or mirrored
    steps = [step for step in (remedy, further) if step]
    return f"Next: {'; then '.join(steps)}." if steps else ""


def _nothing_found(least_certain: str, has_first: bool) -> str:
    end = f"; {least_certain}" if least_certain else ""
    nothing = "Nothing was found that speaks against the result"
    return f"{'No other fault was found' if has_first else nothing}{end}."


def _parts(findings: Sequence[Finding]) -> list[str]:
    """Places with what is wrong there; those with one fault together."""
    places: dict[str, list[str]] = {}
    for finding in findings:
        where = finding.subject or finding.place or "the result"
        places.setdefault(finding.brief, []).append(where)
    return [f"{_some(where)} ({brief})" for brief, where in places.items()]


def _some(places: Sequence[str]) -> str:
    more = len(places) - NAMED
    return listed([*places[:NAMED], *([f"{more} more"] if more > 0 else [])])


ORDER = (
    *("same take", "decision", "up", "time", "body", "hidden", "detection", "feet", "camera"),
    *("view", "repetition", "joints", "remark"),
)


def verdict_of(
    keypoints: Keypoints,
    camera_motion: CameraMotion | None,
    refined: RefineSync,
    claimed: Uncertainty | None,
) -> Verdict:
    """What a person must know about a result. Nothing here knows the truth.

    camera_motion, claimed: None where that stage has not run; then nothing is said about it.
    """
    sync, motion = refined.sync, refined.motion
    videos = {video.id: video for video in keypoints.videos}
    left_out_in_turn = [] if claimed is None else claimed.leave_one_out
    predicted = predicted_videos(left_out_in_turn)
    cameras = [] if camera_motion is None else camera_motion.videos
    view = view_findings(motion, sync, left_out_in_turn)
    timing = timing_findings(sync, keypoints.videos, predicted)
    doubted = any(finding.serious for finding in timing)
    findings = [
        *left_out_findings(keypoints),
        *decision_findings(sync),
        *take_findings(keypoints.videos),
        *view,
        *hidden_findings(sync, videos),
        *up_findings(motion, sync, cameras),
        *(count_findings(keypoints.videos, cameras, sync.used) if doubted else []),
        *collapse_findings(sync, videos),
        *timing,
        *repetition_findings(sync),
        *performer_findings(keypoints, camera_motion, refined),
        *prediction_findings(left_out_in_turn),
        *floor_findings(motion, sync, cameras),
        *behind_findings(motion, videos),
        *speed_findings(motion.videos, videos),
        *body_findings(motion, sync, videos),
        *picture_findings(motion.videos, videos),
        *leap_findings(motion.videos),
        *damage_findings(keypoints),
        *detection_findings(keypoints.videos),
        *contradicted_findings(motion, videos, cameras),
        *feet_findings(motion.videos, videos, cameras),
        *camera_findings(cameras),
        *([] if claimed is None else weak_findings(claimed)),
    ]
    findings.sort(key=lambda f: ORDER.index(f.kind))
    fps, left_out = videos[sync.reference].fps, len(keypoints.left_out or ())
    apart_s = disagreement_s(sync, predicted)
    first = timing_sentence(sync, fps, left_out, predicted, apart_s)
    if refined.event is not None:  # refined beyond what the matches agree on
        apart_s = apart_s if (apart_s or 0) > 3 * DOUBTFUL_S else None
        first = event_sentence(refined.event, fps, left_out, doubtful=apart_s is not None)
    if view and len(sync.used) > 1:
        first = f"{first.removesuffix('.')}; {view[0].text}."
    used = set(sync.used)
    is_predicted = predicted >= used if len(used) < 3 else bool(predicted & used)
    return Verdict(
        summary_of(
            said_first(first, findings, len(videos)),
            findings,
            "" if claimed is None else least_certain(claimed),
            "" if claimed is None else further_view(claimed, sync),
            (apart_s or 0) > DOUBTFUL_S,
        ),
        tuple(findings),
        apart_s,
        refined.event is not None or apart_s is not None or is_predicted,
    )
