"""Files of an export come into their folder complete, and replace nothing but an older export.

export_<format>.json lists the files that were written with their digests. A file that no export
wrote, that somebody has changed since, or that belongs to an export in another format or world is
left alone, and the new one is refused.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Sequence
from pathlib import Path

from imocap_core.errors import WorkFailed

NOTES = "export_*.json"


def digests_of(files: Sequence[Path]) -> dict[str, str]:
    """SHA-256 of each file, by its name."""
    return {file.name: _digest(file) for file in files}


def place(drafts: Sequence[Path], out: Path, notes: str) -> list[Path]:
    """Move files into the folder `out`; WorkFailed, with nothing moved, when one must not be
    replaced. notes: the name of this export's export_<format>.json."""
    earlier = {file.name: _listed(file) for file in sorted(out.glob(NOTES))}
    for draft in drafts:
        target = out / draft.name
        if (target.exists() or target.is_symlink()) and draft.name != notes:
            _must_be_replaceable(target, draft, earlier, notes)
    placed = [out / draft.name for draft in drafts]
    for draft, target in zip(drafts, placed, strict=True):
        os.replace(draft, target)
    return placed


def _must_be_replaceable(
    target: Path, draft: Path, earlier: dict[str, dict[str, str]], notes: str
) -> None:
    present = _digest(target) if target.is_file() else ""
    owners = [name for name, files in earlier.items() if files.get(target.name) == present]
    if not owners and present != _digest(draft):
        raise WorkFailed(
            f"{target} exists, and was not written by an export or has been changed since; choose "
            f"another folder with --out, or move it away"
        )
    others = [name for name in owners if name != notes]
    if others and present != _digest(draft):
        raise WorkFailed(
            f"{target} belongs to {others[0]}, an export of other axes or of another run; choose "
            f"another folder with --out, or give both the same --up"
        )


def _listed(notes: Path) -> dict[str, str]:
    """The files that an export wrote, by its notes; none when these are not readable."""
    try:
        files = json.loads(notes.read_text(encoding="utf-8"))["files"]
        return {str(name): str(digest) for name, digest in files.items()}
    except (OSError, ValueError, LookupError, TypeError, AttributeError, RecursionError):
        return {}


def _digest(file: Path) -> str:
    with file.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()
