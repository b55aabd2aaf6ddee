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
        Literal[
            "npz",
            "amass",
            "bvh",
            "glb",
            "fbx",
            "usd",
            "trc",
            "csv",
            "c3d",
            "opensim",
            "mcap",
            "calib",
        ],
        typer.Option(help="File format."),
    ] = "npz",
    up: Annotated[
        Literal["y", "z"] | None,
        typer.Option(
            help="Align the world with the ground, this axis up (default: y for bvh, glb, fbx, "
            "usd, trc and opensim, z for c3d, mcap, amass and calib; npz and csv keep the "
            "reference camera's axes)."
        ),
    ] = None,
    time: Annotated[
        Literal["own", "common"],
        typer.Option(help="Each video's own frames, or one common time axis for all videos."),
    ] = "own",
    video: Annotated[
        list[str] | None, typer.Option(help="Only this video; may be given more than once.")
    ] = None,
    mean: Annotated[
        bool, typer.Option("--mean", help="The mean of all performances, as one clip.")
    ] = False,
    origin: Annotated[
        Literal["ground", "start"],
        typer.Option(help="Under the bodies' mean place, or where the motion starts, ahead."),
    ] = "ground",
    names: Annotated[
        Literal["smpl", "mixamo", "ue5", "rigify", "lafan1"],
        typer.Option(
            help="Joint names and rest pose of bvh, glb, fbx and usd; lafan1, of bvh: for robots."
        ),
    ] = "smpl",
    root_bone: Annotated[
        bool, typer.Option("--root-bone", help="A bone on the floor carries the motion.")
    ] = False,
    scale: Annotated[Literal["m", "cm"], typer.Option(help="Unit of lengths of bvh.")] = "m",
    lock_feet: Annotated[
        bool,
        typer.Option("--lock-feet", help="Feet in contact with the ground stay where they stand."),
    ] = False,
    loop: Annotated[
        Literal["continue", "in-place"] | None,
        typer.Option(help="With --mean: the end blends into the start, which goes on or returns."),
    ] = None,
    sets: ResultSets = [],  # noqa: B006
) -> None:
    """Write motion, cameras and sync for other programs."""
    from imocap_core.library.outputs import ExportOptions, export

    options = ExportOptions(
        tuple(video or ()), mean, origin, names, root_bone, scale, lock_feet, loop
    )

    console = speaker(markup=False)
    exported = export(
        action,
        out,
        format=format,
        up=up,
        time=time,
        options=options,
        root=root_of(context),
        params=sets,
        announce=console.print,
    )
    for line in [*exported.notes, *map(str, exported.files)]:
        console.print(line)
