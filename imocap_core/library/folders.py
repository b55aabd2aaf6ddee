"""Folders that the user names for results."""

from __future__ import annotations

from pathlib import Path

from imocap_core.errors import WrongUse
from imocap_core.pipeline.action import FILE_NAME


def output_folder(out: str | Path) -> Path:
    """The folder to write to; WrongUse for an action's, whose videos and keypoints lie there."""
    folder = Path(out)
    for place in (folder.absolute(), folder.absolute().parent):
        made = place.parent.name == "artifacts"  # by the program, for `imocap sync`
        if (place / FILE_NAME).is_file() and not made:
            raise WrongUse(
                f"--out {out}: {place} is an action, whose files might be replaced; choose another "
                f"folder"
            )
    return folder
