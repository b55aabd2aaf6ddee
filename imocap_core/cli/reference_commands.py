"""Commands on the program itself: `params`, `formats`, `doctor`, `benchmark`."""

from __future__ import annotations

import shutil
import textwrap
from importlib import import_module
from typing import TYPE_CHECKING, Annotated

import typer

from imocap_core.cli.options import Json, print_json, root_of, speaker
from imocap_core.errors import WorkFailed, WrongUse

if TYPE_CHECKING:
    from collections.abc import Iterable

    from imocap_core.library.doctor import Check


def _group_names(incomplete: str) -> list[str]:
    """The groups of parameters that begin with some letters, for the shell."""
    from dataclasses import fields

    from imocap_core.params import Params

    return [field.name for field in fields(Params) if field.name.startswith(incomplete)]


def params_command(
    context: typer.Context,
    group: Annotated[
        str | None,
        typer.Argument(help="Only this group, as sync or motion.", autocompletion=_group_names),
    ] = None,
    as_json: Json = False,
) -> None:
    """List the parameters, with units, bounds and meaning.

    Set them under `params` in action.yaml, or for one run with --set GROUP.NAME=VALUE.
    """
    from imocap_core.library.status import parameters

    rows = parameters(group, root=root_of(context))
    if as_json:
        print_json({"parameters": rows})
        return
    width = min(shutil.get_terminal_size().columns, 100)
    for row in rows:
        default = [] if row.value == row.default else [f"default {_yaml(row.default)}"]
        facts = "; ".join([part for part in (row.unit, row.bounds) if part] + default)
        typer.echo(f"{row.group}.{row.name} = {_yaml(row.value)}  ({facts})")
        typer.echo(textwrap.fill(row.doc, width, initial_indent="    ", subsequent_indent="    "))


def _yaml(value: object) -> str:
    import json

    return json.dumps(value) if not isinstance(value, str) else value


TITLES = {
    "keypoints": "2D keypoints that are read (`format` in action.yaml, or recognised)",
    "initial": "monocular 3D estimates that are read (`initial_format` in action.yaml)",
    "export": "written by `imocap export --format`",
}


def formats_command(
    use: Annotated[
        str | None, typer.Argument(help="Only these: keypoints, initial or export.")
    ] = None,
    as_json: Json = False,
) -> None:
    """List the formats that are read and written."""
    from imocap_core.library.status import formats

    if use not in (None, *TITLES):
        raise WrongUse(f"expected one of {', '.join(TITLES)}, got {use}")
    listed = [each for each in formats() if use in (None, each.use)]
    if as_json:
        print_json({"formats": listed})
        return
    console = speaker(markup=False)
    for kind, title in TITLES.items():
        rows = [each for each in listed if each.use == kind]
        if rows:
            console.print(title)
        for each in rows:
            console.print(f"  {each.name:<16} {each.what}")


def doctor_command(context: typer.Context, as_json: Json = False) -> None:
    """Check the installation."""
    from imocap_core.library.doctor import examine

    checks = examine(root_of(context))
    if as_json:
        done = list(checks)
        print_json({"ok": all(check.works for check in done), "checks": done})
        faults = sum(not check.works for check in done)
    else:
        faults = _print(checks)
    if faults:
        raise WorkFailed(f"{faults} of the checks failed")


def _print(checks: Iterable[Check]) -> int:
    """Print each check as soon as it is done; how many failed."""
    from rich.markup import escape

    console, faults = speaker(), 0
    for check in checks:
        faults += not check.works
        mark = "[green]ok[/]  " if check.works else "[red]bad[/] "
        console.print(f"{mark} {escape(check.sentence)}")
    return faults


ABSENT = (
    "benchmarks are not part of an installed package: they are in the folder benchmarks/ of "
    "imocap's source checkout; run `imocap benchmark` there"
)


def add_benchmarks(app: typer.Typer) -> None:
    """Add the command `benchmark`, with its options where the folder benchmarks/ exists."""
    try:
        command = import_module("benchmarks.command").benchmark_command
    except ModuleNotFoundError as error:
        if error.name not in ("benchmarks", "benchmarks.command"):
            raise
        command = _absent
    absent = command is _absent
    settings = {"allow_extra_args": True, "ignore_unknown_options": True} if absent else None
    app.command("benchmark", context_settings=settings, hidden=absent)(command)


def _absent(context: typer.Context) -> None:
    """Measure accuracy, ablations or speed (source checkout only)."""
    raise WorkFailed(ABSENT)
