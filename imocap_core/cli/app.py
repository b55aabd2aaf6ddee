"""The commands, in the order in which people need them."""

from __future__ import annotations

from copy import copy
from functools import cache
from pathlib import Path
from typing import Annotated, Any

import typer

from imocap_core.cli import action_commands, reference_commands, result_commands, run_commands
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
    action_commands.init_command,
    action_commands.collect_command,
    action_commands.pick_command,
    run_commands.run_command,
    run_commands.run_all_command,
    result_commands.view_command,
    result_commands.export_command,
    result_commands.angles_command,
    result_commands.video_command,
    result_commands.report_command,
    result_commands.compare_command,
    result_commands.sync_command,
    run_commands.status_command,
    action_commands.list_command,
    run_commands.explain_command,
    run_commands.stage_command,
    action_commands.detect_command,
    action_commands.people_command,
    reference_commands.params_command,
    reference_commands.formats_command,
    action_commands.clean_command,
):
    app.command(_command.__name__.removesuffix("_command").replace("_", "-"))(_command)
reference_commands.add_benchmarks(app)
app.command("doctor")(reference_commands.doctor_command)


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
