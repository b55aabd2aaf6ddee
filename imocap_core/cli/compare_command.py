"""`imocap compare`: differences between performances of an action, or between two performers."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from imocap_core.cli.options import ActionName, ResultSets, action_names, root_of, speaker


def compare_command(
    context: typer.Context,
    action: ActionName,
    second: Annotated[
        str | None,
        typer.Argument(
            metavar="[ACTION2]",
            help="The same action by another performer.",
            autocompletion=action_names,
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(help="Folder to write to (default: artifacts/ACTION/report/compare)."),
    ] = None,
    sets: ResultSets = [],  # noqa: B006
) -> None:
    """Compare performances of an action, or two performers.

    Writes the mean motion, the spread of every joint, the modes of variation and the consistency.
    """
    from imocap_core.library.outputs import compare

    comparison = compare(action, second, out=out, root=root_of(context), params=sets)
    console = speaker(markup=False)
    technique = comparison.technique
    if technique is not None:
        console.print(f"{technique.action}: consistency {technique.whole:.3f}")
    for file in comparison.files:
        console.print(str(file))
