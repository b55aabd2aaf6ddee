"""Long clips with many repetitions, cut into videos of their own before anything is captured."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TypeVar

from imocap_core.artifacts.schemas import InitialSmpl, Keypoints
from imocap_core.artifacts.schemas.base import Artifact
from imocap_core.errors import WorkFailed
from imocap_core.pipeline import runner
from imocap_core.pipeline.runner import Display, Job, Outcome
from imocap_core.workspace import Workspace

Made = TypeVar("Made", bound=Artifact)


def job_in_parts(
    workspace: Workspace, action: str, sets: list[str], display: Display
) -> tuple[Job, list[str]]:
    """The job of an action, or of its parts where it says ``repetitions: true`` of a video.

    Raises WorkFailed where nothing repeats. Sentences say what was cut.
    """
    job = workspace.ready_job(action, sets, display)
    long_clips = [v.id for v in job.action.videos if v.repetitions]
    if not long_clips:
        return job, []
    folder, said = cut(workspace, job, long_clips, f"{job.action.name}-repetitions", display)
    return workspace.ready_job(str(folder), sets, display), said


def cut(
    workspace: Workspace, job: Job, long_clips: Sequence[str], name: str, display: Display
) -> tuple[Path, list[str]]:
    """The folder of an action in which the repetitions of long clips stand for them."""
    from imocap_core.standalone_sync.action import write_instances
    from imocap_core.sync.repetition.segmentation import find_repetitions

    hinted = [*job.action.anchors, *job.action.forbidden]
    if hinted:
        raise WorkFailed(
            f"{job.action.file}: anchors and forbidden spans speak of whole videos, and "
            f"{', '.join(long_clips)} is cut into its repetitions; remove them, or cut it yourself "
            "with frames"
        )
    outcomes = runner.run(job, display, job.pipeline.upstream("initial_smpl"))
    keypoints, initial = made(outcomes, Keypoints), made(outcomes, InitialSmpl)
    spans: dict[str, list[tuple[int, int]]] = {}
    said = []
    for video, motion in zip(keypoints.videos, initial.videos, strict=True):
        if video.id not in long_clips:
            continue
        found = find_repetitions(motion.joints, video.fps, job.settings.params.repetitions)
        if len(found.spans) < 2:
            raise WorkFailed(f"{video.id}: {found.status}; nothing to cut")
        spans[video.id] = [
            (int(video.frames[a]), int(video.frames[b - 1]) + 1) for a, b in found.spans
        ]
        said.append(f"{video.id}: {found.status}")
    return write_instances(workspace.root, job.action, name, spans), said


def made(outcomes: Sequence[Outcome], kind: type[Made]) -> Made:
    """The artifact of a kind among what ran."""
    stored = next(o.stored for o in outcomes if o.stored.schema == kind.__name__)
    return stored.decode(kind)
