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
for _command in (
    init_command,
    collect_command,
    pick_command,
    run_command,
    run_all_command,
    view_command,
    export_command,
    angles_command,
    video_command,
    report_command,
    compare_command,
    sync_command,
    status_command,
    list_command,
    explain_command,
    stage_command,
    detect_command,
    people_command,
    params_command,
    formats_command,
    clean_command,
):
    app.command(_command.__name__.removesuffix("_command").replace("_", "-"))(_command)
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
