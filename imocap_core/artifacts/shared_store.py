"""A store that several machines share: whole files by name, below a URL or a folder.

    results/<stage>/<key>.mcap       results of stages, by all that they depend on
    results/detections/<key>.npz     detections of videos, likewise
    inputs/<sha-256>                 files of actions, by their content
    actions/<name>.json              the files and results of an action that was pushed

But for the last, a name stands for one content: whoever writes it writes the same, and the first
counts. Results are checked before they enter the cache of this machine.

URLs go through fsspec: object stores (S3, GCS, Azure), SFTP and others. Credentials and the
server's address are fsspec's and the store's package's: the environment (AWS_ACCESS_KEY_ID,
AWS_ENDPOINT_URL), its files (~/.aws), or fsspec's (FSSPEC_S3_KEY).
"""

from __future__ import annotations

import errno
import logging
import shutil
import time
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, TypeVar, runtime_checkable

from imocap_core.errors import ArtifactCorrupt, WorkFailed
from imocap_core.files import atomic_write, draft_folder, publish_once, writer

if TYPE_CHECKING:
    from imocap_core.artifacts.codec import Content


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


PATIENCE_S = 30.0
FIRST_PAUSE_S, LONGEST_PAUSE_S = 0.5, 5.0
FULL = (errno.ENOSPC, errno.EDQUOT)
NO_CREDENTIALS = ("NoCredentialsError", "PartialCredentialsError", "ProfileNotFound")
LOG = logging.getLogger("imocap")  # where nothing is configured, warnings go to standard error
Value = TypeVar("Value")


class RetryingStore:
    """The files of a shared store; what fails is tried again for PATIENCE_S seconds.

    Then, and at once where waiting does not help (refused credentials, a full disk), WorkFailed.
    """

    def __init__(self, files: SharedFiles) -> None:
        self.url = files.url
        self._files = files

    def has(self, name: str) -> bool:
        return self._patiently(lambda: self._files.has(name))

    def fetch(self, name: str, file: Path) -> bool:
        """OSError, with its folder, when the disk of `file` is full."""

        def fetch() -> bool | OSError:
            try:
                return self._files.fetch(name, file)
            except OSError as error:
                if error.errno in FULL:
                    return error
                raise

        fetched = self._patiently(fetch)
        if isinstance(fetched, OSError):
            raise OSError(fetched.errno, fetched.strerror, str(file.parent)) from fetched
        return fetched

    def publish(self, file: Path, name: str) -> None:
        self._patiently(lambda: self._files.publish(file, name))

    def _patiently(self, work: Callable[[], Value]) -> Value:
        began, pause_s, warned = time.monotonic(), FIRST_PAUSE_S, False
        while True:
            try:
                return work()
            except Exception as error:
                final = _final_fault(error)
                if final:
                    raise WorkFailed(f"the store {self.url} {final}") from error
                if time.monotonic() - began + pause_s > PATIENCE_S:
                    raise WorkFailed(
                        f"the store {self.url} did not answer for {PATIENCE_S:.0f} s "
                        f"({_reason(error)}). What was finished is stored on this machine; run "
                        "again to go on, and to publish it"
                    ) from ConnectionError(str(error))
                if not warned:
                    warned = True
                    LOG.warning(
                        "the store %s does not answer (%s); trying again for %.0f s",
                        *(self.url, _reason(error), PATIENCE_S),
                    )
            time.sleep(pause_s)
            pause_s = min(2 * pause_s, LONGEST_PAUSE_S)


def _final_fault(error: Exception) -> str:
    """What is wrong where waiting does not help; empty where it may."""
    if isinstance(error, PermissionError):
        return f"refuses access ({_reason(error)}); check its credentials, and the rights they have"
    if type(error).__name__ in NO_CREDENTIALS:
        return f"needs credentials ({_reason(error)})"
    if isinstance(error, FileNotFoundError):
        return f"does not exist ({_reason(error)})"
    if isinstance(error, OSError) and error.errno in FULL:
        return f"is full ({_reason(error)})"
    if isinstance(error, (NotImplementedError, ValueError)):
        return f"cannot be used ({_reason(error)})"
    return ""


def _reason(error: Exception) -> str:
    """An error in a line; that of the server where the package wraps it."""
    if isinstance(error, OSError) and error.strerror:
        return error.strerror
    return " ".join(str(error).split())[:200] or type(error).__name__


class FolderFiles:
    """The files below a folder, which must exist: a disk that is not mounted is no empty store."""

    def __init__(self, folder: Path) -> None:
        self.url = str(folder)
        self._folder = folder

    def has(self, name: str) -> bool:
        return (self._existing() / name).is_file()

    def fetch(self, name: str, file: Path) -> bool:
        if not self.has(name):
            return False
        shutil.copyfile(self._folder / name, file)
        return True

    def publish(self, file: Path, name: str) -> None:
        # written aside, then renamed
        with atomic_write(self._existing() / name) as draft:
            shutil.copyfile(file, draft)

    def _existing(self) -> Path:
        if not self._folder.is_dir():
            raise FileNotFoundError(f"the folder {self._folder} does not exist; make or mount it")
        return self._folder


OBJECT_STORES = frozenset({"s3", "s3a", "gs", "gcs", "az", "abfs", "abfss", "oci", "memory"})
FEW_RETRIES = {"retries": {"total_max_attempts": 1}, "connect_timeout": 10, "read_timeout": 20}
OPTIONS: dict[str, dict[str, Any]] = {  # RetryingStore tries again
    "s3": {"config_kwargs": FEW_RETRIES}
}


