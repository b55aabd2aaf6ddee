"""`imocap people`: who is in each video, who would perform, where the cuts are."""

from __future__ import annotations

import typer
from rich.markup import escape
from rich.table import Table

from imocap_core.cli.options import ActionName, Sets, speaker, workspace_of


def people_command(
    context: typer.Context,
    action: ActionName,
    sets: Sets = [],  # noqa: B006
) -> None:
    """List everybody who was followed in an action's videos, and cuts between shots."""
    from imocap_core.cli.people_table import listing
    from imocap_core.cli.show import Terminal

    workspace = workspace_of(context)
    console = speaker()
    with Terminal(console) as display:
        found = listing(workspace.ready_job(action, sets, display))
    for video in found:
        table = Table("track", "frames", "seen", "score", "box in the middle frame", title=video.id)
        for row in video.rows:
            table.add_row(*row)
        console.print(table)
        for sentence in video.sentences:
            console.print(escape(f"{video.id}: {sentence}"))
