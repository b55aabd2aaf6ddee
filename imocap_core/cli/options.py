"""What the commands have in common: their arguments, the working folder, the terminal."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from imocap_core.workspace import Workspace

ActionName = Annotated[str, typer.Argument(help="A name below actions/, or an action's folder.")]
Sets = Annotated[
    list[str], typer.Option("--set", metavar="GROUP.NAME=VALUE", help="A one-off parameter.")
]


def workspace_of(context: typer.Context) -> Workspace:
    """The working folder with its pipeline: that of --root."""
    workspace = context.obj
    assert isinstance(workspace, Workspace)
    return workspace


def root_of(context: typer.Context) -> Path:
    """The working folder: that of --root."""
    return workspace_of(context).root


def speaker(*, markup: bool = True) -> Console:
    """The terminal: lines as they are, however long; without ``markup`` brackets are brackets."""
    return Console(highlight=False, soft_wrap=True, markup=markup)
