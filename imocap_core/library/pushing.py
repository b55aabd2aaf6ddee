"""An action into a store that several machines share: its files, its results, and their record."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from imocap_core.artifacts.shared import SharedFiles
from imocap_core.errors import ArtifactCorrupt, WorkFailed
from imocap_core.library.action_files import portable_files
from imocap_core.library.action_record import (
    ActionRecord,
    input_name,
    read_record,
    record_name,
    write_record,
)
from imocap_core.library.door import plain_errors
from imocap_core.library.folder_archive import pack
from imocap_core.pipeline.content import content_digest
from imocap_core.pipeline.runner import Job
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
            raise WorkFailed(_refusal(shared, name, before.files, digests))
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


def _refusal(
    shared: SharedFiles, name: str, before: Mapping[str, str], now: Mapping[str, str]
) -> str:
    differing = sorted(p for p in {*before, *now} if before.get(p) != now.get(p))
    return (
        f"{shared.url} has an action {name} of other content ({differing[0]}); push it with "
        "--replace, or under another name"
    )
