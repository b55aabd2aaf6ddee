"""Errors of a shared store that may pass are waited for; others become a sentence at once."""

from __future__ import annotations

import errno
import logging
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from imocap_core.errors import WorkFailed

if TYPE_CHECKING:
    from imocap_core.artifacts.shared import SharedFiles

PATIENCE_S = 30.0
FIRST_PAUSE_S, LONGEST_PAUSE_S = 0.5, 5.0
FULL = (errno.ENOSPC, errno.EDQUOT)
NO_CREDENTIALS = ("NoCredentialsError", "PartialCredentialsError", "ProfileNotFound")
LOG = logging.getLogger("imocap")  # where nothing is configured, warnings go to standard error
Value = TypeVar("Value")


class PatientFiles:
    """The files of a shared store; what fails is tried again for PATIENCE_S seconds.

    Then, and at once where waiting does not help (refused credentials, a full disk), WorkFailed.
    """

    def __init__(self, files: SharedFiles) -> None:
        self.url = files.url
        self._files = files

    def has(self, name: str) -> bool:
        """Whether there is a file of this name."""
        return self._patiently(lambda: self._files.has(name))

    def fetch(self, name: str, file: Path) -> bool:
        """Write the content of a file over `file`; False when there is none.

        OSError, with its folder, when the disk of `file` is full.
        """

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
        """Make the content of `file` the one of this name."""
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
