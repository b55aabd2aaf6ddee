"""`imocap people`: who is in each video, who would perform, where the cuts are."""

from __future__ import annotations

from typing import Annotated

import typer
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from stages.harness.workspace import Workspace


def people_command(
    context: typer.Context,
    action: Annotated[str, typer.Argument(help="A name below actions/, or an action's folder.")],
    sets: Annotated[
        list[str], typer.Option("--set", metavar="GROUP.NAME=VALUE", help="A one-off parameter.")
    ] = [],  # noqa: B006
) -> None:
    """List everybody who was followed in an action's videos, and cuts between shots."""
    from stages.cli.people import listing
    from stages.cli.show import Terminal

    workspace = context.obj
    assert isinstance(workspace, Workspace)
    console = Console(highlight=False, soft_wrap=True)
    with Terminal(console) as display:
        found = listing(workspace.ready_job(action, sets, display))
    for video in found:
        table = Table("track", "frames", "seen", "score", "box in the middle frame", title=video.id)
        for row in video.rows:
            table.add_row(*row)
        console.print(table)
        for sentence in video.said:
            console.print(escape(f"{video.id}: {sentence}"))
