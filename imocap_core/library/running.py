"""Running an action: all of it, or one stage; and the record of its last run.

The record of an action's last run for programs: artifacts/ACTION/run.json. It has what artifacts
must not have, because the same input gives the same bytes there: the clock, the machine, and what
was said to the user. A run that fails leaves a record too, with its error.
"""

from __future__ import annotations

import json
import os
import platform
import re
import sys
import time
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any

from imocap_core.artifacts.file_memory import save_memory
from imocap_core.diagnostics.findings import Verdict
from imocap_core.errors import ImocapError, Stopped, WrongUse
from imocap_core.files import write_whole
from imocap_core.library.api_errors import Params, Progress, displaying, one_off, plain_errors
from imocap_core.library.cleaning import cache_limit_bytes, keep_cache_within_limit
from imocap_core.library.new_action import action_of_videos
from imocap_core.library.status import left_out_notes, upstream
from imocap_core.pipeline import runner
from imocap_core.pipeline.action import repeated_files
from imocap_core.pipeline.generation import LAST_RUN
from imocap_core.pipeline.runner import Display, Job, Outcome
from imocap_core.process import CPU, check_device
from imocap_core.version import __version__
from imocap_core.workers import cores
from imocap_core.workspace import Workspace

if TYPE_CHECKING:
    from imocap_core.artifacts.store import Stored
    from imocap_core.library.result import MotionStage, Result


MEMINFO, STATM, CGROUP = Path("/proc/meminfo"), Path("/proc/self/statm"), Path("/sys/fs/cgroup")
# Largest memory of all stages as measured (docs/scaling.md): of the program and its data, of every
# frame of every video, and of every frame whose motion is being fitted. The posterior takes less.
PROGRAM_BYTES, FRAME_BYTES, FIT_BYTES = 700e6, 50e3, 230e3


def memory_notice(frames: Sequence[int], available: int | None) -> str | None:
    """The sentence, or None where the memory suffices or is not known.

    Args:
        frames: of each video; available: bytes.
    """
    expected = expected_bytes(frames, cores())
    if not frames or available is None or expected <= available:
        return None
    total, longest = sum(frames), max(frames)
    return (
        f"about {expected / 1e9:.2f} GB of memory are expected to be needed ({len(frames)} videos, "
        f"{total:,} frames, {longest:,} in the longest), and {available / 1e9:.2f} GB are "
        "available: use fewer frames (`frames` of a video in action.yaml), films of a lower frame "
        "rate, or a machine with more memory"
    )


def frames_of(keypoints: Stored) -> list[int]:
    """Number of used frames of every video; none where a stage of another kind made the result."""
    if keypoints.schema != "Keypoints":
        return []
    from imocap_core.artifacts.schemas import Keypoints

    return [len(video.frames) for video in keypoints.decode(Keypoints).videos]


def expected_bytes(frames: Sequence[int], workers: int) -> int:
    """Largest memory of a run.

    Args:
        frames: of each video; workers: motions that are fitted at once where they are short.
    """
    from imocap_core.motion.gauss_newton import motions_at_once

    longest = max(frames, default=0)
    at_once = min(len(frames), workers, motions_at_once(longest))
    return int(PROGRAM_BYTES + FRAME_BYTES * sum(frames) + FIT_BYTES * at_once * longest)


def available_bytes() -> int | None:
    """Memory that this process may use, its own included; None where the system does not tell."""
    if sys.platform != "linux":
        with suppress(AttributeError, ValueError, OSError):
            return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
        return None
    import resource

    limits: list[int] = []
    with suppress(OSError, IndexError, ValueError):
        resident = int(STATM.read_text().split()[1]) * resource.getpagesize()
        free = re.search(r"MemAvailable:\s*(\d+) kB", MEMINFO.read_text())
        if free is not None:
            limits.append(1024 * int(free[1]) + resident)
    with suppress(OSError, ValueError):  # a container's; "max" where it has none
        limits.append(int((CGROUP / "memory.max").read_text()))
    most, _ = resource.getrlimit(resource.RLIMIT_DATA)
    if most != resource.RLIM_INFINITY:
        limits.append(most)
    return min(limits, default=None)


def _stored_in(outcomes: Sequence[Outcome]) -> dict[str, Stored]:
    """The results of a run by stage."""
    return {outcome.stage: outcome.stored for outcome in outcomes}


LARGE = ("initial_smpl", "sync", "smpl_ba", "refine_sync", "uncertainty")  # stages, in memory
FORMAT = 1  # rises when a field changes its meaning or goes
LIBRARIES = ("numpy", "scipy", "torch", "opencv-python-headless", "av", "mcap", "pydantic")


