"""Tasks on workers with folders of their own.

Each fetches the action, and what others have made of it, from the store that all share, and
publishes what it makes.
"""

from __future__ import annotations

import hashlib
import json
import os
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from imocap_core.errors import WorkFailed
from imocap_core.executors.task import Report, Task
from imocap_core.library.action_files import portable_files
from imocap_core.library.action_record import (
    ActionRecord,
    input_name,
    read_record,
    write_record,
)
from imocap_core.library.action_tasks import make_built_in, tasks_of
from imocap_core.library.pulling import bring_up_to_date
from imocap_core.library.pushing import push_files
from imocap_core.pipeline.builtin_actions import BUILT_IN
from imocap_core.pipeline.content import content_digest
from imocap_core.pipeline.graph import Pipeline
from imocap_core.pipeline.source import closure
from imocap_core.workspace import Workspace

VARIABLE = "IMOCAP_ROOT"


@dataclass(frozen=True)
class SharedAction:
    """An action as its tasks find it in the shared store.

    record: name of its record there, which says its content. code: digest of the stages' code,
    inputs and parameters, which must be the worker's too.
    """

    url: str
    name: str
    record: str
    code: str


def shared_tasks_of(
    workspace: Workspace, action: str, sets: Sequence[str], priority: int
) -> list[Task]:
    """Push an action's files; its tasks, for workers that have nothing of it.

    ImocapError when its action.yaml, or the store, cannot be used.
    """
    built_in = action in BUILT_IN
    if built_in:
        make_built_in(lambda share, text: None, workspace.root, action)
    job = workspace.job(action, list(sets))
    shared = job.store.shared
    assert shared is not None
    with tempfile.TemporaryDirectory() as aside:
        paths = portable_files(job.action, job.settings, Path(aside))
        digests = {path: content_digest(file) for path, file in paths.items()}
        push_files(shared, paths, digests)
    record = ActionRecord(name=job.action.name, files=digests)
    name = input_name(hashlib.sha256(record.model_dump_json().encode()).hexdigest())
    if not shared.has(name):
        write_record(shared, name, record)
    place = SharedAction(shared.url, job.action.name, name, code_digest(job.pipeline))
    tasks = tasks_of(workspace, action, sets, priority)
    made = [task.name for task in tasks if task.work is make_built_in]
    return [
        replace(
            task,
            work=in_worker_folder,
            arguments=(place, task.work, *task.arguments[2:]),
            after=tuple(name for name in task.after if name not in made),
        )
        for task in tasks
        if task.name not in made
    ]


def in_worker_folder(report: Report, place: SharedAction, work: Any, *arguments: Any) -> Any:
    """Do the work of a task, `work(report, root, action, *arguments)`, in this worker's folder."""
    root = worker_root()
    workspace = Workspace(root, place.url)
    shared = workspace.store.shared
    assert shared is not None
    if code_digest(workspace.pipeline()) != place.code:
        raise WorkFailed(
            f"the worker in {root} has another version of imocap, or another pipeline.yaml; all "
            "workers need those of the machine that the command runs on"
        )
    record = read_record(shared, place.record)
    if record is None or record.name != place.name:
        raise WorkFailed(f"{place.url} has no {place.record} any more; run again")
    report(0.0, f"fetching {place.name}")
    bring_up_to_date(workspace, shared, record)
    return work(report, root, place.name, *arguments)


def worker_root() -> Path:
    """This worker's working folder: IMOCAP_ROOT, or one in the user's cache; it is made."""
    cache = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    root = Path(os.environ.get(VARIABLE) or Path(cache) / "imocap" / "worker").absolute()
    root.mkdir(parents=True, exist_ok=True)
    return root


def code_digest(pipeline: Pipeline) -> str:
    """Digest of what results depend on beside the action: code, graph, seed and parameters."""
    parts: list[Any] = [pipeline.seed]
    parts += [
        [name, spec.model_dump(mode="json"), closure(pipeline.script(name))]
        for name, spec in pipeline.stages.items()
    ]
    text = json.dumps(parts, sort_keys=True)
    return hashlib.sha256(f"{text}{pipeline.params}".encode()).hexdigest()
