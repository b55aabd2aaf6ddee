"""One family of errors: what stops a command or a call of the library, said in one sentence."""

from __future__ import annotations

import errno


class ImocapError(Exception):
    """The work could not be done, or was not understood; the message is for the user."""


class WorkFailed(ImocapError):
    """The work could not be done; the message says why and what to do. Exit code 1."""


class WrongUse(ImocapError):
    """The command or call was not understood or does not fit the action. Exit code 2."""


class ArtifactCorrupt(Exception):
    """An artifact can't be read back whole; it must be computed again."""


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
    if error.errno == errno.ENOSPC:
        where = f" ({error.filename})" if error.filename is not None else ""
        return f"the disk is full{where}; finished stages are stored, run again with more space"
    if error.filename is not None:
        return f"cannot use {error.filename}: {error.strerror}"
    return f"a file could not be read or written: {error.strerror or error}"


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
