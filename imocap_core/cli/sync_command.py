"""`imocap sync`: its options, and the table at the end."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.markup import escape
from rich.table import Table

from imocap_core.cli.options import Sets, root_of, speaker
from imocap_core.pipeline.action import DetectionFormat, Layout

if TYPE_CHECKING:
    from imocap_core.artifacts.schemas import Keypoints, SyncSummary


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
    name: Annotated[str | None, typer.Option(help="A name for the results in artifacts/.")] = None,
    reference: Annotated[
        str | None, typer.Option(help="The video whose time axis is used; else the most central.")
    ] = None,
    repetitions: Annotated[
        bool, typer.Option("--repetitions", help="Cut one long clip into its repetitions first.")
    ] = False,
    format: Annotated[
        DetectionFormat | None,
        typer.Option(help="The detector's format, if the files do not say it."),
    ] = None,
    layout: Annotated[
        Layout | None, typer.Option(help="The detector's keypoints, if the files do not say it.")
    ] = None,
    fps: Annotated[
        float | None, typer.Option(min=0.1, help="Frame rate of keypoints without a video.")
    ] = None,
    size: Annotated[
        str | None, typer.Option(metavar="WxH", help="Picture size of keypoints without a video.")
    ] = None,
    sets: Sets = [],  # noqa: B006
) -> None:
    """Synchronise videos: sync.csv, a picture and, where there are videos, one side by side."""
    from imocap_core.library.synchronising import synchronise_videos
    from imocap_core.library.terminal import Terminal

    console = speaker()
    began = time.perf_counter()
    with Terminal(console) as display:
        done = synchronise_videos(
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
            progress=display,
        )
    for note in (*done.notes, *done.sync.notes, done.sync.status):
        console.print(escape(note))
    console.print(_table(done.keypoints, done.sync.summary))
    for file in done.files:
        console.print(escape(str(file)))
    seconds = time.perf_counter() - began
    console.print(f"{seconds:.1f} s. For cameras and motion: imocap run {escape(done.action)}")


def _table(keypoints: Keypoints, sync: SyncSummary) -> Table:
    from imocap_core.figures.sync_summary import sync_rows

    table = Table("video", "matched", "mean rate", "confidence", "offset", box=None, pad_edge=False)
    for row in sync_rows(keypoints, sync):
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
