"""What a stage reads must stay as it is while the stage runs, or its result is of something else.

Digests before and after are not enough: a file that was changed and changed back has the same one,
but the stage may have read what was there in between. The time of a file's last change of status
cannot be set back.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from imocap_core.artifacts.file_memory import files_below
from imocap_core.errors import WorkFailed

States = list[tuple[str, int, int, int, int]]


@contextmanager
def unchanged(reads: Mapping[str, Path]) -> Iterator[None]:
    """WorkFailed when one of these files or folders was touched while the body ran.

    reads: by what they are read as.
    """
    before = {name: _states(path) for name, path in reads.items()}
    yield
    for name, path in reads.items():
        if _states(path) != before[name]:
            raise WorkFailed(
                f"{path} ({name}) was changed while it was read; the result is not stored. Run "
                f"again when nothing writes there"
            )


def _states(path: Path) -> States:
    """Every file's name, size, inode, and times of last change; empty where there is nothing."""
    if not path.exists():
        return []
    names = files_below(path) if path.is_dir() else [""]
    return [_state(name, os.stat(path / name if name else path)) for name in names]


def _state(name: str, now: os.stat_result) -> tuple[str, int, int, int, int]:
    return name, now.st_size, now.st_ino, now.st_mtime_ns, now.st_ctime_ns
