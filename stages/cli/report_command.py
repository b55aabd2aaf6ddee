"""`imocap report`: the page of an action that has been run, made again."""

from __future__ import annotations

from typing import Annotated

import typer
from rich.console import Console

from stages.harness.errors import WorkFailed
from stages.harness.workspace import Workspace


def report_command(
    context: typer.Context,
    action: Annotated[str, typer.Argument(help="A name below actions/, or an action's folder.")],
) -> None:
    """Make the page of an action from its results, and say where it is."""
    from imocap_core.artifacts.codec import ArtifactCorrupt
    from stages.cli.report import NEEDED, bring_up_to_date, complete

    assert isinstance(context.obj, Workspace)
    job = context.obj.job(action, [])
    again = f"make them with: imocap run {action}"
    try:
        found = {stage: job.store.load(job.action.name, stage) for stage in job.pipeline.stages}
    except ArtifactCorrupt as error:
        raise WorkFailed(f"{str(error).splitlines()[0]}; {again}") from None
    stored = {stage: result for stage, result in found.items() if result is not None}
    if not complete(stored):
        missing = ", ".join(stage for stage in NEEDED if stage not in stored)
        raise WorkFailed(f"{action}: the results of {missing or 'its stages'} are missing; {again}")
    Console(highlight=False, soft_wrap=True, markup=False).print(str(bring_up_to_date(job, stored)))
