"""Links in a store: none may lead out of it, or a folder from elsewhere would say what is written
where."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

from imocap_core.errors import WorkFailed


def refuse_links(store: Path, *inside: str) -> None:
    """WorkFailed when a link in these folders of a store leads out of the store.

    The store itself may be a link.
    """
    home = store.resolve()
    for link in (link for name in inside for link in _links(store / name)):
        if not link.resolve().is_relative_to(home):
            raise WorkFailed(
                f"{link} is a link to {os.readlink(link)}, outside {store}: nothing is written "
                f"through it. Remove the link (to keep results on another disk, link {store} as a "
                f"whole)"
            )


def _links(path: Path) -> Iterator[Path]:
    if path.is_symlink():
        yield path
        return
    for folder, folders, files in os.walk(path):
        yield from (
            link for name in [*folders, *files] if (link := Path(folder, name)).is_symlink()
        )
