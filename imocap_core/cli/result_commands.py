"""Commands on results: `view`, `export`, `angles`, `video`, `report`, `compare`; and `sync`."""

from __future__ import annotations

import time
import webbrowser
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from imocap_core.cli import options
from imocap_core.errors import WorkFailed, WrongUse
from imocap_core.pipeline.format_names import DetectionFormat, Layout

if TYPE_CHECKING:
    from rich.console import Console
    from rich.progress import Progress as RichProgress
    from rich.table import Table

    from imocap_core.film import Film
    from imocap_core.standalone_sync import Synchronised


def view_command(
    context: typer.Context,
    action: options.ActionName,
    out: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="File to write to (default: viewer.html in the report)."),
    ] = None,
    small: Annotated[
        bool, typer.Option("--small", help="Fewer and smaller pictures, for a phone.")
    ] = False,
    open_page: Annotated[
        bool, typer.Option("--open", help="Open the page in the browser.")
    ] = False,
    sets: options.ResultSets = [],  # noqa: B006
) -> None:
    """Write the 3D viewer of an action, one HTML file.

    Prints the paths of the report and of the viewer, which needs no other file and no network.
    """
    from rich.markup import escape

    from imocap_core.library.outputs import view

    console = options.speaker()
    with console.status("") as status:
        viewer = view(
            action,
            out,
            small=small,
            root=options.root_of(context),
            params=sets,
            progress=lambda share, what: status.update(f"viewer: {escape(what)}"),
        )
    hint = "" if open_page else "; open it in a browser"
    name = viewer.action
    if viewer.report is not None:
        console.print(f"The report of {name} is {escape(str(viewer.report))}{hint}.")
    if viewer.file is not None:
        size = f"{viewer.file.stat().st_size / 1e6:.1f} MB"
        how = size if viewer.written else f"{size}, already up to date"
        console.print(f"The viewer of {name} is {escape(str(viewer.file))} ({how}){hint}.")
    page = viewer.file or viewer.report
    if open_page and page is not None and not webbrowser.open(page.resolve().as_uri()):
        raise WorkFailed(f"no browser could be started; open {page} yourself")


FileFormat = Literal[
    "npz", "amass", "bvh", "glb", "fbx", "usd", "trc", "csv", "c3d", "opensim", "mcap", "rrd",
    "calib",
]  # fmt: skip


def export_command(
    context: typer.Context,
    action: options.ActionName,
    out: Annotated[Path, typer.Option(help="Folder to write to.")],
    format: Annotated[FileFormat, typer.Option(help="File format.")] = "npz",
    up: Annotated[
        Literal["y", "z"] | None,
        typer.Option(
            help="Align the world with the ground, this axis up (default: y for bvh, glb, fbx, "
            "usd, trc and opensim, z for c3d, mcap, rrd, amass and calib; npz and csv keep "
            "the reference camera's axes)."
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
    lock_feet: Annotated[
        bool,
        typer.Option("--lock-feet", help="Feet in contact with the ground stay where they stand."),
    ] = False,
    variation: Annotated[
        bool, typer.Option("--variation", help="The mean and the modes of variation, as clips.")
    ] = False,
    sets: options.ResultSets = [],  # noqa: B006
) -> None:
    """Write motion, cameras and sync for other programs."""
    from imocap_core.library.outputs import ExportOptions, export

    console = options.speaker(markup=False)
    videos = tuple(video or ())
    exported = export(
        action,
        out,
        format=format,
        up=up,
        time=time,
        options=ExportOptions(videos, mean, origin, names, root_bone, lock_feet, variation),
        root=options.root_of(context),
        params=sets,
        announce=console.print,
    )
    for line in [*exported.notes, *map(str, exported.files)]:
        console.print(line)


def angles_command(
    context: typer.Context,
    action: options.ActionName,
    out: Annotated[Path, typer.Option(help="Folder to write to.")],
    sets: options.ResultSets = [],  # noqa: B006
) -> None:
    """Write joint angles (ISB), their mean and a figure."""
    from imocap_core.library.outputs import angles

    console = options.speaker(markup=False)
    written = angles(action, out, root=options.root_of(context), params=sets)
    for line in [*written.notes, *map(str, written.files)]:
        console.print(line)


def video_command(
    context: typer.Context,
    action: options.ActionName,
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
    first: Annotated[
        float | None,
        typer.Option(
            "--from", metavar="SECONDS", help="Only this part of the common time, side by side."
        ),
    ] = None,
    last: Annotated[float | None, typer.Option("--to", metavar="SECONDS", help="Its end.")] = None,
    sets: options.ResultSets = [],  # noqa: B006
) -> None:
    """Write overlay and side-by-side films of an action (H.264)."""
    from imocap_core.library.outputs import films, output_folder, write_films

    console = options.speaker(markup=False)
    began = time.perf_counter()
    if (first is None) != (last is None):
        raise WrongUse("--from and --to belong together: the ends of a part, in seconds")
    planned, folder = films(
        action,
        kind=kind,
        mesh=mesh,
        motion=result,
        opacity=opacity,
        span=None if first is None or last is None else (first, last),
        root=options.root_of(context),
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


def _bars(console: Console) -> RichProgress:
    from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn

    from imocap_core.library.terminal import bars

    name, bar = TextColumn("{task.description:<24}"), BarColumn(bar_width=24)
    return bars(console, name, bar, MofNCompleteColumn(), TimeRemainingColumn())


def report_command(
    context: typer.Context,
    action: options.ActionName,
    sets: options.ResultSets = [],  # noqa: B006
) -> None:
    """Write the report page of an action from its results."""
    from imocap_core.library.outputs import report

    options.speaker(markup=False).print(
        str(report(action, root=options.root_of(context), params=sets))
    )


def compare_command(
    context: typer.Context,
    action: options.ActionName,
    second: Annotated[
        str | None,
        typer.Argument(
            metavar="[ACTION2]",
            help="The same action by another performer.",
            autocompletion=options.action_names,
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(help="Folder to write to (default: artifacts/ACTION/report/compare)."),
    ] = None,
    sets: options.ResultSets = [],  # noqa: B006
) -> None:
    """Compare performances of an action, or two performers.

    Writes the mean motion, the spread of every joint, the modes of variation and the consistency.
    """
    from imocap_core.library.outputs import compare

    comparison = compare(action, second, out=out, root=options.root_of(context), params=sets)
    console = options.speaker(markup=False)
    technique = comparison.technique
    if technique is not None:
        console.print(f"{technique.action}: consistency {technique.consistency:.3f}")
    page = next(file for file in comparison.files if file.suffix == ".html")
    console.print(str(page))
    others = [file.name for file in comparison.files if file != page]
    console.print(f"Beside it: {', '.join(others)}")


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
        str | None, typer.Option(help="Video whose time axis is used (default: a central one).")
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
    sets: options.Sets = [],  # noqa: B006
    as_json: options.Json = False,
) -> None:
    """Synchronise videos without reconstructing motion.

    Writes sync.csv, a picture and, if there are videos, a film of all videos side by side.
    """
    from imocap_core.library.synchronising import synchronise_videos

    began, console = time.perf_counter(), options.speaker()
    with options.progress_on(console, as_json) as display:
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
            root=options.root_of(context),
            params=sets,
            progress=display,
        )
    if as_json:
        options.print_json(_document(done))
    else:
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

    console = options.speaker()
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
