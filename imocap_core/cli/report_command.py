"""`imocap report`: the report page of an action, made from its results."""

from __future__ import annotations

import typer

from imocap_core.cli.options import ActionName, ResultSets, root_of, speaker


def report_command(
    context: typer.Context,
    action: ActionName,
    sets: ResultSets = [],  # noqa: B006
) -> None:
    """Write the report page of an action from its results."""
    from imocap_core.library.outputs import report

    speaker(markup=False).print(str(report(action, root=root_of(context), params=sets)))
