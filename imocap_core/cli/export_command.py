"""`imocap export`: the motion, the cameras and the correspondences for other programs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from imocap_core.cli.options import ActionName, root_of, speaker

console = speaker(markup=False)


def export_command(
    context: typer.Context,
    action: ActionName,
    out: Annotated[Path, typer.Option(help="Folder to write to.")],
    format: Annotated[
        Literal["npz", "bvh", "glb", "trc", "csv", "mcap"], typer.Option(help="What to write.")
    ] = "npz",
    up: Annotated[
        Literal["y", "z"] | None,
        typer.Option(
            help="Level the world by the ground, this axis up. Left out: y for bvh, glb and trc, "
            "z for mcap, the reference camera's axes for npz and csv."
        ),
    ] = None,
    time: Annotated[
        Literal["own", "common"],
        typer.Option(help="Every video's own frames, or all on one axis, in lock-step."),
    ] = "own",
) -> None:
    """Write the motion, the cameras and the correspondences for other programs."""
    from imocap_core.library.outputs import export

    exported = export(action, out, format=format, up=up, time=time, root=root_of(context))
    for line in [*exported.notes, *map(str, exported.files)]:
        console.print(line)
