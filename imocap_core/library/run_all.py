"""Running many actions: on one core, on several, or on a cluster."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

from imocap_core.artifacts.open_shared import absolute_url
from imocap_core.errors import ImocapError, WrongUse
from imocap_core.executors.perform import perform
from imocap_core.executors.task import Executor, Task, TaskEnd, Watch
from imocap_core.library.action_tasks import StageEnd, tasks_of
from imocap_core.library.cache_limit import keep_cache_within_limit
from imocap_core.library.door import plain_errors
from imocap_core.library.one_off import Params, one_off
from imocap_core.library.running import run_action
from imocap_core.library.worker_folders import shared_tasks_of
from imocap_core.memory_limit import can_limit_memory
from imocap_core.pipeline.device import CPU, check_device
from imocap_core.workers import cores
from imocap_core.workspace import Workspace

NAMES = ("serial", "processes", "dask")


@dataclass(frozen=True)
class ExecutorChoice:
    """Where tasks run.

    name: serial, processes or dask. workers: processes on this machine; None for one a core.
    address: of a Dask scheduler, instead of a cluster on this machine. memory_bytes: largest memory
    of a worker. retries: further attempts at a task whose worker died.
    """

    name: str = "processes"
    workers: int | None = None
    address: str | None = None
    memory_bytes: int | None = None
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


@dataclass
class _Progress:
    left: int
    end: ActionEnd
    stages: list[StageEnd] = field(default_factory=list)


@plain_errors
def run_all(
    actions: Sequence[str | Path] | None = None,
    *,
    root: str | Path = ".",
    params: Params = None,
    executor: ExecutorChoice | str = "processes",
    store: str | None = None,
    device: str = CPU,
    listener: Listener | None = None,
) -> list[ActionEnd]:
    """Run actions to their reports, several at once; those named first end first.

    One that fails stops no other.

    Args:
        actions: names below root/actions, paths, or built-in ones; None for all below
            root/actions.
        root: the working folder; with an address and no store, one that every worker of the cluster
            has under this path.
        params: one-off parameters of all of them.
        store: URL or folder of a store that several machines share. With an address each worker
            works in a folder of its own, and has the actions and the results of others from there.
        device: where every worker computes tensors; cpu, cuda, or one of several as cuda:1.

    Returns:
        One end for each action, in their order.
    """
    shared = None if store is None else absolute_url(store)
    workspace = Workspace(Path(root).resolve(), shared, device)
    names = all_actions(workspace) if actions is None else [str(action) for action in actions]
    repeated = sorted({name for name in names if names.count(name) > 1})
    if repeated:
        raise WrongUse(f"expected every action once, got {', '.join(repeated)} twice")
    choice = ExecutorChoice(executor) if isinstance(executor, str) else executor
    check_choice(choice)
    if choice.address is None:
        check_device(device)
    listener = listener or Listener()
    apart = shared is not None and choice.address is not None
    planned, ends = _planned(
        workspace, names, one_off(params), shared_tasks_of if apart else tasks_of
    )
    listener.planned({name: len(tasks) for name, tasks in planned.items()})
    for end in ends.values():
        listener.action_ended(end)
    with executing(choice, listener) as chosen:
        for end in _carried_out(planned, chosen, choice.retries, listener):
            if apart and end.state == "done":
                end = _fetched(workspace, end, one_off(params))
            ends[end.action] = end
            listener.action_ended(end)
    for sentence in keep_cache_within_limit(workspace.root):
        listener.announce(sentence)
    return [ends[name] for name in names]


def all_actions(workspace: Workspace) -> list[str]:
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
    if choice.address is not None and (choice.workers or choice.memory_bytes):
        raise WrongUse(
            f"workers and memory of the cluster at {choice.address} are those that it was "
            "started with; leave them out"
        )
    if choice.memory_bytes is not None and choice.name == "serial":
        raise WrongUse("a limit of memory is of a worker, and the executor serial has none")
    if choice.memory_bytes is not None and choice.name == "processes" and not can_limit_memory():
        raise WrongUse("only on Linux can a worker's memory be limited; leave the limit out")


@contextmanager
def executing(choice: ExecutorChoice, listener: Listener) -> Iterator[Executor]:
    """The executor of a choice."""
    workers = choice.workers or cores()
    if choice.name == "serial":
        from imocap_core.executors.serial import Serial

        yield Serial()
    elif choice.name == "processes":
        from imocap_core.executors.processes import worker_processes

        with worker_processes(workers, memory_bytes=choice.memory_bytes) as processes:
            yield processes
    else:
        from imocap_core.executors.cluster import dask_cluster

        with dask_cluster(
            workers, choice.address, memory_bytes=choice.memory_bytes, announce=listener.announce
        ) as cluster:
            yield cluster


def _planned(
    workspace: Workspace,
    names: Sequence[str],
    sets: list[str],
    tasks: Callable[[Workspace, str, Sequence[str], int], list[Task]],
) -> tuple[dict[str, list[Task]], dict[str, ActionEnd]]:
    """The tasks of each action, and the ends of those that cannot begin."""
    planned: dict[str, list[Task]] = {}
    ends: dict[str, ActionEnd] = {}
    for priority, name in enumerate(names):
        try:
            planned[name] = tasks(workspace, name, sets, priority)
        except ImocapError as error:
            ends[name] = ActionEnd(name, "failed", str(error))
    return planned, ends


def _fetched(workspace: Workspace, end: ActionEnd, sets: list[str]) -> ActionEnd:
    """The end of an action after its results were copied from the shared store."""
    try:
        run_action(
            end.action,
            root=workspace.root,
            params=sets,
            store=workspace.shared,
            part_of_many=True,
        )
    except ImocapError as error:
        return replace(end, state="failed", fault=f"fetching its results: {error}")
    return end


def _carried_out(
    planned: dict[str, list[Task]], executor: Executor, retries: int, listener: Listener
) -> Iterator[ActionEnd]:
    """The ends of the actions, as they end."""
    owner = {task.name: name for name, tasks in planned.items() for task in tasks}
    running = {n: _Progress(len(tasks), ActionEnd(n, "done")) for n, tasks in planned.items()}
    every = [task for tasks in planned.values() for task in tasks]
    for end in perform(every, executor, listener.watch, retries=retries):
        action = owner[end.task.name]
        listener.task_ended(action, end)
        progress = running[action]
        progress.left -= 1
        progress.end = replace(
            progress.end,
            seconds=progress.end.seconds + end.seconds,
            attempts=progress.end.attempts + end.attempts,
        )
        if isinstance(end.result, StageEnd):
            progress.stages.append(end.result)
        if end.state == "failed":
            step = end.task.name.removeprefix(f"{action}: ")
            fault = end.fault if end.fault.startswith(step) else f"{step}: {end.fault}"
            progress.end = replace(progress.end, state="failed", fault=fault)
        if progress.left == 0:
            yield replace(progress.end, stages=tuple(progress.stages))
