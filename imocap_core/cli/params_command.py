"""`imocap params`: every parameter with its value, unit, bounds and meaning."""

from __future__ import annotations

import shutil
import textwrap
from typing import TYPE_CHECKING, Annotated

import typer

from imocap_core.cli.json_output import print_json
from imocap_core.cli.options import Json, root_of

if TYPE_CHECKING:
    from imocap_core.params.table import Parameter


def group_names(incomplete: str) -> list[str]:
    """The groups of parameters that begin with some letters, for the shell."""
    from dataclasses import fields

    from imocap_core.params import Params

    return [field.name for field in fields(Params) if field.name.startswith(incomplete)]


def params_command(
    context: typer.Context,
    group: Annotated[
        str | None,
        typer.Argument(help="Only this group, as sync or motion.", autocompletion=group_names),
    ] = None,
    as_json: Json = False,
) -> None:
    """List the parameters, with units, bounds and meaning.

    Set them under `params` in action.yaml, or for one run with --set GROUP.NAME=VALUE.
    """
    from imocap_core.library.parameters import parameters

    rows = parameters(group, root=root_of(context))
    if as_json:
        print_json({"parameters": rows})
        return
    width = min(shutil.get_terminal_size().columns, 100)
    for row in rows:
        typer.echo(f"{row.group}.{row.name} = {_yaml(row.value)}  ({_facts(row)})")
        typer.echo(textwrap.fill(row.doc, width, initial_indent="    ", subsequent_indent="    "))


def _facts(row: Parameter) -> str:
    default = [] if row.value == row.default else [f"default {_yaml(row.default)}"]
    return "; ".join([part for part in (row.unit, row.bounds) if part] + default)


def _yaml(value: object) -> str:
    import json

    return json.dumps(value) if not isinstance(value, str) else value
