"""`imocap view`: its options, and what it says at the end."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape

from imocap_core.cli.options import ActionName, speaker, workspace_of
from imocap_core.errors import WorkFailed, WrongUse


def view_command(
    context: typer.Context,
    action: ActionName,
    out: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Where to write the page instead.")
    ] = None,
) -> None:
    """Write the viewer of an action, one HTML file that needs nothing else, and say where it is."""
    from imocap_core.viewer.page import FILE_NAME, can_be_viewed, write_viewer

    workspace = workspace_of(context)
    console = speaker()
    job = workspace.job(action, [])
    name, report = job.action.name, report_page(job.store.report(job.action.name))
    if out is not None and (out.is_dir() or out.suffix.lower() not in (".html", ".htm")):
        raise WrongUse(f"--out {out}: expected the name of an .html file")
    if report is None and not can_be_viewed(job.store, name):
        raise WorkFailed(f"{action} has no report yet; make one with: imocap run {action}")
    if report is not None:
        console.print(f"The report of {name} is {escape(str(report))}; open it in a browser.")
    if out is None and report is not None and not can_be_viewed(job.store, name):
        return
    file = out or job.store.report(name) / FILE_NAME
    with console.status("") as status:
        written = write_viewer(
            job.store,
            job.action,
            file,
            lambda share, what: status.update(f"viewer: {escape(what)}"),
        )
    how = f"{file.stat().st_size / 1e6:.1f} MB" + ("" if written else ", already up to date")
    console.print(f"The viewer of {name} is {escape(str(file))} ({how}); open it in a browser.")


def report_page(folder: Path) -> Path | None:
    """The page to open first in a report's folder; the folder itself when it has none."""
    for name in ("report.html", "index.html", "report.md", "index.md"):
        if (folder / name).is_file():
            return folder / name
    return folder if folder.is_dir() else None
