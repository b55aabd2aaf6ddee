"""The tasks of actions: (action, video) for detection, (action, stage, video) for a stage whose
result has a part for each video, (action, stage) for all.

Stages of one action come after one another, actions do not. Of what may begin, the action named
first goes on, so that finished actions come early.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from imocap_core.executors.task import Report, Task
from imocap_core.library.door import plain_errors
from imocap_core.library.progress import FunctionDisplay
from imocap_core.library.running import run_action
from imocap_core.pipeline import builtin_actions
from imocap_core.pipeline.device import CPU
from imocap_core.pipeline.runner import make_part
from imocap_core.workspace import Workspace

WHOLE = "all stages"


@dataclass(frozen=True)
class StageEnd:
    """What a stage's task leaves.

    summary: the verdict's sentences, after the last stage.
    """

    stage: str
    how: str
    seconds: float
    digest: str
    notes: tuple[str, ...] = ()
    summary: tuple[str, ...] = ()


def task_name(action: str, step: str) -> str:
    """As it is shown: an action and one of its steps."""
    return f"{action}: {step}"


def tasks_of(workspace: Workspace, action: str, sets: Sequence[str], priority: int) -> list[Task]:
    """The tasks that bring an action to its report, each after the one before it.

    ImocapError when its action.yaml cannot be used.
    """
    root = workspace.root
    if action in builtin_actions.BUILT_IN:
        made = Task(task_name(action, "demo"), make_built_in, (root, action), (), priority)
        stages = _stage_tasks(workspace, action, [], sets, (made.name,), priority)
        return [made, *stages]
    declared = workspace.job(action, list(sets)).action
    if any(video.repetitions for video in declared.videos):  # its parts are known only later
        whole = (root, action, tuple(sets), workspace.shared, None, workspace.device)
        return [Task(task_name(action, WHOLE), run_to, whole, (), priority)]
    detections = [
        Task(
            task_name(action, f"detect {video.id}"),
            detect_video,
            (root, action, tuple(sets), workspace.shared, video.id),
            (),
            priority,
        )
        for video in declared.videos
        if video.detected
    ]
    after = tuple(task.name for task in detections)
    ids = [video.id for video in declared.videos]
    return [*detections, *_stage_tasks(workspace, action, ids, sets, after, priority)]


def _stage_tasks(
    workspace: Workspace,
    action: str,
    videos: Sequence[str],
    sets: Sequence[str],
    after: tuple[str, ...],
    priority: int,
) -> list[Task]:
    """A task a stage, after those of its parts; of a single video, the part is the whole."""
    tasks = []
    stages = list(workspace.pipeline().stages.items())
    common = (workspace.root, action, tuple(sets), workspace.shared)
    for stage, spec in stages:
        if spec.parts == "videos" and len(videos) > 1:
            parts = [
                Task(
                    task_name(action, f"{stage} {v}"),
                    part_of,
                    (*common, stage, v, workspace.device),
                    after,
                    priority,
                )
                for v in videos
            ]
            tasks += parts
            after = tuple(part.name for part in parts) or after
        until = None if stage == stages[-1][0] else stage
        task = Task(
            task_name(action, stage), run_to, (*common, until, workspace.device), after, priority
        )
        tasks.append(task)
        after = (task.name,)
    return tasks


def make_built_in(report: Report, root: Path, name: str) -> None:
    """Make a built-in action, unless it is there."""
    workspace = Workspace(root)
    display = FunctionDisplay(lambda stage, share, text: report(share, text))
    with workspace.store.lock(name, display.waiting):
        folder = root / "actions" / name
        builtin_actions.ensure(name, folder, workspace.pipeline().seed, display)


def detect_video(
    report: Report,
    root: Path,
    action: str,
    sets: tuple[str, ...],
    shared: str | None,
    video: str,
) -> None:
    """Detect the people in one video, unless that was done."""
    from imocap_core.detect.action import detect_one

    job = Workspace(root, shared).job(action, list(sets))
    display = FunctionDisplay(lambda stage, share, text: report(share, text))
    detect_one(job.action, video, job.settings.params.detect, job.store, display)


@plain_errors
def part_of(
    report: Report,
    root: Path,
    action: str,
    sets: tuple[str, ...],
    shared: str | None,
    stage: str,
    video: str,
    device: str = CPU,
) -> None:
    """Make the part of a stage's result that belongs to a video, unless it is cached."""
    display = FunctionDisplay(lambda stage, share, text: report(share, text))
    job = Workspace(root, shared, device).ready_job(action, list(sets), display)
    make_part(job, stage, video, display)


def run_to(
    report: Report,
    root: Path,
    action: str,
    sets: tuple[str, ...],
    shared: str | None,
    until: str | None,
    device: str = CPU,
) -> StageEnd:
    """Bring an action up to date to a stage (None: to its report); earlier ones are cached."""
    done = run_action(
        action,
        root=root,
        params=list(sets),
        until=until,
        store=shared,
        device=device,
        progress=lambda stage, share, text: report(share, text),
        part_of_many=True,
    )
    last = done.outcomes[-1]
    summary = () if done.verdict is None or until is not None else tuple(done.verdict.summary)
    notes = () if until is not None else tuple(done.notes)
    return StageEnd(last.stage, last.how, last.seconds, last.stored.digest, notes, summary)
