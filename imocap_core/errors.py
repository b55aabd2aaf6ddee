"""One family of errors: what stops a command or a call of the library, said in one sentence."""

from __future__ import annotations

import difflib
import errno
import os
import re
import tempfile
from collections.abc import Iterable

ADVICE = {
    errno.ENOENT: "check the path, or make the folder",
    errno.EACCES: "use a folder in which you may write (--root)",
    errno.EPERM: "use a folder in which you may write (--root)",
    errno.EROFS: "use a folder in which you may write (--root)",
    errno.EMFILE: "allow more open files (ulimit -n), or run fewer jobs",
}


CONTROL = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f]")  # what a terminal would obey
_UNSHOWN = re.compile(rf"{CONTROL.pattern[:-1]}\u202a-\u202e\u2066-\u2069\ud800-\udfff]")


def _shown_text(text: str) -> str:
    """A text with control characters as escapes: a terminal shows it and does nothing else."""
    return _UNSHOWN.sub(lambda match: match[0].encode("unicode_escape").decode(), text)


def did_you_mean(word: str, choices: Iterable[str]) -> str:
    """' Did you mean X?' of the choice that is nearest to a word; empty where none is near."""
    near = difflib.get_close_matches(word, list(choices), 1)
    return f" Did you mean {near[0]}?" if near else ""


class ImocapError(Exception):
    """The work could not be done, or was not understood; the message is for the user."""

    def __str__(self) -> str:
        return _shown_text(super().__str__())


class WorkFailed(ImocapError):
    """The work could not be done; the message says why and what to do. Exit code 1."""


class WrongUse(ImocapError):
    """The command or call was not understood or does not fit the action. Exit code 2."""


class ArtifactCorrupt(Exception):
    """An artifact can't be read back whole; it must be computed again."""

    def __str__(self) -> str:
        return _shown_text(super().__str__())


class Stopped(BaseException):
    """The command was stopped by a signal (Ctrl-C or SIGTERM). Exit code 128 + its number."""

    def __init__(self, signal_number: int) -> None:
        super().__init__(f"stopped by signal {signal_number}")
        self.exit_code = 128 + signal_number


def system_fault(error: OSError | MemoryError) -> str:
    """The sentence about a file that cannot be used, a full disk, or too little memory."""
    if isinstance(error, MemoryError):
        what = f" ({error})" if str(error) else ""
        return f"not enough memory{what}: close other programs, or use fewer frames"
    if error.errno in (errno.ENOSPC, errno.EDQUOT):
        where = error.filename or f"of {os.getcwd()} or {tempfile.gettempdir()}"
        return f"the disk is full ({where}); finished stages are stored, run again with more space"
    advice = f"; {ADVICE[error.errno]}" if error.errno in ADVICE else ""
    if error.filename is not None:
        return f"cannot use {_shown_text(str(error.filename))}: {error.strerror}{advice}"
    where = f" (below {os.getcwd()} or {tempfile.gettempdir()})"
    return f"a file could not be read or written{where}: {error.strerror or error}{advice}"


def is_out_of_memory(error: BaseException) -> bool:
    """Whether an allocation failed; PyTorch says so by a RuntimeError."""
    signs = ("allocate memory", "out of memory")  # of the processor, of a CUDA device
    return isinstance(error, MemoryError) or (
        isinstance(error, RuntimeError) and any(sign in str(error) for sign in signs)
    )


def program_fault(error: Exception) -> str:
    """The sentence about an error that is no fault of the input."""
    return (
        f"{type(error).__name__}: {error}. This is a fault of the program, not of your input: "
        f"please report it with the output of --traceback"
    )
