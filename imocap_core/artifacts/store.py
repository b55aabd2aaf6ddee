"""Where artifacts are stored: the current one of each stage, and every older one by its key.

    artifacts/
      <action>/<stage>.mcap             the current artifact
      <action>/report/                  the side files of the stage that made some
      .cache/<stage>/<key>.mcap         every result, so that old parameters cost nothing
      .cache/<stage>_<part>/<key>.mcap  parts of them, for other results (pipeline.parts)
      .cache/detections/<key>.npz       detections of videos
      .cache/files.json                 digests of files that have not changed (file_memory.py)

The time of last use is the file's access time, which `mark_used` sets; a mount option (noatime,
relatime) does not matter to it.

Files appear whole or not at all (written aside, synced, renamed); the current artifact is a hard
link to its cached one where the file system has links.
"""

from __future__ import annotations

import os
import shutil
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, suppress
from dataclasses import dataclass, replace
from functools import cached_property
from glob import escape, glob
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from imocap_core.artifacts.file_memory import exclusive, remembered
from imocap_core.artifacts.side_files import check_names, has_files, refuse_links, replace_folder
from imocap_core.errors import ArtifactCorrupt
from imocap_core.files import appearing, writer_has_ended

if TYPE_CHECKING:
    from imocap_core.artifacts.codec import Content
    from imocap_core.artifacts.schemas.base import Artifact


CACHE = ".cache"
REPORT = "report"
KEY = "key"  # of the provenance
SUFFIXES = (".mcap", ".npz")
SWEEP_S = 86400.0
OF_CACHE = (".*.part*", "*/.*.part*", "*/.detect-*")
OF_ACTION = (".*.part*", "*/.*.part*", "*/*/.*.part*", ".report-*", ".stage-*")


@dataclass(frozen=True)
class CachedResult:
    """One file of the cache.

    used_s: time of last use, seconds since the epoch. in_use: it is the current artifact of an
    action, or the current detections of a video.
    """

    file: Path
    stage: str
    key: str
    size_bytes: int
    used_s: float
    in_use: bool


def mark_used(store: Path, stage: str, key: str) -> None:
    """Record that a cached result is used now; nothing happens when the file is gone."""
    file = store / CACHE / stage / f"{key}.mcap"
    with suppress(OSError):
        times = file.stat()
        os.utime(file, ns=(time.time_ns(), times.st_mtime_ns))


def cached_results(store: Path, used_files: Iterable[Path] = ()) -> list[CachedResult]:
    """Every result in the cache of a store, the least recently used first.

    used_files: further files of the cache that are in use (the detections of existing actions).
    """
    current = {_identity(file) for file in [*store.glob("*/*.mcap"), *used_files]}
    results = []
    for file in (store / CACHE).glob("*/*"):
        hidden = file.name.startswith(".") or file.parent.name.startswith(".")
        if hidden or file.suffix not in SUFFIXES:
            continue
        with suppress(FileNotFoundError):
            status = file.stat()
            stage, key = file.parent.name, file.stem
            results.append(
                CachedResult(
                    file,
                    stage,
                    key,
                    status.st_size,
                    max(status.st_atime, status.st_mtime),
                    _identity(file) in current,
                )
            )
    return sorted(results, key=lambda result: (result.used_s, result.file))


def removable(
    results: Sequence[CachedResult],
    *,
    now_s: float,
    older_s: float | None = None,
    max_bytes: int | None = None,
) -> list[CachedResult]:
    """The results to remove, the least recently used first; none that is in use.

    Args:
        older_s: those that have not been used for this time.
        max_bytes: as many more as bring all results (in use or not) to this size, if possible.
    """
    candidates = [r for r in results if not r.in_use]
    chosen = [] if older_s is None else [r for r in candidates if now_s - r.used_s > older_s]
    if max_bytes is not None:
        size = sum(r.size_bytes for r in results) - sum(r.size_bytes for r in chosen)
        for result in (r for r in candidates if r not in chosen):
            if size <= max_bytes:
                break
            chosen.append(result)
            size -= result.size_bytes
    return chosen


def leftovers(store: Path, action: str | None = None) -> list[Path]:
    """Unfinished files and folders; those of a killed run, if no run is at work. Links lead to
    none: what is behind them is somebody's.

    action: those of the cache and of this action only; a folder of thousands is not looked through.
    """
    place = "*" if action is None else escape(action)
    patterns = [f"{CACHE}/{x}" for x in OF_CACHE] + [f"{place}/{x}" for x in OF_ACTION]
    # Not Path.glob, which raises when another run removes a folder between its listing and its own.
    matches = (glob(pattern, root_dir=store, include_hidden=True) for pattern in patterns)
    home = store.resolve()
    return sorted(
        path
        for path in {store / name for names in matches for name in names}
        if path.parent.resolve() == home / path.parent.relative_to(store)
    )


def restore_reports(store: Path, action: str) -> None:
    """Put back the report of a run that was killed while it replaced it: it may have files of
    people."""
    for old in sorted((store / action).glob(f".{REPORT}-*-old")):
        report = store / action / REPORT
        if not report.exists():
            os.replace(old, report)


def sweep(store: Path, action: str) -> None:
    """Delete what killed runs of an action left behind; of the cache, where other actions may be
    writing, what a process of this machine left that has ended, or is older than a day. The
    action's lock is held."""
    restore_reports(store, action)
    for path in leftovers(store, action):
        with suppress(OSError):
            abandoned = store / action in path.parents or writer_has_ended(path)
            if abandoned or time.time() - path.stat().st_mtime > SWEEP_S:
                _delete(path)


def remove(paths: Iterable[Path]) -> None:
    """Delete files and folders of a store."""
    for path in paths:
        _delete(path)


def _delete(path: Path) -> None:
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, ignore_errors=True)
    else:
        path.unlink(missing_ok=True)


def size_of(path: Path) -> int:
    """Bytes of a file, or of all files of a folder."""
    if path.is_dir():
        return sum(file.stat().st_size for file in path.rglob("*") if file.is_file())
    return path.stat().st_size


def _identity(file: Path) -> tuple[int, int] | None:
    """Equal for two links of one file."""
    with suppress(OSError):
        status = file.stat()
        return status.st_dev, status.st_ino
    return None


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
    """The artifacts below one folder."""

    folder: Path

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
        read back."""
        for stored in self._made_under(action, stage, key):
            with suppress(ArtifactCorrupt):
                return stored.read()
        return None

    def look_up(self, action: str, stage: str, key: str) -> Stored | None:
        """As `find`, but a file that was read before and has not changed is not read again."""
        return next(self._made_under(action, stage, key), None)

    def _made_under(self, action: str, stage: str, key: str) -> Iterator[Stored]:
        for file in (self.current(action, stage), self.cached(stage, key)):
            with suppress(ArtifactCorrupt):
                if file.is_file() and (stored := _unread(file)).key == key:
                    yield stored

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

        content = replace(
            codec.pack(artifact), provenance={**provenance, KEY: key}, files=dict(files)
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
        mark_used(self.folder, stage, stored.key)

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