@dataclass
class RunLog:
    """What is known of a run while it goes on."""

    job: Job
    began: datetime = field(default_factory=lambda: datetime.now(UTC))
    outcomes: list[Outcome] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    verdict: Verdict | None = None
    library_warnings: list[str] = field(default_factory=list)

    def document(self, error: str | None) -> dict[str, Any]:
        """As plain data; error: the sentence that ended the run, or None."""
        ended = datetime.now(UTC)
        settings, verdict = self.job.settings, self.verdict
        sentences = left_out_notes(_stored_in(self.outcomes))
        if verdict is not None:
            sentences = [finding.sentence for finding in verdict.findings]
        return {
            "format": FORMAT,
            "action": self.job.action.name,
            "began": self.began.isoformat(timespec="seconds"),
            "seconds": round((ended - self.began).total_seconds(), 3),
            "status": "done" if error is None else "failed",
            "error": error,
            "stages": [
                {
                    "stage": outcome.stage,
                    "how": outcome.how,
                    "seconds": round(outcome.seconds, 3),
                    "peak_bytes": outcome.peak_bytes,
                    "key": outcome.stored.key,
                    "digest": outcome.stored.digest,
                }
                for outcome in self.outcomes
            ],
            "summary": [] if verdict is None else list(verdict.summary),
            "warnings": [*self.notes, *sentences, *self.library_warnings],
            "seed": settings.seed,
            "params": asdict(settings.params),
            "versions": versions(),
            "machine": f"{platform.system()} {platform.machine()}",
            "device": self.job.device,
        }


def versions() -> dict[str, str]:
    """Of the program, of Python, and of the libraries that results depend on."""
    by_name = {"imocap": __version__, "python": platform.python_version()}
    for name in LIBRARIES:
        with suppress(metadata.PackageNotFoundError):
            by_name[name] = metadata.version(name)
    return by_name


class LoggedDisplay:
    """A `Display` that also notes which stages have ended, and says when memory may not suffice."""

    def __init__(self, display: Display, log: RunLog) -> None:
        self._log, self._memory_known, self._display = log, False, display
        self.notice, self.made_demo = display.notice, display.made_demo
        self.waiting, self.progress = display.waiting, display.progress

    def started(self, stage: str, why: list[str]) -> None:
        """A stage begins; before the first that needs much memory, what it is expected to need."""
        self._display.started(stage, why)
        stored = {outcome.stage: outcome.stored for outcome in self._log.outcomes}
        if self._memory_known or stage not in LARGE or "keypoints" not in stored:
            return
        self._memory_known = True
        if sentence := memory_notice(frames_of(stored["keypoints"]), available_bytes()):
            self._log.notes.append(sentence)
            self.notice(sentence)

    def finished(self, outcome: Outcome) -> None:
        """A stage has its artifact."""
        self._log.outcomes.append(outcome)
        self._display.finished(outcome)


@contextmanager
def recording(job: Job, notes: Sequence[str]) -> Iterator[RunLog]:
    """A log that is written when the body ends, however it ends."""
    log = RunLog(job, notes=list(notes))
    error: str | None = None
    show = warnings.showwarning

    def shown(message: Warning | str, category: type[Warning], *place: Any, **more: Any) -> None:
        log.library_warnings.append(f"{category.__name__}: {message}")
        show(message, category, *place, **more)

    warnings.showwarning = shown
    try:
        yield log
    except (ImocapError, Stopped) as ended:
        error = str(ended)
        raise
    finally:
        warnings.showwarning = show
        with suppress(OSError):  # a store on a disk that can only be read
            text = json.dumps(log.document(error), indent=1, ensure_ascii=False, default=str)
            write_whole(job.store.folder / job.action.name / LAST_RUN, text + "\n")
        save_memory(job.store.folder)


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
    from imocap_core.result.artifacts import artifacts_of_stages
    from imocap_core.result.read import read_result

    if (action is None) == (videos is None):
        raise WrongUse("expected an action or videos=[...], one of them")
    check_device(device)
    if videos is not None:
        action, _ = action_of_videos(Path(root), name, [Path(video) for video in videos])
    assert action is not None
    motion_stage = _motion_stage(Workspace(Path(root)), until)
    done = run_action(
        action, root=root, params=params, force=force, until=until, device=device, progress=progress
    )
    artifacts = artifacts_of_stages(done.job.action.name, _stored_in(done.outcomes))
    return read_result(artifacts, Result, done.job.action.folder, motion_stage)


@plain_errors
def run_action(
    action: str | Path,
    *,
    root: str | Path = ".",
    params: Params = None,
    force: bool = False,
    until: str | None = None,
    device: str = CPU,
    progress: Progress = None,
    part_of_many: bool = False,
) -> Run:
    """Run every stage of an action that has changed, to its report; arguments as of `run`.

    part_of_many: whoever runs many actions keeps the cache within its limit, once.
    """
    from imocap_core.report.action_report import finish, verdict_of_run

    with displaying(progress) as display:
        began = time.perf_counter()
        cache_limit_bytes()  # a wrong one is noticed before the work
        workspace = Workspace(Path(root), device)
        sets = one_off(params)
        job, notes = workspace.ready_job(str(action), sets, display), list[str]()
        if any(video.repetitions for video in job.action.videos):
            from imocap_core.standalone_sync import job_in_parts  # PyTorch and more

            job, notes = job_in_parts(workspace, str(action), sets, display)
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
        notes = [*notes, *left_out_notes(_stored_in(outcomes))]
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
    return Run(job, outcomes, left_out_notes(_stored_in(outcomes)), time.perf_counter() - began)


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
