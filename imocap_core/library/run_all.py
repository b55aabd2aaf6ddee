"""Running many actions: on one core, on several, or on a cluster.

The tasks of actions: (action, video) for detection, (action, stage, video) for a stage whose result
has a part for each video, (action, stage) for all. Stages of one action come after one another,
actions do not. Of what may begin, the action named first goes on, so that finished actions come
early.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from imocap_core.errors import ImocapError, WrongUse
from imocap_core.executors.tasks import Executor, Report, Serial, Task, TaskEnd, Watch, perform
from imocap_core.library.api_errors import FunctionDisplay, Params, one_off, plain_errors
from imocap_core.library.cleaning import keep_cache_within_limit
from imocap_core.library.running import run_action
from imocap_core.pipeline import builtin_actions
from imocap_core.pipeline.runner import make_part
from imocap_core.process import CPU, check_device
from imocap_core.workers import cores
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


Sets = tuple[str, ...]


def _tasks_of(workspace: Workspace, action: str, sets: Sequence[str], priority: int) -> list[Task]:
    """The tasks that bring an action to its report, each after those before it; a stage after its
    parts.

    ImocapError when its action.yaml cannot be used.
    """
    tasks: list[Task] = []
    after: tuple[str, ...] = ()

    def add(work: Callable[..., Any], steps: Mapping[str, tuple[Any, ...]]) -> None:
        nonlocal after
        common = (workspace, action, tuple(sets))
        each = [
            Task(f"{action}: {step}", work, (*common, *more), after, priority)
            for step, more in steps.items()
        ]
        tasks.extend(each)
        after = tuple(task.name for task in each) or after

    videos: list[str] = []
    if action in builtin_actions.BUILT_IN:
        add(_make_built_in, {"demo": ()})
    else:
        declared = workspace.job(action, list(sets)).action.videos
        if any(video.repetitions for video in declared):  # its parts are known only later
            add(_run_to, {WHOLE: (None,)})
            return tasks
        add(_detect_video, {f"detect {v.id}": (v.id,) for v in declared if v.detected})
        videos = [video.id for video in declared]
    stages = workspace.pipeline().stages
    for stage, spec in stages.items():
        if spec.parts == "videos" and len(videos) > 1:  # of a single video, the part is the whole
            add(_make_part, {f"{stage} {video}": (stage, video) for video in videos})
        add(_run_to, {stage: (None if stage == list(stages)[-1] else stage,)})
    return tasks


def _display(report: Report) -> FunctionDisplay:
    return FunctionDisplay(lambda stage, share, text: report(share, text))


def _make_built_in(report: Report, workspace: Workspace, action: str, sets: Sets) -> None:
    """Make a built-in action, unless it is there."""
    display = _display(report)
    with workspace.store.lock(action, display.waiting):
        folder = workspace.root / "actions" / action
        builtin_actions.ensure(action, folder, workspace.pipeline().seed, display)


def _detect_video(
    report: Report, workspace: Workspace, action: str, sets: Sets, video: str
) -> None:
    """Detect the people in one video, unless that was done."""
    from imocap_core.detect.detected_action import detect_one

    job = workspace.job(action, list(sets))
    detect_one(job.action, video, job.settings.params.detect, job.store, _display(report))


@plain_errors
def _make_part(
    report: Report, workspace: Workspace, action: str, sets: Sets, stage: str, video: str
) -> None:
    """Make the part of a stage's result that belongs to a video, unless it is cached."""
    display = _display(report)
    make_part(workspace.ready_job(action, list(sets), display), stage, video, display)


def _run_to(
    report: Report, workspace: Workspace, action: str, sets: Sets, until: str | None
) -> StageEnd:
    """Bring an action up to date to a stage (None: to its report); earlier ones are cached."""
    done = run_action(
        action,
        root=workspace.root,
        params=list(sets),
        until=until,
        device=workspace.device,
        progress=_display(report),
        part_of_many=True,
    )
    last = done.outcomes[-1]
    summary = () if done.verdict is None or until is not None else tuple(done.verdict.summary)
    notes = () if until is not None else tuple(done.notes)
    return StageEnd(last.stage, last.how, last.seconds, last.stored.digest, notes, summary)


NAMES = ("serial", "processes", "dask")


@dataclass(frozen=True)
class ExecutorChoice:
    """Where tasks run.

    name: serial, processes or dask. workers: processes on this machine; None for one a core.
    address: of a Dask scheduler, instead of a cluster on this machine. retries: further attempts at
    a task whose worker died.
    """

    name: str = "processes"
    workers: int | None = None
    address: str | None = None
    retries: int = 1


@dataclass(frozen=True)
class ActionEnd:
    """How an action ended.

    fault: the sentence of the task that failed, with its name. seconds: of its tasks together.
    """

    action: str
    state: Literal["done", "failed"]
    fault: str = ""
    seconds: float = 0.0
    attempts: int = 0
    stages: tuple[StageEnd, ...] = ()


@dataclass
class Listener:
    """What is told of a run of many actions while it goes on.

    planned: called with the number of tasks of each action. task_ended, action_ended: as they end.
    """

    planned: Callable[[dict[str, int]], None] = lambda counts: None
    watch: Watch = lambda event: None
    task_ended: Callable[[str, TaskEnd], None] = lambda action, end: None
    action_ended: Callable[[ActionEnd], None] = lambda end: None
    announce: Callable[[str], None] = lambda text: None


