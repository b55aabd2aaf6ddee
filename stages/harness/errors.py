"""The two ways a command can end other than well."""

from __future__ import annotations


class WorkFailed(Exception):
    """The work could not be done; the message says why and what to do. Exit code 1."""


class WrongUse(Exception):
    """The command was not understood or does not fit the action. Exit code 2."""
