"""`imocap collect`: an action out of long videos, and the table of their shots."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from imocap_core.cli.json_output import print_json
from imocap_core.cli.options import Json, Sets, root_of, speaker
from imocap_core.errors import WrongUse

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from imocap_core.collect.listing import CollectedList, ListedFilm
    from imocap_core.library.collecting import CollectedAction
    from imocap_core.library.progress import Progress


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
    from imocap_core.library.collecting import collect
    from imocap_core.library.terminal import Terminal

    span = _span(example, from_s, to_s)

    def work(progress: Progress) -> CollectedAction:
        return collect(
            name,
            videos,
            example=span,
            keep=keep,
            dry_run=dry_run,
            root=root_of(context),
            params=sets,
            progress=progress,
        )

    if as_json:
        print_json(work(None).listing.model_dump())
        return
    console = speaker()
    with Terminal(console) as display:
        done = work(display)
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
    console.print(escape(_template_sentence(listing)))
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


def _template_sentence(listing: CollectedList) -> str:
    template = listing.template
    what = "the example" if template.given else "the movement that is repeated most"
    first, last = template.seconds
    return f"Looked for {what}: {Path(template.video).name}, {first:.2f} to {last:.2f} s"
