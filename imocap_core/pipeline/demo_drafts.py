"""Hidden folders beside a demo action, in which it is made; killed processes leave theirs."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

from imocap_core.whole_files import writer, writer_has_ended


def draft_prefix(folder: Path) -> str:
    """The beginning of the name of the hidden folder in which `folder` is made."""
    return f".{folder.name}.{writer()}"


def sweep_drafts(folder: Path) -> None:
    """Delete what killed processes of this machine left beside `folder`.

    One that was killed while it replaced an older folder has it still: that is put back.
    """
    for aside in sorted(folder.parent.glob(f".{folder.name}.*")):
        if not writer_has_ended(aside) or aside.is_symlink():
            continue
        if (aside / "old").is_dir() and not folder.exists():
            os.replace(aside / "old", folder)
        shutil.rmtree(aside, ignore_errors=True)