@plain_errors
def run_all(
    actions: Sequence[str | Path] | None = None,
    *,
    root: str | Path = ".",
    params: Params = None,
    executor: ExecutorChoice | str = "processes",
    device: str = CPU,
    listener: Listener | None = None,
) -> list[ActionEnd]:
    """Run actions to their reports, several at once; those named first end first.

    One that fails stops no other.

    Args:
        actions: names below root/actions, paths, or built-in ones; None for all below
            root/actions.
        root: the working folder; with an address, one that every worker of the cluster
            has under this path.
        params: one-off parameters of all of them.
        device: where every worker computes tensors; cpu, cuda, or one of several as cuda:1.

    Returns:
        One end for each action, in their order.
    """
    workspace = Workspace(Path(root).resolve(), device)
    names = _all_actions(workspace) if actions is None else [str(action) for action in actions]
    repeated = sorted({name for name in names if names.count(name) > 1})
    if repeated:
        raise WrongUse(f"expected every action once, got {', '.join(repeated)} twice")
    choice = ExecutorChoice(executor) if isinstance(executor, str) else executor
    check_choice(choice)
    if choice.address is None:
        check_device(device)
    listener = listener or Listener()
    planned, ends = _planned(workspace, names, one_off(params))
    listener.planned({name: len(tasks) for name, tasks in planned.items()})
    for end in ends.values():
        listener.action_ended(end)
    with executing(choice, listener) as chosen:
        for end in _carried_out(planned, chosen, choice.retries, listener):
            ends[end.action] = end
            listener.action_ended(end)
    for sentence in keep_cache_within_limit(workspace.root):
        listener.announce(sentence)
    return [ends[name] for name in names]


def _all_actions(workspace: Workspace) -> list[str]:
    """The actions below root/actions, by name; WrongUse when there is none."""
    folder = workspace.root / "actions"
    names = sorted(file.parent.name for file in folder.glob("*/action.yaml"))
    if not names:
        raise WrongUse(
            f"no action exists below {folder}. Make one with: imocap init NAME VIDEO..., or name "
            "a built-in one: yoga, taichi"
        )
    return names


def check_choice(choice: ExecutorChoice) -> None:
    """WrongUse when the parts of a choice do not fit one another or this machine."""
    if choice.name not in NAMES:
        raise WrongUse(f"executor: expected one of {', '.join(NAMES)}, got {choice.name!r}")
    if choice.workers is not None and choice.workers < 1:
        raise WrongUse(f"workers: expected 1 or more, got {choice.workers}")
    if choice.retries < 0:
        raise WrongUse(f"retries: expected 0 or more, got {choice.retries}")
    if choice.address is not None and choice.name != "dask":
        raise WrongUse(f"an address is of a Dask scheduler, and the executor is {choice.name}")
    if choice.address is not None and choice.workers:
        raise WrongUse(
            f"the workers of the cluster at {choice.address} are those that it was "
            "started with; leave their number out"
        )


@contextmanager
def executing(choice: ExecutorChoice, listener: Listener) -> Iterator[Executor]:
    """The executor of a choice."""
    workers = choice.workers or cores()
    if choice.name == "serial":
        yield Serial()
    elif choice.name == "processes":
        from imocap_core.executors.processes import worker_processes

        with worker_processes(workers) as processes:
            yield processes
    else:
        from imocap_core.executors.processes import dask_cluster

        with dask_cluster(workers, choice.address, announce=listener.announce) as cluster:
            yield cluster


def _planned(
    workspace: Workspace, names: Sequence[str], sets: list[str]
) -> tuple[dict[str, list[Task]], dict[str, ActionEnd]]:
    """The tasks of each action, and the ends of those that cannot begin."""
    planned: dict[str, list[Task]] = {}
    ends: dict[str, ActionEnd] = {}
    for priority, name in enumerate(names):
        try:
            planned[name] = _tasks_of(workspace, name, sets, priority)
        except ImocapError as error:
            ends[name] = ActionEnd(name, "failed", str(error))
    return planned, ends


def _carried_out(
    planned: dict[str, list[Task]], executor: Executor, retries: int, listener: Listener
) -> Iterator[ActionEnd]:
    """The ends of the actions, as they end."""
    owner = {task.name: name for name, tasks in planned.items() for task in tasks}
    ended: dict[str, list[TaskEnd]] = {name: [] for name in planned}
    every = [task for tasks in planned.values() for task in tasks]
    for end in perform(every, executor, listener.watch, retries=retries):
        action = owner[end.task.name]
        listener.task_ended(action, end)
        ended[action].append(end)
        if len(ended[action]) == len(planned[action]):
            yield _end_of(action, ended[action])


def _end_of(action: str, ends: Sequence[TaskEnd]) -> ActionEnd:
    """The end of an action of which all tasks have ended."""
    seconds, attempts = sum(end.seconds for end in ends), sum(end.attempts for end in ends)
    stages = tuple(end.result for end in ends if isinstance(end.result, StageEnd))
    fault = ""
    for end in ends:
        if end.state == "failed":
            step = end.task.name.removeprefix(f"{action}: ")
            fault = end.fault if end.fault.startswith(step) else f"{step}: {end.fault}"
    return ActionEnd(action, "failed" if fault else "done", fault, seconds, attempts, stages)
