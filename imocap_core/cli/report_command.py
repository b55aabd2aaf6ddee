"""`imocap report`: the page of an action that has been run, made again."""

from __future__ import annotations

import typer

from imocap_core.cli.options import ActionName, speaker, workspace_of
from imocap_core.errors import WorkFailed


def report_command(
    context: typer.Context,
    action: ActionName,
) -> None:
    """Make the page of an action from its results, and say where it is."""
    from imocap_core.artifacts.codec import ArtifactCorrupt
    from imocap_core.report.action_report import NEEDED, bring_up_to_date, complete

    workspace = workspace_of(context)
    job = workspace.job(action, [])
    again = f"make them with: imocap run {action}"
    try:
        found = {stage: job.store.load(job.action.name, stage) for stage in job.pipeline.stages}
    except ArtifactCorrupt as error:
        raise WorkFailed(f"{str(error).splitlines()[0]}; {again}") from None
    stored = {stage: result for stage, result in found.items() if result is not None}
    if not complete(stored):
        missing = ", ".join(stage for stage in NEEDED if stage not in stored)
        raise WorkFailed(f"{action}: the results of {missing or 'its stages'} are missing; {again}")
    speaker(markup=False).print(str(bring_up_to_date(job, stored)))
