"""The shared store at a URL."""

from __future__ import annotations

from functools import cache
from pathlib import Path

from imocap_core.artifacts.patience import PatientFiles
from imocap_core.artifacts.shared import SharedFiles
from imocap_core.errors import WorkFailed

FILE_URL = "file://"
MISSING = "a store at {url} needs {needed}: pip install 'imocap[s3]', or fsspec's package for it"


@cache
def shared_files(url: str) -> SharedFiles:
    """The shared store at a URL of fsspec (`s3://bucket/lab`), or in a folder.

    What fails is tried again for a while (patience.py). WorkFailed when its kind cannot be used.
    """
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
