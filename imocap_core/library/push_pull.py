"""An action into a store that several machines share, and from it.

Nothing that the store says is trusted: paths lead into the action's folder (action_record.py), and
every file has the content that its record names.
"""

from __future__ import annotations

import json
import os
import shutil
import tempfile
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from imocap_core.artifacts.file_memory import files_below
from imocap_core.artifacts.shared_store import SharedFiles
from imocap_core.errors import ArtifactCorrupt, WorkFailed
from imocap_core.files import draft_folder
from imocap_core.library.api_errors import plain_errors
from imocap_core.library.shared_action import (
    ActionRecord,
    action_files,
    input_name,
    pack,
    portable_files,
    read_record,
    record_name,
    unpack,
    write_record,
)
from imocap_core.pipeline.action import FILE_NAME, check_name, read_action
from imocap_core.pipeline.graph import settings
from imocap_core.pipeline.runner import Job, Outcome
from imocap_core.pipeline.source import content_digest
from imocap_core.workspace import Workspace


@dataclass(frozen=True)
class PushedAction:
    """What a push did.

    new_files: those whose content the store did not have. results: stages whose current results
    are in the store now.
    """

    action: str
    files: list[str]
    new_files: list[str]
    results: list[str]


@plain_errors
def push(
    action: str | Path, *, store: str, root: str | Path = ".", replace: bool = False
) -> PushedAction:
    """Copy an action and its current results into a shared store; what is there stays.

    Files of videos that lie outside the action's folder are taken along into it: the action that is
    pulled has them in `videos`, `keypoints` or `initial`, and names them there.

    Args:
        action: its name below root/actions, or the path of its folder.
        store: URL or folder of the store.
        replace: where the store has another action of this name, or a damaged file.

    Raises:
        WrongUse: no such action.
        WorkFailed: the store cannot be used or has another action of this name, or a file of the
            action is missing or has no place on another machine.
    """
    workspace = Workspace(Path(root), store)
    job = workspace.job(str(action), [])
    shared = job.store.shared
    assert shared is not None
    name = job.action.name
    with tempfile.TemporaryDirectory() as aside:
        paths = portable_files(job.action, job.settings, Path(aside))
        digests = {path: content_digest(file) for path, file in paths.items()}
        before = None if replace else read_record(shared, record_name(name))
        if before is not None and before.files != digests:
            differing = {*before.files.items()} ^ {*digests.items()}
            raise WorkFailed(
                f"{shared.url} has an action {name} of other content ({min(differing)[0]}); push "
                "it with --replace, or under another name"
            )
        new = push_files(shared, paths, digests, replace=replace)
    results = _push_results(job)
    write_record(shared, record_name(name), ActionRecord(name=name, files=digests, results=results))
    return PushedAction(name, list(digests), new, list(results))


def push_files(
    shared: SharedFiles,
    paths: Mapping[str, Path],
    digests: Mapping[str, str],
    *,
    replace: bool = False,
) -> list[str]:
    """Publish files by their content; those that were not there."""
    new = []
    for path, digest in digests.items():
        if not replace and shared.has(input_name(digest)):
            continue
        if path.endswith("/"):
            with tempfile.TemporaryDirectory() as folder:
                archive = Path(folder) / "folder.zip"
                pack(paths[path], archive)
                shared.publish(archive, input_name(digest))
        else:
            shared.publish(paths[path], input_name(digest))
        if content_digest(paths[path]) != digest:
            raise WorkFailed(f"{paths[path]} was changed while it was copied; push it again")
        new.append(path)
    return new


def _push_results(job: Job) -> dict[str, str]:
    """Publish the current results and detections; stage -> key."""
    from imocap_core.detect.detection import share_detections

    share_detections(job.store, job.action.detected.values())
    results = {}
    for stage in job.pipeline.stages:
        try:
            stored = job.store.load(job.action.name, stage)
        except ArtifactCorrupt:
            continue
        if stored is not None:
            job.store.share(stage, stored, made=False)
            results[stage] = stored.key
    return results


PULLED = ".pulled.json"  # in the action's folder: the files as they came


@dataclass(frozen=True)
class Pulled:
    """What a pull did.

    folder: of the action; new: it was made or brought up to date. results: stages whose results
    are the current ones now. missing: stages whose results the store should have, and has not.
    """

    action: str
    folder: Path
    new: bool
    results: list[str]
    missing: list[str]


@plain_errors
def pull(action: str, *, store: str, root: str | Path = ".") -> Pulled:
    """Copy an action and its results from a shared store: root/actions/NAME, root/artifacts/NAME.

    Args:
        action: the name under which it was pushed.
        store: URL or folder of the store.

    Raises:
        WorkFailed: the store has no such action or cannot be used, a file in it is damaged, or
            root/actions/NAME exists and is another one.
    """
    check_name(action)
    workspace = Workspace(Path(root), store)
    shared = workspace.store.shared
    assert shared is not None
    record = read_record(shared, record_name(action))
    if record is None:
        raise WorkFailed(f"{shared.url} has no action {action}; push it there from where it is")
    if record.name != action:
        raise WorkFailed(f"{shared.url}: the record of {action} is of {record.name}")
    new = bring_up_to_date(workspace, shared, record)
    results, missing = _pull_results(workspace, record)
    return Pulled(action, workspace.root / "actions" / action, new, results, missing)


