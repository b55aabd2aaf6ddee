"""`imocap view`: its options, and the paths of the report and the viewer."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from imocap_core.cli.options import ActionName, ResultSets, root_of, speaker
from imocap_core.errors import WorkFailed


def view_command(
    context: typer.Context,
    action: ActionName,
    out: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="File to write to (default: viewer.html in the report)."),
    ] = None,
    open_page: Annotated[
        bool, typer.Option("--open", help="Open the page in the browser.")
    ] = False,
    sets: ResultSets = [],  # noqa: B006
) -> None:
    """Write the 3D viewer of an action, one HTML file.

    Prints the paths of the report and of the viewer, which needs no other file and no network.
    """
    from rich.markup import escape

    from imocap_core.library.outputs import view

    console = speaker()
    with console.status("") as status:
        viewer = view(
            action,
            out,
            root=root_of(context),
            params=sets,
            progress=lambda share, what: status.update(f"viewer: {escape(what)}"),
        )
    hint = "" if open_page else "; open it in a browser"
    name = viewer.action
    if viewer.report is not None:
        console.print(f"The report of {name} is {escape(str(viewer.report))}{hint}.")
    if viewer.file is not None:
        size = f"{viewer.file.stat().st_size / 1e6:.1f} MB"
        how = size if viewer.written else f"{size}, already up to date"
        console.print(f"The viewer of {name} is {escape(str(viewer.file))} ({how}){hint}.")
    page = viewer.file or viewer.report
    if open_page and page is not None:
        _open(page)


def _open(page: Path) -> None:
    import webbrowser

    if not webbrowser.open(page.resolve().as_uri()):
        raise WorkFailed(f"no browser could be started; open {page} yourself")
