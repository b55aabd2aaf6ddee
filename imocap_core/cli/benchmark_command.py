"""`imocap benchmark`: the measurements of a checkout, which a wheel does not include."""

from __future__ import annotations

from importlib import import_module

import typer

from imocap_core.errors import WorkFailed

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
    app.command(
        "benchmark",
        context_settings={"allow_extra_args": True, "ignore_unknown_options": True}
        if command is _absent
        else None,
    )(command)


def _absent(context: typer.Context) -> None:
    """Measure accuracy, ablations or speed (source checkout only)."""
    raise WorkFailed(ABSENT)
