"""`imocap angles`: joint angles by ISB's recommendations."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from imocap_core.cli.options import ActionName, ResultSets, root_of, speaker


def angles_command(
    context: typer.Context,
    action: ActionName,
    out: Annotated[Path, typer.Option(help="Folder to write to.")],
    sets: ResultSets = [],  # noqa: B006
) -> None:
    """Write joint angles (ISB), their mean and a figure."""
    from imocap_core.library.outputs import angles

    console = speaker(markup=False)
    written = angles(action, out, root=root_of(context), params=sets)
    for line in [*written.notes, *map(str, written.files)]:
        console.print(line)
