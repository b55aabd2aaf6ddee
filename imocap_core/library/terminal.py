"""A run on the terminal: one line per stage, and a progress bar for the stage at work."""

from __future__ import annotations

from pathlib import Path
from types import TracebackType

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

from imocap_core.pipeline.runner import Outcome

MAX_REASONS = 3


class Terminal:
    """A `Display` on a console; without a progress bar where it is no terminal."""

    def __init__(self, console: Console) -> None:
        self.console = console
        self._bars = Progress(
            SpinnerColumn(),
            TextColumn("{task.fields[stage]:<14}"),
            BarColumn(bar_width=24),
            TimeElapsedColumn(),
            TextColumn("{task.description}"),
            console=console,
            transient=True,
            disable=not console.is_terminal,
        )
        self._task = self._bars.add_task("", total=1.0, stage="", visible=False)

    def __enter__(self) -> Terminal:
        self._bars.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._bars.stop()

    def started(self, stage: str, why: list[str]) -> None:
        self._bars.reset(self._task, total=1.0, visible=True, stage=stage, description="")
        self.console.print(f"{stage:<14} [dim]because {escape(reasons(why))}[/]")

    def progress(self, share: float, what: str) -> None:
        self._bars.update(self._task, completed=share, description=escape(what))

    def finished(self, outcome: Outcome) -> None:
        self._bars.update(self._task, visible=False)
        how = "[dim]cached[/]" if outcome.how == "cached" else "[green]made[/]  "
        digest = outcome.stored.digest[:12]
        self.console.print(f"{outcome.stage:<14} {how} {outcome.seconds:6.1f} s  [dim]{digest}[/]")

    def made_demo(self, name: str, folder: Path) -> None:
        self._bars.update(self._task, visible=False)
        self.console.print(f"{'demo':<14} [green]made[/]   {escape(str(folder))}")

    def waiting(self) -> None:
        self.console.print("another run of this action is at work; waiting for it to end")


def reasons(why: list[str]) -> str:
    """The first few reasons, and how many more there are."""
    more = len(why) - MAX_REASONS
    return "; ".join(why[:MAX_REASONS]) + (f"; and {more} more" if more > 0 else "")