def bring_up_to_date(workspace: Workspace, shared: SharedFiles, record: ActionRecord) -> bool:
    """Make an action's folder have the files of a record; whether anything was written.

    WorkFailed when the folder has other content that was not pulled, or was changed since.
    """
    folder = workspace.root / "actions" / record.name
    if _differing(folder, record.files) is None or _is_pushed(workspace, folder, record):
        return False
    with workspace.store.lock(record.name, lambda: None):
        different = _differing(folder, record.files)
        if different is None:
            return False
        if folder.exists() and (folder.is_symlink() or _changed_since_pulled(folder)):
            raise WorkFailed(
                f"{folder} exists and is not the action {record.name} of {shared.url} "
                f"({different} differs); it stays as it is. Move it away to have that one"
            )
        with draft_folder(folder.parent, "pull") as draft:
            fresh, old = draft / "new", draft / "old"
            fresh.mkdir()
            for path, digest in record.files.items():
                _fetch(shared, path, digest, draft, fresh)
            _must_be_usable(workspace, fresh, record)
            (fresh / PULLED).write_text(json.dumps({"files": record.files}, indent=1) + "\n")
            if folder.exists():
                os.replace(folder, old)
            os.replace(fresh, folder)
    return True


def _is_pushed(workspace: Workspace, folder: Path, record: ActionRecord) -> bool:
    """Whether a folder, whose videos may lie elsewhere, is the action that a push makes a record
    of."""
    if folder.is_symlink():
        return False
    with suppress(WorkFailed, OSError), tempfile.TemporaryDirectory() as aside:
        declared = read_action(folder)
        chosen = settings(workspace.pipeline(), declared.params, declared.file, [])
        files = portable_files(declared, chosen, Path(aside))
        return {path: content_digest(file) for path, file in files.items()} == record.files
    return False


def _fetch(shared: SharedFiles, path: str, digest: str, draft: Path, fresh: Path) -> None:
    """Write a file or folder of a record below `fresh`."""
    name, target, copy = input_name(digest), fresh / path, draft / "copy"
    is_folder = path.endswith("/")
    if not shared.fetch(name, copy):
        raise WorkFailed(f"{shared.url} has not {name}, which is {path}; push the action again")
    target.parent.mkdir(parents=True, exist_ok=True)
    try:
        if is_folder:
            target.mkdir(exist_ok=True)
            unpack(copy, target)
        else:
            shutil.move(copy, target)
    except ValueError as error:
        raise WorkFailed(f"{shared.url}/{name}, which is {path}: {error}") from None
    if content_digest(target) != digest:
        raise WorkFailed(
            f"{shared.url}/{name}, which is {path}, is damaged; push the action again with "
            "--replace from where it is whole"
        )


def _must_be_usable(workspace: Workspace, fresh: Path, record: ActionRecord) -> None:
    """WorkFailed unless action.yaml is of this name and names files of its folder only."""
    from imocap_core.io.video import open_video

    try:
        declared = read_action(fresh)
        chosen = settings(workspace.pipeline(), declared.params, declared.file, [])
        action_files(declared, chosen)
        for file in {fresh / video.video for video in declared.videos if video.video is not None}:
            if file.is_file():
                open_video(file).close()  # no playlist, which names files elsewhere
    except (WorkFailed, ValueError) as error:
        text = str(error).replace(str(fresh.resolve()), record.name)
        raise WorkFailed(f"the action that was pushed cannot be used: {text}") from None
    if declared.name != record.name:
        raise WorkFailed(f"{FILE_NAME} of {record.name} is of {declared.name}; it is not used")


def _pull_results(workspace: Workspace, record: ActionRecord) -> tuple[list[str], list[str]]:
    """Make the results of a record the current ones; the stages, and those that are not there."""
    from imocap_core.report.action_report import finish

    job = workspace.job(record.name, [])
    outcomes: list[Outcome] = []
    wanted = [stage for stage in job.pipeline.stages if stage in record.results]
    with job.store.lock(record.name, lambda: None):
        for stage in wanted:
            stored = job.store.find(record.name, stage, record.results[stage])
            if stored is not None:
                job.store.publish(record.name, stage, stored)
                outcomes.append(Outcome(stage, "cached", stored, 0.0))
        finish(job, outcomes)
    results = [outcome.stage for outcome in outcomes]
    return results, [stage for stage in wanted if stage not in results]


def _differing(folder: Path, files: dict[str, str]) -> str | None:
    """The first of these files that a folder has not; None when it has all."""
    for path, digest in files.items():
        file = folder / path
        is_kind = file.is_dir() if path.endswith("/") else file.is_file()
        if not is_kind or content_digest(file) != digest:
            return path
    return None


def _changed_since_pulled(folder: Path) -> bool:
    """Whether a folder has other content than what was pulled into it."""
    with suppress(OSError, ValueError, LookupError, TypeError, AttributeError, RecursionError):
        pulled = json.loads((folder / PULLED).read_text(encoding="utf-8"))["files"]
        folders = tuple(path for path in pulled if path.endswith("/"))
        added = [
            name
            for name in files_below(folder)
            if name != PULLED and name not in pulled and not name.startswith(folders)
        ]
        return bool(added) or _differing(folder, pulled) is not None
    return True
