"""`imocap video`: its options, its progress bars, and the paths of the films."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from imocap_core.cli.options import ActionName, ResultSets, root_of, speaker

if TYPE_CHECKING:
    from rich.console import Console
    from rich.progress import Progress

    from imocap_core.film.action_films import Film


def video_command(
    context: typer.Context,
    action: ActionName,
    kind: Annotated[
        Literal["overlay", "side-by-side", "both"],
        typer.Option(help="The body over each video, all videos in lock-step, or both."),
    ] = "both",
    out: Annotated[
        Path | None, typer.Option(help="Folder to write to (default: artifacts/ACTION/videos).")
    ] = None,
    mesh: Annotated[
        bool, typer.Option("--mesh/--no-mesh", help="Draw the body in the side-by-side film too.")
    ] = True,
    result: Annotated[
        Literal["final", "monocular"],
        typer.Option(help="The final motion, or the one estimated from each video alone."),
    ] = "final",
    opacity: Annotated[
        float, typer.Option(min=0.0, max=1.0, help="Opacity of the body; 1 hides the person.")
    ] = 0.75,
    sets: ResultSets = [],  # noqa: B006
) -> None:
    """Write overlay and side-by-side films of an action (H.264)."""
    from imocap_core.library.folders import output_folder
    from imocap_core.library.outputs import films, write_films

    console = speaker(markup=False)
    began = time.perf_counter()
    planned, folder = films(
        action,
        kind=kind,
        mesh=mesh,
        motion=result,
        opacity=opacity,
        root=root_of(context),
        params=sets,
    )
    with _bars(console) as bars:
        tasks = {film.name: bars.add_task(film.name, total=film.count) for film in planned}

        def advance(film: Film, done: int) -> None:
            bars.update(tasks[film.name], completed=done)

        files = write_films(planned, folder if out is None else output_folder(out), advance)
    for file in files:
        console.print(str(file))
    seconds = time.perf_counter() - began
    frames = sum(film.count for film in planned)
    console.print(f"{frames} frames, {seconds:.1f} s")


def _bars(console: Console) -> Progress:
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeRemainingColumn,
    )

    return Progress(
        TextColumn("{task.description:<24}"),
        BarColumn(bar_width=24),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
        console=console,
        transient=True,
        disable=not console.is_terminal,
    )
