"""export: from the artifacts of an action to files that other programs read."""

from __future__ import annotations

from pathlib import Path

from imocap_core.artifacts.store import Store
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.errors import WorkFailed
from imocap_core.export.clips import poses_of
from imocap_core.export.common_time import on_common_time
from imocap_core.export.sources import read_result
from imocap_core.export.values import Performance, Result, Time
from imocap_core.io.writers.export_npz import (
    ExportedHands,
    ExportedVideo,
    write_cameras,
    write_sync,
    write_video,
)


def export_npz(
    store: Store, action: str, out: Path, up: str | None, time: Time = "own"
) -> list[Path]:
    """Write <id>.npz, sync.csv and cameras.json below `out`; the paths, in that order."""
    whole = read_result(store, action, up)
    result = on_common_time(whole) if time == "common" else whole
    try:
        out.mkdir(parents=True, exist_ok=True)
        videos = [exported(p, result) for p in result.performances]
        return [*(write_video(out, video) for video in videos), *write_beside(out, whole)]
    except OSError as error:
        raise WorkFailed(f"cannot write to {out}: {error.strerror}") from None


def write_beside(out: Path, result: Result) -> list[Path]:
    """sync.csv and cameras.json, of the videos' own frames whatever the motion's timeline."""
    sync = result.sync
    return [
        write_sync(
            out,
            {p.id: p.seen.frames for p in result.performances},
            {m.id: (m.reference_frame, m.confidence) for m in sync.maps},
            sync.reference,
            None if sync.trust is None else {v.id: v.phase_s for v in sync.trust.videos},
        ),
        write_cameras(out, [exported(p, result) for p in result.performances], result.reference),
    ]


def exported(p: Performance, result: Result) -> ExportedVideo:
    """One performance as its npz holds it."""
    hands = None
    if p.hands is not None:
        hands = ExportedHands(poses_of(p), p.hands.points, p.hands.seen)
    return ExportedVideo(
        id=p.id,
        poses=p.body.theta,
        betas=p.betas,
        trans=p.body.trans,
        joints=p.body.joints,
        joint_names=tuple(SMPL_JOINTS),
        fps=p.fps,
        size=p.seen.size,
        frames=p.seen.frames if result.time == "own" else p.frames,
        K=p.K,
        R=p.pose.R,
        t=p.pose.t,
        model=f"{result.model} {result.model_digest}",
        up_axis=result.up_axis,
        hands=hands,
        inside=None if result.time == "own" else p.inside,
        phase_s=None if result.time == "own" else p.phase_s,
    )
