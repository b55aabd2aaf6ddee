"""What leaves the library as an error: one family, each with a sentence."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import ParamSpec, TypeVar

from imocap_core.errors import ArtifactCorrupt, ImocapError, WorkFailed, WrongUse, system_fault

Parameters = ParamSpec("Parameters")
Value = TypeVar("Value")


def plain_errors(function: Callable[Parameters, Value]) -> Callable[Parameters, Value]:
    """Let a public function raise nothing but `ImocapError` for bad input.

    A damaged artifact and a file that cannot be used become WorkFailed, arguments of wrong values
    or shapes WrongUse. What remains (TypeError, KeyError, ...) is a fault of the program.
    """

    @wraps(function)
    def guarded(*arguments: Parameters.args, **named: Parameters.kwargs) -> Value:
        try:
            return function(*arguments, **named)
        except ImocapError:
            raise
        except (ArtifactCorrupt, OSError, MemoryError) as error:
            raise WorkFailed(sentence_of(error)) from error
        except ValueError as error:
            raise WrongUse(str(error)) from error

    return guarded


def sentence_of(error: Exception) -> str:
    """One line about a file that cannot be used."""
    if isinstance(error, (OSError, MemoryError)):
        return system_fault(error)
    return str(error).partition("\n")[0]
