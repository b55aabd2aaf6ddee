"""The commands, each a few lines: call the library, print the result.

A command imports what it needs of the library when it is called: `status` must not load NumPy.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from imocap_core.cli.benchmark_command import add_benchmarks
from imocap_core.cli.compare_command import compare_command
from imocap_core.cli.detect_command import detect_command
from imocap_core.cli.doctor_command import doctor_command
from imocap_core.cli.export_command import export_command
from imocap_core.cli.init_command import init_command
from imocap_core.cli.people_command import people_command
from imocap_core.cli.report_command import report_command
from imocap_core.cli.run_commands import (
    explain_command,
    run_command,
    stage_command,
    status_command,
)
from imocap_core.cli.sync_command import sync_command
from imocap_core.cli.video_command import video_command
from imocap_core.cli.view_command import view_command
from imocap_core.errors import WrongUse
from imocap_core.workspace import Workspace

app = typer.Typer(
    name="imocap",
    help="Motion capture from several unsynchronised, uncalibrated videos.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
app.command("init")(init_command)
app.command("run")(run_command)
app.command("view")(view_command)
app.command("export")(export_command)
app.command("video")(video_command)
app.command("report")(report_command)
app.command("sync")(sync_command)
app.command("compare")(compare_command)
app.command("status")(status_command)
app.command("explain")(explain_command)
app.command("stage")(stage_command)
app.command("people")(people_command)
app.command("detect")(detect_command)
app.command("doctor")(doctor_command)
add_benchmarks(app)


@app.callback()
def _everywhere(
    context: typer.Context,
    root: Annotated[
        Path, typer.Option("--root", help="Folder with actions/ and artifacts/.")
    ] = Path(),
    traceback: Annotated[
        bool, typer.Option("--traceback", help="Show where an error came from.")
    ] = False,
) -> None:
    if not root.is_dir():
        raise WrongUse(f"--root {root}: there is no such folder")
    context.obj = Workspace(root)
