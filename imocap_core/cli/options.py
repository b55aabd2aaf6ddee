"""What the commands have in common: their arguments, where they work, how they speak."""

from __future__ import annotations

from typing import Annotated

import typer
from rich.console import Console

from imocap_core.workspace import Workspace

ActionName = Annotated[str, typer.Argument(help="A name below actions/, or an action's folder.")]
Sets = Annotated[
    list[str], typer.Option("--set", metavar="GROUP.NAME=VALUE", help="A one-off parameter.")
]


def workspace_of(context: typer.Context) -> Workspace:
    """Where a command works: the folder of --root."""
    found = context.obj
    assert isinstance(found, Workspace)
    return found


def speaker(*, markup: bool = True) -> Console:
    """The terminal: lines as they are, however long; without ``markup`` brackets are brackets."""
    return Console(highlight=False, soft_wrap=True, markup=markup)
