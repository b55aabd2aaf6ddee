"""`imocap export`: the motion, the cameras and the correspondences for other programs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from imocap_core.cli.options import ActionName, ResultSets, root_of, speaker


def export_command(
    context: typer.Context,
    action: ActionName,
    out: Annotated[Path, typer.Option(help="Folder to write to.")],
    format: Annotated[
        Literal["npz", "bvh", "glb", "trc", "csv", "mcap"], typer.Option(help="File format.")
    ] = "npz",
    up: Annotated[
        Literal["y", "z"] | None,
        typer.Option(
            help="Align the world with the ground, this axis up (default: y for bvh, glb and trc, "
            "z for mcap; npz and csv keep the axes of the reference camera)."
        ),
    ] = None,
    time: Annotated[
        Literal["own", "common"],
        typer.Option(help="Each video's own frames, or one common time axis for all videos."),
    ] = "own",
    sets: ResultSets = [],  # noqa: B006
) -> None:
    """Write motion, cameras and sync for other programs."""
    from imocap_core.library.outputs import export

    console = speaker(markup=False)
    exported = export(
        action, out, format=format, up=up, time=time, root=root_of(context), params=sets
    )
    for line in [*exported.notes, *map(str, exported.files)]:
        console.print(line)
