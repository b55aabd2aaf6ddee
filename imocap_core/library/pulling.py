"""An action from a store that several machines share, into a working folder.

Nothing that the store says is trusted: paths lead into the action's folder (action_record.py), and
every file has the content that its record names.
"""

from __future__ import annotations

import json
import os
import shutil
import tempfile
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from imocap_core.artifacts.file_memory import files_below
from imocap_core.artifacts.shared import SharedFiles
from imocap_core.errors import WorkFailed
from imocap_core.library.action_files import action_files, portable_files
from imocap_core.library.action_record import ActionRecord, input_name, read_record, record_name
from imocap_core.library.door import plain_errors
from imocap_core.library.folder_archive import unpack
from imocap_core.pipeline.action import FILE_NAME, check_name, read_action
from imocap_core.pipeline.content import content_digest
from imocap_core.pipeline.graph import settings
from imocap_core.pipeline.runner import Outcome
from imocap_core.whole_files import draft_folder
from imocap_core.workspace import Workspace

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
