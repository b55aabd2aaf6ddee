"""`imocap sync`: its options, and what it says at the end."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape
from rich.table import Table

from imocap_core.cli.options import Sets, speaker, workspace_of
from imocap_core.cli.show import Terminal
from imocap_core.pipeline.action import DetectionFormat, Layout


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
    name: Annotated[str | None, typer.Option(help="A name for what is kept in artifacts/.")] = None,
    reference: Annotated[
        str | None, typer.Option(help="The video whose time axis is used; else the most central.")
    ] = None,
    repetitions: Annotated[
        bool, typer.Option("--repetitions", help="Cut one long clip into its repetitions first.")
    ] = False,
    format: Annotated[
        DetectionFormat | None,
        typer.Option(help="The detector's format, if not told by the files."),
    ] = None,
    layout: Annotated[
        Layout | None, typer.Option(help="Which joints it marks, if not told by the files.")
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
    from imocap_core.standalone_sync.run import synchronise_action
    from imocap_core.standalone_sync.sources import Given, read_size

    workspace = workspace_of(context)
    console = speaker()
    began = time.perf_counter()
    with Terminal(console) as display:
        found = synchronise_action(
            workspace,
            sources,
            Given(format, layout, fps, read_size(size)),
            name=name,
            out=out,
            reference=reference,
            repetitions=repetitions,
            sets=sets,
            display=display,
        )
    for sentence in (*found.said, *found.sync.notes, found.sync.status):
        console.print(escape(sentence))
    console.print(_table(found.keypoints, found.sync))
    for file in found.files:
        console.print(escape(str(file)))
    seconds = time.perf_counter() - began
    console.print(f"{seconds:.1f} s. All the rest of it: imocap run {escape(found.action)}")


def _table(keypoints: object, sync: object) -> Table:
    from imocap_core.artifacts.schemas import Keypoints, SyncSummary
    from imocap_core.figures.sync_summary import sync_rows

    assert isinstance(keypoints, Keypoints)
    assert isinstance(sync, SyncSummary)
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
