"""A store that several machines share: whole files by name, below a URL or a folder.

    results/<stage>/<key>.mcap       results of stages, by all that they depend on
    results/detections/<key>.npz     detections of videos, likewise
    inputs/<sha-256>                 files of actions, by their content
    actions/<name>.json              the files and results of an action that was pushed

But for the last, a name stands for one content: whoever writes it writes the same.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Protocol, runtime_checkable

from imocap_core.errors import WorkFailed

FILE_URL = "file://"
MISSING = "a store at {url} needs {needed}: pip install 'imocap[s3]', or fsspec's package for it"


@runtime_checkable
class SharedFiles(Protocol):
    """The files of a shared store. Each method raises WorkFailed when the store cannot be used."""

    url: str

    def has(self, name: str) -> bool:
        """Whether there is a file of this name."""

    def fetch(self, name: str, file: Path) -> bool:
        """Write the content of a file over `file`; False when there is none."""

    def publish(self, file: Path, name: str) -> None:
        """Make the content of `file` the one of this name; others see it whole or not at all."""


@cache
def shared_files(url: str) -> SharedFiles:
    """The shared store at a URL of fsspec (`s3://bucket/lab`), or in a folder.

    What fails is tried again for a while (patience.py). WorkFailed when its kind cannot be used.
    """
    from imocap_core.artifacts.patience import PatientFiles

    if "://" not in url or url.startswith(FILE_URL):
        from imocap_core.artifacts.shared_folder import FolderFiles

        return PatientFiles(FolderFiles(Path(url.removeprefix(FILE_URL)).absolute()))
    from imocap_core.artifacts.shared_remote import remote_files

    try:
        return PatientFiles(remote_files(url))
    except ImportError as error:
        needed = error.name or str(error)
        raise WorkFailed(MISSING.format(url=url, needed=needed)) from None
    except ValueError as error:
        raise WorkFailed(f"the store {url} cannot be used: {error}") from None


def absolute_url(url: str) -> str:
    """The same store for every process: a folder by its whole path."""
    return url if "://" in url else str(Path(url).absolute())
