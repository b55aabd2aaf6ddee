"""A run on the terminal: a progress bar for the stage at work; elsewhere, one line of all stages.

Verbose: a line per stage, with all reasons, and every step of it on a line of its own with the
seconds since the stage began.
"""

from __future__ import annotations

import time
from pathlib import Path

from rich.console import Console
from rich.markup import escape
from rich.progress import (
    BarColumn,
    Progress,
    ProgressColumn,
    SpinnerColumn,
    TextColumn,
    TimeElapsedColumn,
)

from imocap_core.pipeline.runner import Outcome


def bars(console: Console, *columns: ProgressColumn) -> Progress:
    """Progress bars, of which nothing stays; none where the console is no terminal."""
    return Progress(*columns, console=console, transient=True, disable=not console.is_terminal)


class Terminal:
    """A `Display` on a console; without a progress bar where it is no terminal."""

    def __init__(self, console: Console, *, verbose: bool = False) -> None:
        self.console = console
        self._verbose = verbose
        self._step, self._began = "", time.perf_counter()
        self._line = ""  # printed, not ended yet
        stage, step = TextColumn("{task.fields[stage]:<14}"), TextColumn("{task.description}")
        self._bars = bars(
            console, SpinnerColumn(), stage, BarColumn(bar_width=24), TimeElapsedColumn(), step
        )
        self._task = self._bars.add_task("", total=1.0, stage="", visible=False)

    def __enter__(self) -> Terminal:
        self._bars.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._end_line()
        self._bars.stop()

    def started(self, stage: str, why: list[str]) -> None:
        self._bars.reset(self._task, total=1.0, visible=True, stage=stage, description="")
        if self._verbose:
            self.console.print(f"{stage:<14} [dim]because {escape('; '.join(why))}[/]")
        else:
            self._continue_line((", " if self._line else "") + stage)
        self._step, self._began = "", time.perf_counter()

    def progress(self, share: float, what: str) -> None:
        if self._verbose and what != self._step:
            self._step = what
            seconds = time.perf_counter() - self._began
            self.console.print(f"{'':<14} [dim]{seconds:13.1f} s  {escape(what)}[/]")
        self._bars.update(self._task, completed=share, description=escape(what))

    def finished(self, outcome: Outcome) -> None:
        self._bars.update(self._task, visible=False)
        if not self._verbose:
            if outcome.how != "cached":
                self._continue_line(f" {outcome.seconds:.0f} s")
            return
        how = "[dim]cached[/]" if outcome.how == "cached" else "[green]made[/]  "
        digest = outcome.stored.digest[:12]
        most = outcome.peak_bytes
        memory = f"{'':<9}" if most is None else f"{most / 2**20:5.0f} MiB"
        self.console.print(
            f"{outcome.stage:<14} {how} {outcome.seconds:6.1f} s {memory}  [dim]{digest}[/]"
        )

    def made_demo(self, name: str, folder: Path) -> None:
        self._bars.update(self._task, visible=False)
        self._end_line()
        self.console.print(f"Made {escape(str(folder))}")

    def waiting(self) -> None:
        self._end_line()
        self.console.print("another run of this action is at work; waiting for it to end")

    def notice(self, sentence: str) -> None:
        self._end_line()
        self.console.print(f"[yellow]note:[/] {escape(sentence)}")

    def _continue_line(self, text: str) -> None:
        """Where there is no bar, all stages are on one line, which grows."""
        if not self.console.is_terminal:
            self._line += text
            self.console.print(escape(text), end="")
            self.console.file.flush()

    def _end_line(self) -> None:
        if self._line:
            self._line = ""
            self.console.print()
