"""A shared store behind a URL, through fsspec: object stores (S3, GCS, Azure), SFTP and others.

Credentials and the server's address are those of fsspec and of the store's package: the environment
(AWS_ACCESS_KEY_ID, AWS_ENDPOINT_URL), its files (~/.aws), or fsspec's (FSSPEC_S3_KEY).
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from imocap_core.whole_files import writer

OBJECT_STORES = frozenset({"s3", "s3a", "gs", "gcs", "az", "abfs", "abfss", "oci", "memory"})
FEW_RETRIES = {"retries": {"total_max_attempts": 1}, "connect_timeout": 10, "read_timeout": 20}
OPTIONS: dict[str, dict[str, Any]] = {  # patience.py is what tries again
    "s3": {"config_kwargs": FEW_RETRIES},
}


class RemoteFiles:
    """The files below a path of an fsspec file system; made by `remote_files`."""

    def __init__(self, url: str, system: Any, base: str, *, puts_whole: bool) -> None:
        self.url = url
        self._system, self._base, self._puts_whole = system, base.rstrip("/"), puts_whole

    def has(self, name: str) -> bool:
        """Whether there is a file of this name."""
        try:
            return bool(self._system.info(self._path(name))["type"] == "file")
        except FileNotFoundError:
            return False

    def fetch(self, name: str, file: Path) -> bool:
        """Write the content of a file over `file`; False when there is none."""
        if not self.has(name):
            return False
        self._system.get_file(self._path(name), str(file))
        return True

    def publish(self, file: Path, name: str) -> None:
        """Make the content of `file` the one of this name.

        What is put into an object store is seen when all of it is there; elsewhere it is put aside
        and renamed.
        """
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
