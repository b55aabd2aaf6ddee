"""The cache of the store: its contents, what can be removed, and leftovers of killed runs.

    .cache/<stage>/<key>.mcap       results of stages
    .cache/<stage>_<part>/<key>.mcap  parts of them, for other results (pipeline.parts)
    .cache/detections/<key>.npz     detections of videos
    .cache/.used/<action>           `<stage>/<key>`, a line for every result that it has used
    .cache/files.json               digests of files that have not changed (file_memory.py)

The time of last use is the file's access time, which `mark_used` sets; a mount option (noatime,
relatime) does not matter to it.
"""

from __future__ import annotations

import os
import shutil
import time
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from glob import escape, glob
from pathlib import Path

from imocap_core.whole_files import write_whole, writer_has_ended

CACHE, USED = ".cache", ".used"
REPORT = "report"
SUFFIXES = (".mcap", ".npz")
SWEEP_S = 86400.0
OF_CACHE = (".*.part*", "*/.*.part*", "*/.detect-*", "*/.shared-*")
OF_ACTION = (".*.part*", "*/.*.part*", "*/*/.*.part*", ".report-*", ".stage-*")


@dataclass(frozen=True)
class CachedResult:
    """One file of the cache.

    used_s: time of last use, seconds since the epoch. in_use: it is the current artifact of an
    action, or the current detections of a video. actions: those that have used it, as recorded.
    """

    file: Path
    stage: str
    key: str
    size_bytes: int
    used_s: float
    in_use: bool
    actions: frozenset[str]


def mark_used(store: Path, action: str, stage: str, key: str) -> None:
    """Record that an action uses a cached result now; nothing happens when the file is gone."""
    file = store / CACHE / stage / f"{key}.mcap"
    with suppress(OSError):
        times = file.stat()
        os.utime(file, ns=(time.time_ns(), times.st_mtime_ns))
        record = store / CACHE / USED / action
        line = f"{stage}/{key}"
        if line not in _lines(record):
            record.parent.mkdir(parents=True, exist_ok=True)
            with record.open("a", encoding="utf-8") as stream:
                stream.write(line + "\n")


def cached_results(store: Path, used_files: Iterable[Path] = ()) -> list[CachedResult]:
    """Every result in the cache of a store, the least recently used first.

    used_files: further files of the cache that are in use (the detections of existing actions).
    """
    current = {_identity(file) for file in [*store.glob("*/*.mcap"), *used_files]}
    users = _users(store)
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
                    users.get(f"{stage}/{key}", frozenset()),
                )
            )
    return sorted(results, key=lambda result: (result.used_s, result.file))


def removable(
    results: Sequence[CachedResult],
    *,
    now_s: float,
    action: str | None = None,
    older_s: float | None = None,
    max_bytes: int | None = None,
) -> list[CachedResult]:
    """The results to remove, the least recently used first; none that is in use.

    Args:
        action: only results that this action and no other has used.
        older_s: those that have not been used for this time.
        max_bytes: as many more as bring all results (in use or not) to this size, if possible.
    """
    candidates = [r for r in results if not r.in_use and (action is None or r.actions == {action})]
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


def remove(store: Path, paths: Iterable[Path]) -> None:
    """Delete files and folders of a store, and what the records of use say of them."""
    for path in paths:
        _delete(path)
    for record in (store / CACHE / USED).glob("*"):
        lines = [line for line in _lines(record) if (store / CACHE / f"{line}.mcap").is_file()]
        if lines:
            write_whole(record, "".join(f"{line}\n" for line in lines))
        else:
            record.unlink(missing_ok=True)


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


def _users(store: Path) -> dict[str, frozenset[str]]:
    users: dict[str, set[str]] = {}
    for record in (store / CACHE / USED).glob("*"):
        for line in _lines(record):
            users.setdefault(line, set()).add(record.name)
    return {line: frozenset(actions) for line, actions in users.items()}


def _lines(record: Path) -> list[str]:
    return record.read_text("utf-8", errors="replace").split() if record.is_file() else []


def _identity(file: Path) -> tuple[int, int] | None:
    """Equal for two links of one file."""
    with suppress(OSError):
        status = file.stat()
        return status.st_dev, status.st_ino
    return None
