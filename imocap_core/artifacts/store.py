"""Where artifacts are stored: the current one of each stage, and every older one by its key.

    artifacts/
      <action>/<stage>.mcap      the current artifact
      <action>/report/           the side files of the stage that made some
      .cache/<stage>/<key>.mcap  every result, so that going back to old parameters costs nothing
      .cache/.used/<action>      the results that an action has used (cache.py)
      .cache/files.json          digests of files that have not changed (file_memory.py)

Files appear whole or not at all (written aside, synced, renamed); the current artifact is a hard
link to its cached one where the file system has links.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, suppress
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from imocap_core.artifacts.cache import CACHE, REPORT, mark_used
from imocap_core.artifacts.file_memory import remembered
from imocap_core.artifacts.links import refuse_links
from imocap_core.artifacts.lock import exclusive
from imocap_core.artifacts.shared_results import KEY, fetch_artifact, share_artifact, share_file
from imocap_core.artifacts.side_files import check_names, has_files, replace_folder
from imocap_core.errors import ArtifactCorrupt
from imocap_core.whole_files import appearing

if TYPE_CHECKING:  # numpy, MCAP and protobuf are imported only where an artifact is read
    from imocap_core.artifacts.codec import Content
    from imocap_core.artifacts.schemas.base import Artifact
    from imocap_core.artifacts.shared import SharedFiles

Kind = TypeVar("Kind", bound="Artifact")
HEAD = ("schema", "digest", "key", "has_files")  # what is remembered of an artifact


@dataclass(frozen=True)
class Stored:
    """An artifact in the store.

    schema: its class name; digest: of what it contains (not of the file); key: the stage key that
    it was made under; has_files: whether side files come with it.
    """

    file: Path
    schema: str
    digest: str
    key: str
    has_files: bool
    _content: Content | None = None

    @cached_property
    def content(self) -> Content:
        """What the file contains, every byte checked, not yet validated by its schema.

        ArtifactCorrupt when it can't be read back, or contains something else by now.
        """
        from imocap_core.artifacts import codec

        if self._content is not None:
            return self._content
        content = codec.read(self.file)
        if content.digest != self.digest:
            raise ArtifactCorrupt(
                f"{self.file}: expected the result {self.digest[:12]}, got {content.digest[:12]}; "
                "it was replaced meanwhile; run again"
            )
        return content

    def read(self) -> Stored:
        """The same with its content, read now where it has not been. ArtifactCorrupt as above."""
        return replace(self, _content=self.content)

    def unread(self) -> Stored:
        """The same without its content, which whoever needs it reads from the file: what that costs
        in memory is given back with the copy that was read."""
        return replace(self, _content=None)

    def decode(self, kind: type[Kind]) -> Kind:
        """The artifact itself. ArtifactCorrupt when it does not fit `kind`."""
        from imocap_core.artifacts import codec

        return codec.unpack(self.content, kind)


@dataclass(frozen=True)
class Store:
    """The artifacts below one folder.

    shared: where results are looked for that are not here, and published.
    """

    folder: Path
    shared: SharedFiles | None = None

    def current(self, action: str, stage: str) -> Path:
        """Path of a stage's current artifact."""
        return self.folder / action / f"{stage}.mcap"

    def report(self, action: str) -> Path:
        """Folder of an action's report."""
        return self.folder / action / REPORT

    def cached(self, stage: str, key: str) -> Path:
        """Path of a result in the cache."""
        return self.folder / CACHE / stage / f"{key}.mcap"

    def load(self, action: str, stage: str) -> Stored | None:
        """The current artifact, whatever key it was made under; None when there is none.

        ArtifactCorrupt when it can't be read back.
        """
        file = self.current(action, stage)
        return _read(file) if file.is_file() else None

    def find(self, action: str, stage: str, key: str) -> Stored | None:
        """The result made under `key`, read and checked; None when there is none or it can't be
        read back. One of the shared store is copied into the cache."""
        for stored in self._made_under(action, stage, key):
            with suppress(ArtifactCorrupt):
                return stored.read()
        return self._fetch(stage, key)

    def look_up(self, action: str, stage: str, key: str) -> Stored | None:
        """As `find`, but a file that was read before and has not changed is not read again."""
        return next(self._made_under(action, stage, key), None) or self._fetch(stage, key)

    def _made_under(self, action: str, stage: str, key: str) -> Iterator[Stored]:
        for file in (self.current(action, stage), self.cached(stage, key)):
            with suppress(ArtifactCorrupt):
                if file.is_file() and (stored := _unread(file)).key == key:
                    yield stored

    def _fetch(self, stage: str, key: str) -> Stored | None:
        if self.shared is None:
            return None
        file = self.cached(stage, key)
        content = fetch_artifact(self.shared, stage, key, file)
        return None if content is None else stored_as(file, content)

    def share(self, stage: str, stored: Stored, *, made: bool) -> Stored:
        """Publish a result in the shared store; the result that counts.

        made: it was made now. Where the store has another one under this key, that one counts.
        """
        if self.shared is None:
            return stored
        file = self.cached(stage, stored.key)
        if not made:
            if not file.is_file():  # an action can have its current artifact alone
                _link(stored.file, file)
            share_file(self.shared, stage, file)
            return stored
        theirs = share_artifact(self.shared, stage, stored.key, file, stored.digest)
        return stored if theirs is None else stored_as(file, theirs)

    def put(
        self,
        stage: str,
        key: str,
        artifact: Artifact,
        provenance: Mapping[str, str],
        files: Mapping[str, bytes],
    ) -> Stored:
        """Store a result under its key, with its provenance and its side files.

        ValueError when a side file's name leads out of the folder, or two are the same.
        """
        check_names(files)
        from imocap_core.artifacts import codec

        packed = codec.pack(artifact)
        content = codec.Content(
            packed.schema, packed.header, packed.arrays, {**provenance, KEY: key}, dict(files)
        )
        file = self.cached(stage, key)
        with appearing(file) as stream:
            codec.write(stream, content, type(artifact).model_json_schema())
        return stored_as(file, content)

    def publish(self, action: str, stage: str, stored: Stored) -> None:
        """Make a result the current one of its stage, its side files the action's report.

        What the program added to the report stays until another result replaces this one; then it
        was made from an older one. What people added stays for good.
        """
        target = self.current(action, stage)
        again = stored.file == target
        if not again:
            _link(stored.file, target)
        report = self.report(action)
        if stored.has_files and not (again and _is_report_of(report, stored)):
            replace_folder(report, stored.content.files)
        mark_used(self.folder, action, stage, stored.key)

    def lock(self, action: str, waiting: Callable[[], None]) -> AbstractContextManager[None]:
        """Lock an action for one run; a second run calls `waiting` once and then waits.

        WorkFailed when a link leads out of the store.
        """
        refuse_links(self.folder, action, CACHE)
        return exclusive(self.folder / action / ".lock", waiting)


