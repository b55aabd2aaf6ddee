"""The verdict on an action, from its artifacts."""

from __future__ import annotations

from imocap_core.artifacts.schemas import CameraMotion, Keypoints, RefineSync, Uncertainty
from imocap_core.verdict.agreement import disagreement_s, timing_findings, timing_sentence
from imocap_core.verdict.body_findings import body_findings, feet_findings, picture_findings
from imocap_core.verdict.collapse_findings import collapse_findings
from imocap_core.verdict.contradicted import behind_findings, contradicted_findings
from imocap_core.verdict.decisions import decision_findings
from imocap_core.verdict.detections import camera_findings, detection_findings
from imocap_core.verdict.event_findings import event_findings, event_sentence
from imocap_core.verdict.findings import Verdict
from imocap_core.verdict.further_view import further_view
from imocap_core.verdict.left_out_findings import damage_findings, left_out_findings
from imocap_core.verdict.performer_findings import performer_findings
from imocap_core.verdict.physical_findings import floor_findings, speed_findings, up_findings
from imocap_core.verdict.prediction_findings import prediction_findings
from imocap_core.verdict.repetition_findings import repetition_findings
from imocap_core.verdict.summary import summary_of
from imocap_core.verdict.swapped_findings import swapped_findings
from imocap_core.verdict.take_findings import said_first, take_findings
from imocap_core.verdict.view_findings import hidden_findings, view_clause, view_findings
from imocap_core.verdict.weak_joints import least_certain, weak_findings

ORDER = (
    *("same take", "decision", "up", "time", "body", "hidden", "detection", "feet", "camera"),
    *("view", "joints", "remark"),
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
    cameras = [] if camera_motion is None else camera_motion.videos
    findings = [
        *left_out_findings(keypoints),
        *decision_findings(sync),
        *event_findings(keypoints, refined),
        *take_findings(keypoints.videos),
        *view_findings(motion, sync),
        *hidden_findings(sync, videos),
        *up_findings(motion, sync, cameras),
        *collapse_findings(sync, videos),
        *timing_findings(sync, keypoints.videos),
        *repetition_findings(sync),
        *performer_findings(keypoints, camera_motion, refined),
        *([] if claimed is None else prediction_findings(claimed.leave_one_out)),
        *floor_findings(motion, sync),
        *behind_findings(motion, videos),
        *speed_findings(motion.videos, videos),
        *body_findings(motion, sync, videos),
        *picture_findings(motion.videos, videos),
        *damage_findings(keypoints),
        *detection_findings(keypoints.videos),
        *swapped_findings(motion),
        *contradicted_findings(motion, videos, cameras),
        *feet_findings(motion.videos, videos, cameras),
        *camera_findings(cameras),
        *([] if claimed is None else weak_findings(claimed)),
    ]
    findings.sort(key=lambda f: ORDER.index(f.kind))
    fps, left_out = videos[sync.reference].fps, len(keypoints.left_out or ())
    timing = timing_sentence(sync, fps, left_out)
    if refined.event is not None:
        timing = event_sentence(refined.event, fps, left_out)
    clause = "" if len(sync.ids) - len(sync.excluded) == 1 else view_clause(motion, sync)
    timing = f"{timing.removesuffix('.')}; {clause}." if clause else timing
    return Verdict(
        summary_of(
            said_first(timing, findings, len(videos)),
            findings,
            "" if claimed is None else least_certain(claimed),
            "" if claimed is None else further_view(claimed, sync),
        ),
        tuple(findings),
        disagreement_s(sync) if refined.event is None else None,
    )
