"""Running an action: all of it, or one stage."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from imocap_core.errors import WrongUse
from imocap_core.library.cache_limit import cache_limit_bytes, keep_cache_within_limit
from imocap_core.library.door import plain_errors
from imocap_core.library.new_action import action_of_videos
from imocap_core.library.one_off import Params, one_off
from imocap_core.library.progress import Progress, displaying
from imocap_core.library.run_log import LoggedDisplay, recording
from imocap_core.library.status import left_out_notes, upstream
from imocap_core.pipeline import runner
from imocap_core.pipeline.device import CPU, check_device
from imocap_core.pipeline.repeated_files import repeated_files
from imocap_core.pipeline.runner import Job, Outcome
from imocap_core.verdict.findings import Verdict
from imocap_core.workspace import Workspace

if TYPE_CHECKING:
    from imocap_core.library.result import MotionStage, Result


@dataclass(frozen=True)
class Run:
    """What a run did: its job, how each stage came to its artifact, sentences for the user.

    verdict: what to know about the result; None where the run ended before the motion.
    """

    job: Job
    outcomes: list[Outcome]
    notes: list[str]
    seconds: float
    verdict: Verdict | None = None


@plain_errors
def run(
    action: str | Path | None = None,
    *,
    videos: Sequence[str | Path] | None = None,
    name: str | None = None,
    root: str | Path = ".",
    params: Params = None,
    force: bool = False,
    until: str | None = None,
    store: str | None = None,
    device: str = CPU,
    progress: Progress = True,
) -> Result:
    """Capture an action: run every stage that has changed since the last run, to the report.

    While stages run, PyTorch, NumPy and SciPy compute with one thread in this process and, on
    Linux, freed memory is kept for later arrays (`imocap_core.process.configure_process`); both
    stay so afterwards. Importing imocap changes neither.

    Args:
        action: its name below root/actions, the path of its folder, or a built-in one (yoga,
            taichi).
        videos: instead of an action, the video files of one, or their folder;
            root/actions/NAME/action.yaml is made, in which people are detected.
        name: of the action made of `videos`; else one after their files or folder.
        root: the working folder, with actions/ and artifacts/.
        params: one-off parameters, as {"sync": {"max_rate": 8}} or {"sync.max_rate": 8}; their
            names, units and defaults are those of pipeline.yaml.
        force: run what is cached too.
        until: stop after this stage: smpl_ba, refine_sync, or one that needs one of them.
        store: URL or folder of a store that several machines share: results that are there are
            fetched, and others published.
        device: where tensors are computed: cpu, cuda, or one of several as cuda:1. Results differ
            by rounding and are not made again for another device.
        progress: a function of (stage, share, text), True for what the command shows, on the
            standard error, None for silence.

    Returns:
        The result in the reference camera's axes.

    Raises:
        WrongUse: no such action, stage, parameter or device.
        WorkFailed: a stage could not do its work; what was finished stays.
    """
    from imocap_core.library.result import Result  # NumPy and more, not needed by all commands

    if (action is None) == (videos is None):
        raise WrongUse("expected an action or videos=[...], one of them")
    check_device(device)
    if videos is not None:
        action, _ = action_of_videos(Path(root), name, [Path(video) for video in videos])
    assert action is not None
    motion_stage = _motion_stage(Workspace(Path(root)), until)
    done = run_action(
        action,
        root=root,
        params=params,
        force=force,
        until=until,
        store=store,
        device=device,
        progress=progress,
    )
    stored = {outcome.stage: outcome.stored for outcome in done.outcomes}
    return Result.of_stages(done.job.action, stored, motion_stage)


@plain_errors
def run_action(
    action: str | Path,
    *,
    root: str | Path = ".",
    params: Params = None,
    force: bool = False,
    until: str | None = None,
    store: str | None = None,
    device: str = CPU,
    progress: Progress = None,
    part_of_many: bool = False,
) -> Run:
    """Run every stage of an action that has changed, to its report; arguments as of `run`.

    part_of_many: whoever runs many actions keeps the cache within its limit, once.
    """
    from imocap_core.report.action_report import finish, verdict_of_run
    from imocap_core.standalone_sync.repetitions import job_in_parts

    with displaying(progress) as display:
        began = time.perf_counter()
        cache_limit_bytes()  # a wrong one is noticed before the work
        workspace = Workspace(Path(root), store, device)
        job, notes = job_in_parts(workspace, str(action), one_off(params), display)
        notes = [*notes, *repeated_files(job.action)]
        stages = list(job.pipeline.stages) if until is None else upstream(job, until)
        with recording(job, notes) as log:

            def report(outcomes: Sequence[Outcome]) -> None:
                finish(job, outcomes)
                log.verdict = verdict_of_run(job, outcomes)

            forced = frozenset(stages if force else [])
            outcomes = runner.run(job, LoggedDisplay(display, log), stages, forced, report)
    if not part_of_many:
        notes = [*notes, *keep_cache_within_limit(workspace.root)]
    if log.verdict is None:
        notes = [*notes, *left_out_notes({o.stage: o.stored for o in outcomes})]
    return Run(job, outcomes, notes, time.perf_counter() - began, log.verdict)


@plain_errors
def run_stage(
    name: str,
    action: str | Path,
    *,
    root: str | Path = ".",
    params: Params = None,
    force: bool = False,
    device: str = CPU,
    progress: Progress = True,
) -> Run:
    """Run one stage (and what it needs, where that is not cached); arguments as of `run`."""
    from imocap_core.report.action_report import finish

    with displaying(progress) as display:
        began = time.perf_counter()
        workspace = Workspace(Path(root), device=device)
        job = workspace.ready_job(str(action), one_off(params), display)
        forced = frozenset([name] * force)
        with recording(job, []) as log:
            outcomes = runner.run(
                job,
                LoggedDisplay(display, log),
                upstream(job, name),
                forced,
                lambda made: finish(job, made),
            )
    notes = left_out_notes({o.stage: o.stored for o in outcomes})
    return Run(job, outcomes, notes, time.perf_counter() - began)


def _motion_stage(workspace: Workspace, until: str | None) -> MotionStage:
    """The last stage with a motion of all videos that a run goes through."""
    pipeline = workspace.pipeline()
    if until is not None and until not in pipeline.stages:
        raise WrongUse(f"no stage {until!r}; there are: {', '.join(pipeline.stages)}")
    stages = list(pipeline.stages) if until is None else pipeline.upstream(until)
    if "refine_sync" in stages:
        return "refine_sync"
    if "smpl_ba" in stages:
        return "smpl_ba"
    raise WrongUse(
        f"until: expected a stage whose result has the motion of all videos (smpl_ba, refine_sync "
        f"or a later one), got {until}; run_stage({until!r}, ...) runs it alone"
    )
