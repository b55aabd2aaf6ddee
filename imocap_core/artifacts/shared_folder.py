"""A shared store in a folder that several machines mount."""

from __future__ import annotations

import shutil
from pathlib import Path

from imocap_core.whole_files import draft_of


class FolderFiles:
    """The files below a folder, which must exist: a disk that is not mounted is no empty store."""

    def __init__(self, folder: Path) -> None:
        self.url = str(folder)
        self._folder = folder

    def has(self, name: str) -> bool:
        """Whether there is a file of this name."""
        return (self._existing() / name).is_file()

    def fetch(self, name: str, file: Path) -> bool:
        """Write the content of a file over `file`; False when there is none."""
        if not self.has(name):
            return False
        shutil.copyfile(self._folder / name, file)
        return True

    def publish(self, file: Path, name: str) -> None:
        """Make the content of `file` the one of this name: written aside, then renamed."""
        with draft_of(self._existing() / name) as draft:
            shutil.copyfile(file, draft)

    def _existing(self) -> Path:
        if not self._folder.is_dir():
            raise FileNotFoundError(f"the folder {self._folder} does not exist; make or mount it")
        return self._folder