def _is_report_of(report: Path, stored: Stored) -> bool:
    """Whether a folder has the side files of an artifact."""

    def key_of(folder: Path) -> str:
        return stored.key if has_files(folder, stored.content.files) else ""

    with suppress(OSError):  # there is no such folder
        return remembered("report_of", report, key_of) == stored.key
    return False


def stored_as(file: Path, content: Content) -> Stored:
    """An artifact whose content is at hand."""
    key, files = content.provenance.get(KEY, ""), bool(content.files)
    return Stored(file, content.schema, content.digest, key, files, content)


def _read(file: Path) -> Stored:
    from imocap_core.artifacts import codec

    return stored_as(file, codec.read(file))


def _unread(file: Path) -> Stored:
    """An artifact whose content, where its head is remembered, is read only when asked for."""
    read_now: list[Stored] = []

    def head_of(file: Path) -> dict[str, str | bool]:
        stored = _read(file)
        read_now.append(stored)
        return {name: getattr(stored, name) for name in HEAD}

    head = remembered("artifact", file, head_of)
    return read_now[0] if read_now else Stored(file, **head)  # type: ignore[arg-type]


def _link(source: Path, target: Path) -> None:
    """Make `target` a hard link to `source`, or a copy where the file system has no links."""
    target.parent.mkdir(parents=True, exist_ok=True)
    aside = target.with_name(f".{target.name}.{os.getpid()}.part")
    try:
        os.link(source, aside)
        os.replace(aside, target)
    except OSError:
        with appearing(target) as stream, source.open("rb") as original:
            shutil.copyfileobj(original, stream)
    finally:
        aside.unlink(missing_ok=True)  # renaming onto a link of the same file leaves it behind
