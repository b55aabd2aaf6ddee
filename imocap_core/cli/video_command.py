"""`imocap video`: its options, its progress bars, and the paths of the films."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from imocap_core.cli.options import ActionName, root_of, speaker

if TYPE_CHECKING:
    from imocap_core.film.action_films import Film


def video_command(
    context: typer.Context,
    action: ActionName,
    kind: Annotated[
        Literal["overlay", "side-by-side", "both"],
        typer.Option(help="The body over each video, all videos in lock-step, or both."),
    ] = "both",
    out: Annotated[
        Path | None, typer.Option(help="Folder to write to; else artifacts/ACTION/videos.")
    ] = None,
    mesh: Annotated[
        bool, typer.Option("--mesh/--no-mesh", help="Draw the body in the side-by-side film too.")
    ] = True,
    result: Annotated[
        Literal["final", "monocular"],
        typer.Option(help="The final motion, or that of each video alone."),
    ] = "final",
    opacity: Annotated[
        float, typer.Option(min=0.0, max=1.0, help="1 hides the person behind the body.")
    ] = 0.75,
) -> None:
    """Write films (H.264) of an action that has been run."""
    from imocap_core.library.outputs import films, write_films

    console = speaker(markup=False)
    began = time.perf_counter()
    shown, folder = films(
        action, kind=kind, mesh=mesh, motion=result, opacity=opacity, root=root_of(context)
    )
    with Progress(
        TextColumn("{task.description:<24}"),
        BarColumn(bar_width=24),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
        console=console,
        transient=True,
        disable=not console.is_terminal,
    ) as bars:
        tasks = {film.name: bars.add_task(film.name, total=film.count) for film in shown}

        def advance(film: Film, done: int) -> None:
            bars.update(tasks[film.name], completed=done)

        files = write_films(shown, out or folder, advance)
    for file in files:
        console.print(str(file))
    seconds = time.perf_counter() - began
    frames = sum(film.count for film in shown)
    console.print(f"{frames} frames, {seconds:.1f} s")