class RemoteFiles:
    """The files below a path of an fsspec file system; made by `remote_files`."""

    def __init__(self, url: str, system: Any, base: str, *, puts_whole: bool) -> None:
        self.url = url
        self._system, self._base, self._puts_whole = system, base.rstrip("/"), puts_whole

    def has(self, name: str) -> bool:
        try:
            return bool(self._system.info(self._path(name))["type"] == "file")
        except FileNotFoundError:
            return False

    def fetch(self, name: str, file: Path) -> bool:
        if not self.has(name):
            return False
        self._system.get_file(self._path(name), str(file))
        return True

    def publish(self, file: Path, name: str) -> None:
        # What is put into an object store is seen when all of it is there; elsewhere it is put
        # aside and renamed.
        target = self._path(name)
        if self._puts_whole:
            self._system.put_file(str(file), target)
            return
        folder, _, last = target.rpartition("/")
        aside = f"{folder}/.{writer()}{last}.part"
        self._system.makedirs(folder, exist_ok=True)
        try:
            self._system.put_file(str(file), aside)
            self._system.mv(aside, target)
        except BaseException:
            if self._system.exists(aside):
                self._system.rm_file(aside)
            raise

    def _path(self, name: str) -> str:
        return f"{self._base}/{name}"


def remote_files(url: str) -> RemoteFiles:
    """The files below a URL; no listing is remembered, since other machines write there too.

    ImportError when the package of its kind is not installed, ValueError for an unknown kind.
    """
    import fsspec  # type: ignore[import-untyped]

    kind = url.partition("://")[0]
    configured = fsspec.config.conf.get(kind, {})
    options = OPTIONS.get(kind, {}) | configured | {"use_listings_cache": False}
    system, base = fsspec.core.url_to_fs(url, **options)
    if hasattr(system, "retries"):
        system.retries = 1
    return RemoteFiles(url, system, base, puts_whole=kind in OBJECT_STORES)


RESULTS = "results"
KEY = "key"  # of the provenance
DRAFT = "shared"  # cache.py sweeps what killed runs leave


def fetch_artifact(shared: SharedFiles, stage: str, key: str, file: Path) -> Content | None:
    """Copy a stage's result into the cache, as `file`; its content.

    None when there is none, or none that can be read back and was made under this key.
    """
    try:
        with atomic_write(file) as draft:
            if not shared.fetch(_name(stage, f"{key}.mcap"), draft):
                raise ArtifactCorrupt("there is none")
            return _checked(draft, key)
    except ArtifactCorrupt:
        return None


def share_artifact(
    shared: SharedFiles, stage: str, key: str, file: Path, digest: str
) -> Content | None:
    """Publish a result that was just made, unless there is one of its key.

    Returns the content of that one where it is another; it has taken the place of `file` then.
    """
    name = _name(stage, f"{key}.mcap")
    if shared.has(name):
        with draft_folder(file.parent, DRAFT) as folder:
            theirs = fetch_artifact(shared, stage, key, folder / file.name)
        if theirs is not None and theirs.digest == digest:
            return None
        if theirs is not None:
            LOG.warning(
                "%s: two results under the key %s differ (%s here, %s in %s): this stage is not "
                "reproducible on these machines; the one in the store is used",
                *(stage, key[:12], digest[:12], theirs.digest[:12], shared.url),
            )
            return fetch_artifact(shared, stage, key, file)
    shared.publish(file, name)
    return None


def share_file(shared: SharedFiles, stage: str, file: Path) -> None:
    """Publish a file of the cache, unless there is one of its name."""
    if not shared.has(_name(stage, file.name)):
        shared.publish(file, _name(stage, file.name))


def fetch_detections(shared: SharedFiles, file: Path) -> bool:
    """Copy the detections of a video into the cache; False when there are none that can be read.

    Another run may fetch them meanwhile: the first file stays.
    """
    from imocap_core.io.npz import load_arrays

    with draft_folder(file.parent, DRAFT) as folder:
        draft = folder / file.name
        if not shared.fetch(_name(file.parent.name, file.name), draft):
            return False
        try:
            load_arrays(draft)
        except ValueError:
            return False
        publish_once(draft, file)
    return True


def _name(stage: str, file_name: str) -> str:
    return f"{RESULTS}/{stage}/{file_name}"


def _checked(file: Path, key: str) -> Content:
    from imocap_core.artifacts import codec

    content = codec.read(file)
    if content.provenance.get(KEY) != key:
        raise ArtifactCorrupt(f"{file}: was made under another key")
    return content


FILE_URL = "file://"
MISSING = "a store at {url} needs {needed}: pip install 'imocap[s3]', or fsspec's package for it"


@cache
def shared_files(url: str) -> SharedFiles:
    """The shared store at a URL of fsspec (`s3://bucket/lab`), or in a folder.

    What fails is tried again for a while. WorkFailed when its kind cannot be used.
    """
    if "://" not in url or url.startswith(FILE_URL):
        return RetryingStore(FolderFiles(Path(url.removeprefix(FILE_URL)).absolute()))

    try:
        return RetryingStore(remote_files(url))
    except ImportError as error:
        needed = error.name or str(error)
        raise WorkFailed(MISSING.format(url=url, needed=needed)) from None
    except ValueError as error:
        raise WorkFailed(f"the store {url} cannot be used: {error}") from None


def absolute_url(url: str) -> str:
    """The same store for every process: a folder by its whole path."""
    return url if "://" in url else str(Path(url).absolute())
