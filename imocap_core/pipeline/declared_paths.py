"""Files as action.yaml declares them: by their path from its folder."""

from __future__ import annotations

import os
from pathlib import Path


def declared_path(file: Path, folder: Path) -> str:
    """The path of a file from an action's folder; the whole path where they share no drive."""
    try:
        return Path(os.path.relpath(file.resolve(), folder.resolve())).as_posix()
    except ValueError:
        return file.resolve().as_posix()
