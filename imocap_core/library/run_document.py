"""A run as plain data: stages, correspondences, cameras, the verdict. For scripts."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from imocap_core.artifacts.schemas import (
    Camera,
    CameraMotion,
    Evaluate,
    Keypoints,
    RefineSync,
    SmplBa,
    Sync,
    SyncSummary,
    Uncertainty,
    VideoTrust,
)
from imocap_core.diagnostics.findings import verdict_document
from imocap_core.figures.sync_summary import SyncRow, sync_rows
from imocap_core.library.status import report_page
from imocap_core.result.artifacts import STAGE_OF, Artifacts, artifacts_of_stages

if TYPE_CHECKING:
    from imocap_core.library.running import Run


FORMAT = 1  # rises when a field changes its meaning or goes


def run_document(done: Run) -> dict[str, Any]:
    """What a script needs to know of a run, as plain data and arrays; None where a part of the run
    that it comes from was not reached.

    `trusted`: whether nothing was found that speaks against the result. `warnings`: all findings
    but the ill-determined joints, as sentences, the most serious first.
    """
    artifacts = _of_run(done)
    refined = artifacts.find(RefineSync)
    sync: SyncSummary | None = refined.sync if refined is not None else artifacts.find(Sync)
    motion = refined.motion if refined is not None else artifacts.find(SmplBa)
    keypoints, evaluated = artifacts.find(Keypoints), artifacts.find(Evaluate)
    verdict = done.verdict
    findings = () if verdict is None else verdict.findings
    return {
        "format": FORMAT,
        "action": done.job.action.name,
        "seconds": done.seconds,
        "stages": [
            {
                "stage": outcome.stage,
                "how": outcome.how,
                "seconds": outcome.seconds,
                "digest": outcome.stored.digest,
            }
            for outcome in done.outcomes
        ],
        "trusted": None if verdict is None else verdict.trusted,
        "level": None if verdict is None else verdict.level,
        "summary": [] if verdict is None else list(verdict.summary),
        "warnings": [f.sentence for f in findings if f.kind != "joints"],
        "notes": done.notes,
        "left_out": None
        if keypoints is None
        else [{"video": v.id, "reason": v.reason} for v in keypoints.left_out or ()],
        "excluded": None if sync is None else sync.excluded,
        "mirrored": None if sync is None else sync.mirrored,
        "sync": None if sync is None or keypoints is None else _sync_document(keypoints, sync),
        "cameras": None if motion is None else _cameras(motion, artifacts),
        "scores": None
        if evaluated is None
        else {
            table.name: [dict(zip(table.columns, row, strict=True)) for row in table.rows]
            for table in evaluated.tables
        },
        "verdict": None if verdict is None else verdict_document(verdict),
        "report": report_page(done.job),
        "artifacts": done.job.store.folder / done.job.action.name,
    }


def _sync_document(keypoints: Keypoints, sync: SyncSummary) -> dict[str, Any]:
    """The correspondences: what holds for all videos, and a row for each."""
    frames = {video.id: video for video in keypoints.videos}
    return {
        "reference": sync.reference,
        "status": sync.status,
        "method": sync.method,
        "notes": sync.notes,
        "videos": [
            asdict(row)
            | {"frames": len(frames[row.video].frames), "fps": frames[row.video].fps}
            | _treatment(row, sync, sync.trusts.get(row.video))
            for row in sync_rows(keypoints, sync)
        ],
    }


def _treatment(row: SyncRow, sync: SyncSummary, trust: VideoTrust | None) -> dict[str, Any]:
    """What was decided about a video, and by which numbers."""
    numbers = ("outlier_score", "mirror_margin", "left_out_s")
    return {
        "reference": row.video == sync.reference,
        "excluded": row.video in sync.excluded,
        "mirrored": row.video in sync.mirrored,
        "alternative": sync.alternatives.get(row.video),
        **{name: None if trust is None else getattr(trust, name) for name in numbers},
    }


def _cameras(motion: SmplBa, artifacts: Artifacts) -> list[dict[str, Any]]:
    """Each camera: x_cam = R x_world + t, metres; how it moves, and how certain it is."""
    cameras, claimed = artifacts.find(CameraMotion), artifacts.find(Uncertainty)
    moves = {} if cameras is None else {video.id: video for video in cameras.videos}
    turns = {} if claimed is None else {v.id: v.camera_rotation_deg for v in claimed.videos}
    errors_px = {video.id: float(video.reprojection_px.mean()) for video in motion.videos}

    def document(camera: Camera) -> dict[str, Any]:
        movement = moves.get(camera.id)
        return {
            "video": camera.id,
            "K": camera.K.tolist(),
            "R": camera.R.tolist(),
            "t": camera.t.tolist(),
            "focal_source": None if movement is None else movement.focal_source,
            "motion": None if movement is None else movement.motion,
            "rotation_sd_deg": turns.get(camera.id),
            "reprojection_px": errors_px.get(camera.id),
        }

    return [document(camera) for camera in motion.cameras]


def _of_run(done: Run) -> Artifacts:
    """The artifacts of the stages that are the pipeline's usual ones."""
    kinds = {stage: kind.__name__ for kind, stage in STAGE_OF.items()}
    stored = {
        outcome.stage: outcome.stored
        for outcome in done.outcomes
        if outcome.stored.schema == kinds.get(outcome.stage)
    }
    return artifacts_of_stages(done.job.action.name, stored)
