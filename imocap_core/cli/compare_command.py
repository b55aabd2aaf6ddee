"""`imocap compare`: what performances share and how they differ; two performers on one axis."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from imocap_core.cli.options import ActionName, speaker, workspace_of
from imocap_core.errors import WrongUse

FOLDER = "compare"


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
    import numpy as np

    from imocap_core.compare.compare import describe, pair_of
    from imocap_core.compare.pair_report import write_pair
    from imocap_core.compare.report import write_technique
    from imocap_core.compare.sources import gather, several

    workspace = workspace_of(context)
    console = speaker(markup=False)
    job = workspace.job(action, [])
    name = job.action.name
    folder = out or job.store.report(name) / FOLDER
    first = gather(job.store, name)
    if second is None:
        found = describe(several(first))
        files = write_technique(folder, found)
        console.print(f"{name}: consistency {found.whole:.3f}")
    else:
        other = workspace.job(second, [])
        if other.action.name == name:
            raise WrongUse(f"{name} and {second} are one action; leave the second out")
        pair = pair_of(
            describe(first),
            describe(gather(other.store, other.action.name, first.shaped)),
            job.settings.params.sync,
            np.random.default_rng(job.settings.seed),
        )
        files = write_pair(folder if out else folder / other.action.name, pair)
    for file in files:
        console.print(str(file))
