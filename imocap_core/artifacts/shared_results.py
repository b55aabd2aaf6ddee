"""Results in a shared store: read and checked before they enter the cache of this machine.

A result that is there twice under one key should be the same; the first one counts.
"""

from __future__ import annotations

import logging
from pathlib import Path
from typing import TYPE_CHECKING

from imocap_core.artifacts.shared import SharedFiles
from imocap_core.errors import ArtifactCorrupt
from imocap_core.whole_files import draft_folder, draft_of, publish_once

if TYPE_CHECKING:
    from imocap_core.artifacts.codec import Content

RESULTS = "results"
KEY = "key"  # of the provenance
DRAFT = "shared"  # cache.py sweeps what killed runs leave
LOG = logging.getLogger("imocap")


def fetch_artifact(shared: SharedFiles, stage: str, key: str, file: Path) -> Content | None:
    """Copy a stage's result into the cache, as `file`; its content.

    None when there is none, or none that can be read back and was made under this key.
    """
    try:
        with draft_of(file) as draft:
            if not shared.fetch(_name(stage, f"{key}.mcap"), draft):
                raise ArtifactCorrupt("there is none")
            return _checked(draft, key)
    except ArtifactCorrupt:
        return None


def share_artifact(
    shared: SharedFiles, stage: str, key: str, file: Path, digest: str
) -> Content | None:
    """Publish a result that was just made, unless there is one of its key.

    Returns the content of that one where it is another; it has taken the place of `file` then.
    """
    name = _name(stage, f"{key}.mcap")
    if shared.has(name):
        with draft_folder(file.parent, DRAFT) as folder:
            theirs = fetch_artifact(shared, stage, key, folder / file.name)
        if theirs is not None and theirs.digest == digest:
            return None
        if theirs is not None:
            LOG.warning(
                "%s: two results under the key %s differ (%s here, %s in %s): this stage is not "
                "reproducible on these machines; the one in the store is used",
                *(stage, key[:12], digest[:12], theirs.digest[:12], shared.url),
            )
            return fetch_artifact(shared, stage, key, file)
    shared.publish(file, name)
    return None


def share_file(shared: SharedFiles, stage: str, file: Path) -> None:
    """Publish a file of the cache, unless there is one of its name."""
    if not shared.has(_name(stage, file.name)):
        shared.publish(file, _name(stage, file.name))


def fetch_detections(shared: SharedFiles, file: Path) -> bool:
    """Copy the detections of a video into the cache; False when there are none that can be read.

    Another run may fetch them meanwhile: the first file stays.
    """
    from imocap_core.io.npz import load_arrays

    with draft_folder(file.parent, DRAFT) as folder:
        draft = folder / file.name
        if not shared.fetch(_name(file.parent.name, file.name), draft):
            return False
        try:
            load_arrays(draft)
        except ValueError:
            return False
        publish_once(draft, file)
    return True


def _name(stage: str, file_name: str) -> str:
    return f"{RESULTS}/{stage}/{file_name}"


def _checked(file: Path, key: str) -> Content:
    from imocap_core.artifacts import codec

    content = codec.read(file)
    if content.provenance.get(KEY) != key:
        raise ArtifactCorrupt(f"{file}: was made under another key")
    return content
