"""`imocap view`: its options, and the paths of the report and the viewer."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape

from imocap_core.cli.options import ActionName, root_of, speaker


def view_command(
    context: typer.Context,
    action: ActionName,
    out: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Where to write the page instead.")
    ] = None,
) -> None:
    """Write the viewer of an action, one HTML file that needs nothing else, and print its path."""
    from imocap_core.library.outputs import view

    console = speaker()
    with console.status("") as status:
        viewer = view(
            action,
            out,
            root=root_of(context),
            progress=lambda share, what: status.update(f"viewer: {escape(what)}"),
        )
    name = viewer.action
    if viewer.report is not None:
        report = escape(str(viewer.report))
        console.print(f"The report of {name} is {report}; open it in a browser.")
    if viewer.file is not None:
        size = f"{viewer.file.stat().st_size / 1e6:.1f} MB"
        how = size if viewer.written else f"{size}, already up to date"
        file = escape(str(viewer.file))
        console.print(f"The viewer of {name} is {file} ({how}); open it in a browser.")
