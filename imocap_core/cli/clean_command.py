"""`imocap clean`: the contents of the cache, and what was removed."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from imocap_core.cli.options import action_names, root_of, speaker

if TYPE_CHECKING:
    from rich.table import Table

    from imocap_core.library.cleaning import Cleaning


def clean_command(
    context: typer.Context,
    action: Annotated[
        str | None,
        typer.Argument(
            help="Remove only results that this action and no other has used.",
            autocompletion=action_names,
        ),
    ] = None,
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
    cleaning = clean(
        action, older_days=older, max_bytes=max_bytes, dry_run=dry_run, root=root_of(context)
    )
    console = speaker(markup=False)
    if cleaning.rows:
        console.print(_table(cleaning))
    verb = "Would remove" if dry_run else "Removed"
    console.print(
        f"{verb} {_count(cleaning.removed, 'result')} ({size_text(cleaning.removed_bytes)}) and "
        f"{_count(cleaning.leftovers, 'leftover')} ({size_text(cleaning.leftover_bytes)})."
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


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}" + ("" if number == 1 else "s")


def _table(cleaning: Cleaning) -> Table:
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
