"""The two ways a command can end other than well."""

from __future__ import annotations


class WorkFailed(Exception):
    """The work could not be done; the message says why and what to do. Exit code 1."""


class WrongUse(Exception):
    """The command was not understood or does not fit the action. Exit code 2."""


def own_fault(error: Exception) -> str:
    """A sentence for what should not have happened."""
    return (
        f"{type(error).__name__}: {error}. This is a fault of the program, not of your input: "
        f"please report it with the output of --traceback"
    )
