"""Progress of a run: silent, to a function of the caller, or on the terminal."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from imocap_core.pipeline.runner import Display, Outcome

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
