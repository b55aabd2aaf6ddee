"""Removing old results from the cache of a working folder, by hand or beyond a limit.

IMOCAP_CACHE_LIMIT sets it, as in 50GB; 0 turns it off.
"""

from __future__ import annotations

import os
import re
import time
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from imocap_core.artifacts.store import (
    CachedResult,
    cached_results,
    leftovers,
    removable,
    remove,
    restore_reports,
    size_of,
)
from imocap_core.errors import ImocapError, WorkFailed, WrongUse
from imocap_core.library.api_errors import plain_errors
from imocap_core.workspace import Workspace

DAY_S = 86400.0
UNITS = {"B": 1, "KB": 10**3, "MB": 10**6, "GB": 10**9, "TB": 10**12}


@dataclass(frozen=True)
class CacheRow:
    """The cached results of one stage: their number and size, those in use, those to remove."""

    stage: str
    results: int
    size_bytes: int
    in_use: int
    removed: int
    removed_bytes: int


@dataclass(frozen=True)
class Cleaning:
    """The cache before cleaning, by stage, and what was removed (of a dry run: what would be)."""

    rows: list[CacheRow]
    leftovers: int
    leftover_bytes: int
    dry_run: bool

    @property
    def size_bytes(self) -> int:
        """The size of all results before cleaning."""
        return sum(row.size_bytes for row in self.rows)

    @property
    def removed(self) -> int:
        """The number of removed results."""
        return sum(row.removed for row in self.rows)

    @property
    def removed_bytes(self) -> int:
        """The size of the removed results."""
        return sum(row.removed_bytes for row in self.rows)


@plain_errors
def clean(
    *,
    older_days: float | None = None,
    max_bytes: int | None = None,
    dry_run: bool = False,
    root: str | Path = ".",
) -> Cleaning:
    """Remove results from the cache, the least recently used first, and leftovers of killed runs.

    Current artifacts, and the detections of existing actions, are never removed; without
    `older_days` and `max_bytes` no result is.

    Args:
        older_days: results that have not been used for this many days.
        max_bytes: as many more as bring the cache to this size.
        dry_run: remove nothing.

    Raises:
        WorkFailed: a run is in progress.
    """
    workspace = Workspace(Path(root))
    store = workspace.store.folder
    with ExitStack() as held:  # every action, so that no run starts
        for lock in sorted(store.glob("*/.lock")):
            name = lock.parent.name
            held.enter_context(workspace.store.lock(name, partial(_refuse, name)))
        results = cached_results(store, _current_detections(workspace))
        chosen = removable(
            results,
            now_s=time.time(),
            older_s=None if older_days is None else older_days * DAY_S,
            max_bytes=max_bytes,
        )
        for folder in store.glob("*"):
            restore_reports(store, folder.name)
        unfinished = leftovers(store)
        cleaning = Cleaning(
            _rows(results, chosen), len(unfinished), sum(map(size_of, unfinished)), dry_run
        )
        if not dry_run:
            remove([*(result.file for result in chosen), *unfinished])
    return cleaning


def bytes_of(text: str) -> int:
    """A size as 2GB, 500 MB or 1000 (bytes); WrongUse for anything else."""
    match = re.fullmatch(r"\s*(\d+(?:\.\d+)?)\s*([KMGT]?B)?\s*", text, re.IGNORECASE)
    if match is None:
        raise WrongUse(f"invalid size {text!r}: expected a number with KB, MB, GB or TB, as 2GB")
    return round(float(match[1]) * UNITS[(match[2] or "B").upper()])


def _rows(results: Sequence[CachedResult], chosen: Sequence[CachedResult]) -> list[CacheRow]:
    rows = []
    for stage in sorted({result.stage for result in results}):
        of_stage = [result for result in results if result.stage == stage]
        removed = [result for result in chosen if result.stage == stage]
        rows.append(
            CacheRow(
                stage,
                len(of_stage),
                sum(result.size_bytes for result in of_stage),
                sum(result.in_use for result in of_stage),
                len(removed),
                sum(result.size_bytes for result in removed),
            )
        )
    return rows


def _current_detections(workspace: Workspace) -> list[Path]:
    """The detections of the actions below actions/; all detections when one cannot be read."""
    files: list[Path] = []
    for file in (workspace.root / "actions").glob("*/action.yaml"):
        try:
            files += workspace.job(str(file.parent), []).action.detected.values()
        except ImocapError:
            return list((workspace.store.folder / ".cache" / "detections").glob("*.npz"))
    return files


def _refuse(name: str) -> None:
    raise WorkFailed(f"a run of {name} is in progress; clean when it has ended")


VARIABLE = "IMOCAP_CACHE_LIMIT"
DEFAULT = "20GB"


def cache_limit_bytes() -> int | None:
    """The limit in force; None where there is none. WrongUse when it is no size."""
    text = os.environ.get(VARIABLE) or DEFAULT
    try:
        return bytes_of(text) or None
    except WrongUse as error:
        raise WrongUse(f"{VARIABLE}: {error}") from None


def keep_cache_within_limit(root: Path) -> list[str]:
    """Remove old results of a cache that is too large, as `imocap clean` does; a sentence if any
    were removed. Nothing happens while another run is in progress."""
    limit = cache_limit_bytes()
    if limit is None:  # and nothing is looked at: a cache of 10,000 actions takes seconds
        return []
    results = cached_results(Workspace(root).store.folder)
    if sum(result.size_bytes for result in results) <= limit:
        return []
    try:
        cleaning = clean(max_bytes=limit, root=root)
    except WorkFailed:
        return []
    if not cleaning.removed:
        return []
    size = f"{cleaning.removed_bytes / 1e9:.1f} GB"
    return [f"The cache was over {limit / 1e9:g} GB ({VARIABLE}): {size} of old results removed."]
