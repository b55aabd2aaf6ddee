"""`imocap doctor`: checks of the installation, a line each."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from imocap_core.cli.json_output import print_json
from imocap_core.cli.options import Json, root_of, speaker
from imocap_core.errors import WorkFailed

if TYPE_CHECKING:
    from collections.abc import Iterable

    from imocap_core.library.doctor import Check


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
    as_json: Json = False,
) -> None:
    """Check the installation."""
    from imocap_core.library.doctor import examine

    checks = examine(root_of(context), models)
    if as_json:
        done = list(checks)
        print_json({"ok": all(check.works for check in done), "checks": done})
        faults = sum(not check.works for check in done)
    else:
        faults = _print(checks)
    if faults:
        raise WorkFailed(f"{faults} of the checks failed")


def _print(checks: Iterable[Check]) -> int:
    """Print each check as soon as it is done; how many failed."""
    from rich.markup import escape

    console, faults = speaker(), 0
    for check in checks:
        faults += not check.works
        mark = "[green]ok[/]  " if check.works else "[red]bad[/] "
        console.print(f"{mark} {escape(check.sentence)}")
    return faults
