"""`imocap report`: the page of an action that has been run, made again."""

from __future__ import annotations

import typer

from imocap_core.cli.options import ActionName, root_of, speaker


def report_command(context: typer.Context, action: ActionName) -> None:
    """Make the page of an action from its results, and print its path."""
    from imocap_core.library.outputs import report

    speaker(markup=False).print(str(report(action, root=root_of(context))))
