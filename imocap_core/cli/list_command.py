"""`imocap list`: the actions of the working folder, a line each."""

from __future__ import annotations

import typer

from imocap_core.cli.json_output import print_json
from imocap_core.cli.options import Json, root_of


def list_command(context: typer.Context, as_json: Json = False) -> None:
    """List the actions, whether they are cached, and their results."""
    from imocap_core.library.listing import list_actions

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
