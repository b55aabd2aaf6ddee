"""A run of many actions on the terminal: a bar for all tasks, one for each worker, a line for each
action that ends."""

from __future__ import annotations

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, TaskID, TextColumn, TimeElapsedColumn

from imocap_core.executors.tasks import Begun, Progressed, TaskEnd
from imocap_core.library.run_all import ActionEnd, Listener
from imocap_core.library.terminal import bars


class ManyActions:
    """The listener's functions, on a console; without bars where it is no terminal."""

    def __init__(self, console: Console, *, verbose: bool = False) -> None:
        self.console = console
        self._verbose = verbose
        who, step = TextColumn("{task.fields[who]:<14}"), TextColumn("{task.description}")
        done = (BarColumn(bar_width=24), MofNCompleteColumn(), TimeElapsedColumn())
        self._bars = bars(console, who, *done, step)
        self._all = self._bars.add_task("", total=0, who="all tasks")
        self._workers: dict[str, TaskID] = {}
        self._worker_of: dict[str, str] = {}

    def __enter__(self) -> ManyActions:
        self._bars.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._bars.stop()

    def listener(self) -> Listener:
        """What `run_all` calls."""
        return Listener(self._planned, self._watch, self._task_ended, self._action_ended, self._say)

    def _planned(self, counts: dict[str, int]) -> None:
        self._bars.update(self._all, total=sum(counts.values()))

    def _watch(self, event: Begun | Progressed) -> None:
        name = event.task.name
        if isinstance(event, Begun):
            self._worker_of[name] = event.worker
            if event.worker not in self._workers:
                self._workers[event.worker] = self._bars.add_task("", total=100, who=event.worker)
            self._bars.reset(self._workers[event.worker], total=100, description=escape(name))
        elif name in self._worker_of:
            self._bars.update(
                self._workers[self._worker_of[name]],
                completed=round(100 * event.share),
                description=escape(f"{name}  {event.text}"),
            )

    def _task_ended(self, action: str, end: TaskEnd) -> None:
        self._bars.advance(self._all)
        if self._verbose and end.state == "done":
            self.console.print(f"[dim]{end.seconds:8.1f} s  {escape(end.task.name)}[/]")

    def _action_ended(self, end: ActionEnd) -> None:
        made = sum(stage.how == "made" for stage in end.stages)
        how = f"{made} made, {len(end.stages) - made} cached" if made else "all cached"
        text = how if end.state == "done" else end.fault
        colour = "green" if end.state == "done" else "red"
        self.console.print(
            f"[{colour}]{end.state:<6}[/] {escape(end.action):<24} {end.seconds:7.1f} s  "
            f"{escape(text)}"
        )

    def _say(self, text: str) -> None:
        if text:
            self.console.print(escape(text))
