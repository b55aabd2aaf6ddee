"""One family of errors: what stops a command or a call of the library, said in one sentence."""

from __future__ import annotations


class ImocapError(Exception):
    """The work could not be done, or was not understood; the message is for the user."""


class WorkFailed(ImocapError):
    """The work could not be done; the message says why and what to do. Exit code 1."""


class WrongUse(ImocapError):
    """The command or call was not understood or does not fit the action. Exit code 2."""


class ArtifactCorrupt(Exception):
    """An artifact can't be read back whole; it must be computed again."""


def program_fault(error: Exception) -> str:
    """The sentence about an error that is no fault of the input."""
    return (
        f"{type(error).__name__}: {error}. This is a fault of the program, not of your input: "
        f"please report it with the output of --traceback"
    )
