"""Commands on actions: `init`, `collect`, `pick`, `detect`, `people`, `list` and `clean`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from imocap_core.cli.options import (
    ActionName,
    Json,
    Sets,
    action_names,
    counted,
    print_json,
    progress_on,
    root_of,
    speaker,
    wait_until_done,
)
from imocap_core.errors import WrongUse

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from imocap_core.collect.listing import ListedFilm
    from imocap_core.library.cleaning import Cleaning
    from imocap_core.library.new_action import CollectedAction


def init_command(
    context: typer.Context,
    name: Annotated[str, typer.Argument(help="Name of the new action.")],
    videos: Annotated[list[Path], typer.Argument(help="Videos of one action, or their folder.")],
) -> None:
    """Make actions/NAME/action.yaml for some videos."""
    from imocap_core.library.new_action import new_action
    from imocap_core.library.people import detector_is_set_up

    made = new_action(name, videos, root_of(context))
    for remark in made.remarks:
        speaker(markup=False).print(remark)
    once = (
        ""
        if detector_is_set_up(root=root_of(context))
        else " The first run fetches the detector, some 320 MB."
    )
    speaker(markup=False).print(
        f"Wrote {made.file}, of {counted(len(made.videos), 'video')}. "
        f"Next: imocap run {made.name}.{once}"
    )


def collect_command(
    context: typer.Context,
    name: Annotated[str, typer.Argument(help="Name of the new action.")],
    videos: Annotated[
        list[Path],
        typer.Argument(help="Long videos (compilations, broadcasts), or folders of them."),
    ],
    example: Annotated[
        Path | None, typer.Option("--like", help="Video that shows the action, with --from, --to.")
    ] = None,
    from_s: Annotated[
        float | None, typer.Option("--from", min=0.0, help="Where the action begins in it, s.")
    ] = None,
    to_s: Annotated[
        float | None, typer.Option("--to", min=0.0, help="Where the action ends in it, s.")
    ] = None,
    keep: Annotated[
        int | None, typer.Option(min=1, help="Most videos of the action (default: collect.keep).")
    ] = None,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Only show what would be taken.")
    ] = False,
    sets: Sets = [],  # noqa: B006
    as_json: Json = False,
) -> None:
    """Make an action of the occurrences of a movement in long videos.

    Without --like, the movement that is repeated most is taken.
    """
    from imocap_core.library.new_action import collect

    span, console = _span(example, from_s, to_s), speaker()
    with progress_on(console, as_json) as display:
        done = collect(
            name,
            videos,
            example=span,
            keep=keep,
            dry_run=dry_run,
            root=root_of(context),
            params=sets,
            progress=display,
        )
    if as_json:
        print_json(done.listing.model_dump())
    else:
        _print(console, name, done)


def _span(
    example: Path | None, from_s: float | None, to_s: float | None
) -> tuple[Path, float, float] | None:
    given = [value is not None for value in (example, from_s, to_s)]
    if not any(given):
        return None
    if example is None or from_s is None or to_s is None:
        raise WrongUse("--like, --from and --to: expected all three, or none of them")
    if not from_s < to_s:
        raise WrongUse(f"--from {from_s:g} --to {to_s:g}: expected from before to")
    return example, from_s, to_s


def _print(console: Console, name: str, done: CollectedAction) -> None:
    from rich.markup import escape

    listing = done.listing
    for remark in done.remarks:
        console.print(escape(remark))
    for film in listing.films:
        console.print(_table(film))
    template = listing.template
    what = "the example" if template.given else "the movement that is repeated most"
    first, last = template.seconds
    name_of_video = Path(template.video).name
    console.print(escape(f"Looked for {what}: {name_of_video}, {first:.2f} to {last:.2f} s"))
    chosen = listing.chosen
    console.print(f"{len(listing.occurrences)} occurrences, {len(chosen)} of them videos")
    if done.action_file is None:
        why = "nothing is written" if chosen else "none can be used, so nothing is written"
        console.print(why)
        return
    console.print(escape(f"Wrote {done.action_file} and {done.list_file}"))
    console.print(escape(f"Next: imocap run {name}"))


def _table(film: ListedFilm) -> Table:
    from rich.markup import escape
    from rich.table import Table

    table = Table("shot", "from", "to", "begins with", "people", "what became of it", box=None)
    table.title = escape(Path(film.video).name)
    table.title_justify = "left"
    for shot in film.shots:
        first, last = (f"{time:.2f} s" for time in shot.seconds)
        what = escape(shot.outcome)
        style = "green" if ": a video" in shot.outcome else "dim"
        table.add_row(
            str(shot.number), first, last, shot.begins, str(shot.people), f"[{style}]{what}[/]"
        )
    return table


def pick_command(
    context: typer.Context,
    name: ActionName,
    videos: Annotated[
        list[Path] | None, typer.Argument(help="Video files or folders, to make a new action of.")
    ] = None,
    open_page: Annotated[
        bool, typer.Option("--open/--no-open", help="Open the page in the browser.")
    ] = True,
    port: Annotated[
        int, typer.Option(min=0, max=65535, help="Port on this machine (default: any free one).")
    ] = 0,
) -> None:
    """Choose performers, frames and anchors on a page in the browser.

    The page is served on this machine only, until Done or Ctrl-C, and writes action.yaml.
    """
    from imocap_core.pick.server import picking

    console = speaker(markup=False)
    serving = picking(name, videos or [], root_of(context), port, console.print)
    with serving as served:
        for remark in served.remarks:
            console.print(remark)
        console.print(f"Pick at {served.address}")
        console.print("The address is for you alone. Done on the page, or Ctrl-C, ends it.")
        wait_until_done(served, open_page)
    console.print(f"action.yaml is up to date. Next: imocap run {name}")


def detect_command(
    context: typer.Context,
    action: Annotated[
        str | None,
        typer.Argument(
            help="A name below actions/, or an action's folder.", autocompletion=action_names
        ),
    ] = None,
    setup: Annotated[
        bool, typer.Option("--setup", help="Only make the detector's environment.")
    ] = False,
    sets: Sets = [],  # noqa: B006
) -> None:
    """Detect people in the videos, and nothing more.

    Runs on the videos with `keypoints: detect`, and prints the files of keypoints.
    """
    from rich.markup import escape

    from imocap_core.library.people import detect, not_detected, set_up_detector

    console = speaker()
    if (action is None) != setup:
        raise WrongUse("expected an action, or --setup alone: imocap detect ACTION")
    with progress_on(console) as display:
        if action is None:
            detector, python = set_up_detector(root=root_of(context), params=sets, progress=display)
            lines = [f"{detector} runs in {python}"]
        else:
            files = detect(action, root=root_of(context), params=sets, progress=display)
            lines = [f"{video}: {file}" for video, file in files.items()]
            faults = not_detected(action, root=root_of(context), params=sets)
            lines += [f"{video} cannot be used: {fault}" for video, fault in faults.items()]
            lines = lines or [f"{action}: no video has keypoints: detect"]
    console.print(*map(escape, lines), sep="\n")


def people_command(
    context: typer.Context,
    action: ActionName,
    sets: Sets = [],  # noqa: B006
    as_json: Json = False,
) -> None:
    """List the people tracked in each video.

    The performer comes first. Cuts between shots, and why a video cannot be used, are listed too.
    """
    from rich.markup import escape
    from rich.table import Table

    from imocap_core.library.people import people

    console = speaker()
    with progress_on(console, as_json) as display:
        videos = people(action, root=root_of(context), params=sets, progress=display)
    if as_json:
        print_json({"videos": videos})
        return
    for video in videos:
        table = Table("track", "frames", "visible", "score", "box, middle frame", title=video.id)
        for track in video.tracks:
            box = ", ".join(f"{value:.0f}" for value in track.box_px)
            table.add_row(
                str(track.number),
                f"{track.first_frame} to {track.last_frame}",
                f"{track.share:.0%}",
                f"{track.score:.2f}",
                escape(f"[{box}] in frame {track.box_frame}"),
            )
        if video.tracks:
            console.print(table)
        for note in video.notes:
            console.print(escape(f"{video.id}: {note}"))
        if video.fault is not None:
            console.print(escape(f"{video.id} cannot be used: {video.fault}"))


def list_command(context: typer.Context, as_json: Json = False) -> None:
    """List the actions, whether they are cached, and their results."""
    from imocap_core.library.status import list_actions

    actions = list_actions(root_of(context))
    if as_json:
        print_json({"actions": actions})
        return
    rows = [("action", "videos", "state", "last result")]
    for action in actions:
        state = {
            "partly cached": f"{action.cached} of {action.stages} stages cached",
            "not made": "built in, not made yet",
        }.get(action.state, action.state)
        videos = "" if action.videos is None else str(action.videos)
        rows.append((action.name, videos, state, action.headline or action.fault))
    widths = [max(len(row[column]) for row in rows) for column in range(3)]
    for row in rows:
        cells = [f"{cell:<{width}}" for cell, width in zip(row, widths, strict=False)]
        typer.echo("  ".join([*cells, row[-1]]).rstrip())


def clean_command(
    context: typer.Context,
    older: Annotated[
        float | None,
        typer.Option(min=0, metavar="DAYS", help="Remove results not used for this many days."),
    ] = None,
    max_size: Annotated[
        str | None,
        typer.Option(metavar="SIZE", help="Remove results until the cache fits, as in 2GB."),
    ] = None,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Only show what would be removed.")
    ] = False,
) -> None:
    """Remove old results and leftovers of killed runs.

    The least recently used results go first. Current artifacts are never removed. Without --older
    and --max-size only leftovers are removed.
    """
    from imocap_core.library.cleaning import bytes_of, clean

    max_bytes = None if max_size is None else bytes_of(max_size)
    cleaning = clean(older_days=older, max_bytes=max_bytes, dry_run=dry_run, root=root_of(context))
    console = speaker(markup=False)
    if cleaning.rows:
        console.print(_cache_table(cleaning))
    verb = "Would remove" if dry_run else "Removed"
    console.print(
        f"{verb} {counted(cleaning.removed, 'result')} ({size_text(cleaning.removed_bytes)}) and "
        f"{counted(cleaning.leftovers, 'leftover')} ({size_text(cleaning.leftover_bytes)})."
    )
    if older is None and max_bytes is None:
        console.print("To remove results, give --older DAYS or --max-size SIZE.")
    remaining = cleaning.size_bytes - cleaning.removed_bytes
    if max_bytes is not None and remaining > max_bytes:
        console.print(f"The results that must stay take {size_text(remaining)}.")


def size_text(size_bytes: int) -> str:
    """A size for people: 0 B, 12.3 kB, 4.5 GB."""
    value, units = float(size_bytes), ["B", "kB", "MB", "GB", "TB"]
    while value >= 999.5 and len(units) > 1:
        value, units = value / 1000, units[1:]
    return f"{value:.0f} {units[0]}" if units[0] == "B" else f"{value:.1f} {units[0]}"


def _cache_table(cleaning: Cleaning) -> Table:
    from rich.table import Table

    table = Table("cache", "results", "size", "in use", "removed", box=None, pad_edge=False)
    for column in table.columns[1:]:
        column.justify = "right"
    for row in cleaning.rows:
        size = size_text(row.size_bytes)
        table.add_row(row.stage, str(row.results), size, str(row.in_use), str(row.removed))
    results, in_use = (sum(getattr(r, f) for r in cleaning.rows) for f in ("results", "in_use"))
    total = size_text(cleaning.size_bytes)
    table.add_row("total", str(results), total, str(in_use), str(cleaning.removed))
    return table
