"""`imocap doctor`: the checks, a line each."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape

from imocap_core.cli.options import root_of, speaker
from imocap_core.errors import WorkFailed


def doctor_command(
    context: typer.Context,
    models: Annotated[
        Path | None,
        typer.Option(
            envvar="IMOCAP_MODELS",
            exists=True,
            file_okay=False,
            help="Folder with your own SMPL, SMPL+H or SMPL-X files.",
        ),
    ] = None,
) -> None:
    """Check that everything the program needs is there and works."""
    from imocap_core.library.doctor import examine

    console, faults = speaker(), 0
    for check in examine(root_of(context), models):
        faults += not check.works
        mark = "[green]ok[/]  " if check.works else "[red]bad[/] "
        console.print(f"{mark} {escape(check.sentence)}")
    if faults:
        raise WorkFailed(f"{faults} of the checks above failed")
