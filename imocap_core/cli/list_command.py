"""`imocap list`: the actions of the working folder, a line each."""

from __future__ import annotations

import typer

from imocap_core.cli.json_output import print_json
from imocap_core.cli.options import Json, root_of, speaker


def list_command(context: typer.Context, as_json: Json = False) -> None:
    """List the actions, whether they are cached, and their results."""
    from imocap_core.library.listing import list_actions

    actions = list_actions(root_of(context))
    if as_json:
        print_json({"actions": actions})
        return
    from rich.table import Table

    table = Table("action", "videos", "state", "last result", box=None, pad_edge=False)
    for action in actions:
        state = {
            "partly cached": f"{action.cached} of {action.stages} stages cached",
            "not made": f"built in; make it: imocap run {action.name}",
        }.get(action.state, action.state)
        videos = "" if action.videos is None else str(action.videos)
        table.add_row(action.name, videos, state, action.headline or action.fault)
    speaker(markup=False).print(table)
