"""`imocap compare`: what performances share and how they differ; two performers on one axis."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from imocap_core.cli.options import ActionName, root_of, speaker


def compare_command(
    context: typer.Context,
    action: ActionName,
    second: Annotated[
        str | None, typer.Argument(metavar="[ACTION2]", help="Another performer of the action.")
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(help="Folder to write to; else artifacts/ACTION/report/compare."),
    ] = None,
) -> None:
    """Technique: mean motion, spread of every joint, modes, consistency; or two performers."""
    from imocap_core.library.outputs import compare

    comparison = compare(action, second, out=out, root=root_of(context))
    console = speaker(markup=False)
    technique = comparison.technique
    if technique is not None:
        console.print(f"{technique.action}: consistency {technique.whole:.3f}")
    for file in comparison.files:
        console.print(str(file))
