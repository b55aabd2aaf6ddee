"""Long clips with many repetitions, cut into videos of their own before anything is captured."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from imocap_core.errors import WorkFailed
from imocap_core.pipeline import runner
from imocap_core.pipeline.runner import Display, Job
from imocap_core.workspace import Workspace


def job_in_parts(
    workspace: Workspace, action: str, sets: list[str], display: Display
) -> tuple[Job, list[str]]:
    """The job of an action in which videos with ``repetitions: true`` are cut into repetitions.

    Also a sentence on each clip that was cut. WorkFailed where nothing repeats.
    """
    job = workspace.ready_job(action, sets, display)
    long_clips = [v.id for v in job.action.videos if v.repetitions]
    if not long_clips:
        return job, []
    folder, notes = cut(workspace, job, long_clips, f"{job.action.name}-repetitions", display)
    return workspace.ready_job(str(folder), sets, display), notes


def cut(
    workspace: Workspace, job: Job, long_clips: Sequence[str], name: str, display: Display
) -> tuple[Path, list[str]]:
    """The folder of an action whose videos are the repetitions of long clips (and the videos that
    are none), and a sentence on each clip."""
    from imocap_core.artifacts.schemas import InitialSmpl, Keypoints
    from imocap_core.result.artifacts import artifacts_of_stages
    from imocap_core.standalone_sync.action import write_instances
    from imocap_core.sync.repetition.segmentation import find_repetitions

    hinted = [*job.action.anchors, *job.action.forbidden]
    if hinted:
        raise WorkFailed(
            f"{job.action.file}: anchors and forbidden spans refer to whole videos, and "
            f"{', '.join(long_clips)} is cut into its repetitions; remove them, or cut it yourself "
            "with frames"
        )
    outcomes = runner.run(job, display, job.pipeline.upstream("initial_smpl"))
    artifacts = artifacts_of_stages(job.action.name, {o.stage: o.stored for o in outcomes})
    keypoints, initial = artifacts.get(Keypoints), artifacts.get(InitialSmpl)
    spans: dict[str, list[tuple[int, int]]] = {}
    notes = []
    for video, motion in zip(keypoints.videos, initial.videos, strict=True):
        if video.id not in long_clips:
            continue
        repetitions = find_repetitions(motion.joints, video.fps, job.settings.params.repetitions)
        if len(repetitions.spans) < 2:
            raise WorkFailed(f"{video.id}: {repetitions.status}; nothing to cut")
        spans[video.id] = [
            (int(video.frames[a]), int(video.frames[b - 1]) + 1) for a, b in repetitions.spans
        ]
        notes.append(f"{video.id}: {repetitions.status}")
    return write_instances(workspace.root, job.action, name, spans), notes
