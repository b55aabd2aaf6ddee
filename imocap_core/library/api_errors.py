"""The library's edge: errors of one family, one-off parameters, progress."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import wraps
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

from imocap_core.errors import ArtifactCorrupt, ImocapError, WorkFailed, WrongUse, system_fault
from imocap_core.pipeline.runner import Display, Outcome

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
        except (OSError, MemoryError) as error:
            raise WorkFailed(system_fault(error)) from error
        except ArtifactCorrupt as error:
            raise WorkFailed(str(error).partition("\n")[0]) from error
        except ValueError as error:
            raise WrongUse(str(error)) from error

    return guarded


Params = Mapping[str, Any] | Sequence[str] | None
"""One-off parameters: {"sync": {"max_rate": 8}}, {"sync.max_rate": 8} or ["sync.max_rate=8"]."""


def one_off(params: Params) -> list[str]:
    """Parameters as the command line's `--set` takes them: group.name=value."""
    if params is None:
        return []
    if not isinstance(params, Mapping):
        return list(params)
    texts = []
    for key, value in params.items():
        nested = value.items() if isinstance(value, Mapping) and "." not in key else None
        pairs = [(key, value)] if nested is None else [(f"{key}.{n}", v) for n, v in nested]
        texts += [f"{path}={_yaml(path, content)}" for path, content in pairs]
    return texts


def _yaml(path: str, value: Any) -> str:
    try:
        return json.dumps(value)
    except TypeError:
        raise WrongUse(
            f"params: {path}: expected numbers, words, lists or mappings, "
            f"got {type(value).__name__}"
        ) from None


Report = Callable[[str, float, str], object]
"""Called with a stage's name, its share done (0 to 1), and what it is doing."""
Progress = Report | Display | bool | None


class FunctionDisplay:
    """A `Display` that calls a function with stage, share and text."""

    def __init__(self, report: Report) -> None:
        self._report = report
        self._stage = ""

    def started(self, stage: str, why: list[str]) -> None:
        """A stage begins, for these reasons."""
        self._stage = stage
        self._report(stage, 0.0, "because " + "; ".join(why))

    def progress(self, share: float, what: str) -> None:
        """The stage at work is this far."""
        self._report(self._stage, share, what)

    def finished(self, outcome: Outcome) -> None:
        """A stage has its artifact."""
        self._report(outcome.stage, 1.0, outcome.how)

    def made_demo(self, name: str, folder: Path) -> None:
        """A built-in action has been made."""
        self._report("demo", 1.0, f"made {folder}")

    def waiting(self) -> None:
        """Another run of the same action is at work."""
        self._report(self._stage, 0.0, "waiting for another run of this action")

    def notice(self, sentence: str) -> None:
        """What to know while the run goes on."""
        self._report(self._stage, 0.0, sentence)


@contextmanager
def displaying(progress: Progress) -> Iterator[Display]:
    """The display that `progress` means: a function, True for the terminal, None for silence."""
    if progress is True:
        from rich.console import Console

        from imocap_core.library.terminal import Terminal

        console = Console(stderr=True, highlight=False, soft_wrap=True)
        with Terminal(console) as terminal:
            yield terminal
    elif progress is None or progress is False:
        yield FunctionDisplay(lambda stage, share, what: None)
    elif callable(progress):
        yield FunctionDisplay(progress)
    else:
        yield progress
