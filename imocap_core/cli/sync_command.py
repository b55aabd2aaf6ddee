"""`imocap sync`: its options, and the table at the end."""

from __future__ import annotations

import time
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from imocap_core.cli.json_output import print_json
from imocap_core.cli.options import Json, Sets, root_of, speaker
from imocap_core.pipeline.format_names import DetectionFormat, Layout

if TYPE_CHECKING:
    from rich.table import Table

    from imocap_core.library.progress import Progress
    from imocap_core.standalone_sync.run import Synchronised


def sync_command(
    context: typer.Context,
    sources: Annotated[
        list[str],
        typer.Argument(
            metavar="VIDEO_OR_KEYPOINTS...",
            help="Keypoint folders or files, videos with keypoints beside them, "
            "VIDEO:KEYPOINTS, or one action.",
        ),
    ],
    out: Annotated[Path | None, typer.Option(help="Folder to write to.")] = None,
    name: Annotated[
        str | None, typer.Option(help="Name of the action below artifacts/ for the results.")
    ] = None,
    reference: Annotated[
        str | None,
        typer.Option(help="Video whose time axis is used (default: a central one)."),
    ] = None,
    repetitions: Annotated[
        bool, typer.Option("--repetitions", help="Cut one long clip into its repetitions first.")
    ] = False,
    format: Annotated[
        DetectionFormat | None,
        typer.Option(help="Format of the keypoints, if the files do not name it."),
    ] = None,
    layout: Annotated[
        Layout | None, typer.Option(help="Layout of the keypoints, if the files do not name it.")
    ] = None,
    fps: Annotated[
        float | None, typer.Option(min=0.1, help="Frame rate of keypoints without a video.")
    ] = None,
    size: Annotated[
        str | None, typer.Option(metavar="WxH", help="Picture size of keypoints without a video.")
    ] = None,
    sets: Sets = [],  # noqa: B006
    as_json: Json = False,
) -> None:
    """Synchronise videos without reconstructing motion.

    Writes sync.csv, a picture and, if there are videos, a film of all videos side by side.
    """
    from imocap_core.library.synchronising import synchronise_videos
    from imocap_core.library.terminal import Terminal

    def solve(progress: Progress) -> Synchronised:
        return synchronise_videos(
            sources,
            format=format,
            layout=layout,
            fps=fps,
            size=size,
            name=name,
            out=out,
            reference=reference,
            repetitions=repetitions,
            root=root_of(context),
            params=sets,
            progress=progress,
        )

    began = time.perf_counter()
    if as_json:
        print_json(_document(solve(None)))
        return
    with Terminal(speaker()) as display:
        done = solve(display)
    _print(done, time.perf_counter() - began)


def _document(done: Synchronised) -> dict[str, object]:
    sync = done.sync
    videos = [
        asdict(row)
        | {"excluded": row.video in sync.excluded, "mirrored": row.video in sync.mirrored}
        for row in done.rows
    ]
    return {
        "action": done.action,
        "reference": sync.reference,
        "status": sync.status,
        "notes": [*done.notes, *sync.notes],
        "videos": videos,
        "files": done.files,
    }


def _print(done: Synchronised, seconds: float) -> None:
    from rich.markup import escape

    console = speaker()
    for note in (*done.notes, *done.sync.notes, done.sync.status):
        console.print(escape(note))
    console.print(_table(done))
    for file in done.files:
        console.print(escape(str(file)))
    console.print(f"{seconds:.1f} s. For cameras and motion: imocap run {escape(done.action)}")


def _table(done: Synchronised) -> Table:
    from rich.table import Table

    sync = done.sync
    table = Table("video", "matched", "mean rate", "confidence", "offset", box=None, pad_edge=False)
    for row in done.rows:
        if row.video == sync.reference:
            table.add_row(row.video, "reference", "", "", "")
        elif row.matched == 0:
            why = "excluded" if row.video in sync.excluded else "unmatched"
            table.add_row(row.video, why, "", "", "")
        else:
            table.add_row(
                f"{row.video} (mirrored)" if row.video in sync.mirrored else row.video,
                f"{row.matched:.0%}",
                f"{row.rate:.2f}",
                f"{row.confidence:.2f}",
                f"{row.offset_s:+.2f} s",
            )
    return table
