"""The commands, in the order in which people need them."""

from __future__ import annotations

from copy import copy
from functools import cache
from pathlib import Path
from typing import Annotated, Any

import typer

from imocap_core.cli.action_commands import (
    clean_command,
    collect_command,
    detect_command,
    init_command,
    list_command,
    people_command,
    pick_command,
    pull_command,
    push_command,
)
from imocap_core.cli.reference_commands import (
    add_benchmarks,
    doctor_command,
    formats_command,
    params_command,
)
from imocap_core.cli.result_commands import (
    angles_command,
    compare_command,
    export_command,
    report_command,
    sync_command,
    video_command,
    view_command,
)
from imocap_core.cli.run_commands import (
    explain_command,
    run_all_command,
    run_command,
    stage_command,
    status_command,
)
from imocap_core.errors import WrongUse
from imocap_core.version import __version__

app = typer.Typer(
    name="imocap",
    help="Motion capture from several unsynchronised, uncalibrated videos.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)
app.command("init")(init_command)
app.command("collect")(collect_command)
app.command("pick")(pick_command)
app.command("run")(run_command)
app.command("run-all")(run_all_command)
app.command("view")(view_command)
app.command("export")(export_command)
app.command("angles")(angles_command)
app.command("video")(video_command)
app.command("report")(report_command)
app.command("compare")(compare_command)
app.command("sync")(sync_command)
app.command("status")(status_command)
app.command("list")(list_command)
app.command("explain")(explain_command)
app.command("stage")(stage_command)
app.command("detect")(detect_command)
app.command("people")(people_command)
app.command("params")(params_command)
app.command("formats")(formats_command)
app.command("push")(push_command)
app.command("pull")(pull_command)
app.command("clean")(clean_command)
add_benchmarks(app)
app.command("doctor")(doctor_command)


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"imocap {__version__}")
        raise typer.Exit


@app.callback()
def _everywhere(
    context: typer.Context,
    root: Annotated[
        Path, typer.Option("--root", help="Working folder, with actions/ and artifacts/.")
    ] = Path(),
    traceback: Annotated[
        bool, typer.Option("--traceback", help="Print the traceback of an error.")
    ] = False,
    allow_scripts: Annotated[
        bool,
        typer.Option(
            "--allow-scripts", help="Run stages of the folder's pipeline.yaml that lie in it."
        ),
    ] = False,
    version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_print_version, is_eager=True, help="Print the version."
        ),
    ] = False,
) -> None:
    if not root.is_dir():
        raise WrongUse(f"--root {root}: the folder does not exist")
    context.obj = root
    if allow_scripts:
        from imocap_core.pipeline.graph import allow_scripts as allow

        allow(root)


@cache
def command_line(word: str | None) -> Any:
    """Click's command of all commands; of one alone where `word` names it, because to read the
    options of the others takes longer than many a command."""
    named = [info for info in app.registered_commands if info.name == word]
    if not named:
        return typer.main.get_command(app)
    only = copy(app)
    only.registered_commands, only.registered_groups = named, []
    return typer.main.get_command(only)
