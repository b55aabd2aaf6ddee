"""What the commands have in common: their arguments, the working folder, the terminal, `--json`.

Importing a command imports nothing heavy, so that `imocap -h` and `imocap --version` answer at
once: what a command needs it imports when it runs.
"""

from __future__ import annotations

import json
import os
import signal
import sys
import webbrowser
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from imocap_core.errors import ImocapError, Stopped

if TYPE_CHECKING:
    from rich.console import Console

    from imocap_core.library.api_errors import Progress
    from imocap_core.pick.server import Served
    from imocap_core.workspace import Workspace


BUILT_IN = ("yoga", "taichi")


def action_names(context: typer.Context, incomplete: str) -> list[str]:
    """The actions of the working folder that begin with some letters, for the shell."""
    root = Path(context.find_root().params.get("root") or ".")
    names = {file.parent.name for file in (root / "actions").glob("*/action.yaml")}
    return sorted(name for name in {*names, *BUILT_IN} if name.startswith(incomplete))


def stage_names(context: typer.Context, incomplete: str) -> list[str]:
    """The stages that begin with some letters, for the shell."""
    from imocap_core.workspace import Workspace

    root = Path(context.find_root().params.get("root") or ".")
    try:
        stages = list(Workspace(root).pipeline().stages)
    except ImocapError:
        return []
    return [stage for stage in stages if stage.startswith(incomplete)]


ActionName = Annotated[
    str,
    typer.Argument(
        help="A name below actions/, or an action's folder.", autocompletion=action_names
    ),
]
StageName = Annotated[
    str, typer.Argument(help="A stage of pipeline.yaml.", autocompletion=stage_names)
]
Sets = Annotated[
    list[str],
    typer.Option(
        "--set", metavar="GROUP.NAME=VALUE", help="A parameter for this run (see imocap params)."
    ),
]
ResultSets = Annotated[
    list[str],
    typer.Option(
        "--set", metavar="GROUP.NAME=VALUE", help="A parameter that the result was made with."
    ),
]
Device = Annotated[
    str,
    typer.Option(
        metavar="cpu|cuda",
        envvar="IMOCAP_DEVICE",
        help="Where tensors are computed; one of several as cuda:1.",
    ),
]
Verbose = Annotated[
    bool, typer.Option("--verbose", "-v", help="Show every step, all reasons and all warnings.")
]
Json = Annotated[bool, typer.Option("--json", help="Print one JSON document, for scripts.")]


def root_of(context: typer.Context) -> Path:
    """The working folder: that of --root."""
    root = context.obj
    assert isinstance(root, Path)
    return root


def workspace_of(context: typer.Context) -> Workspace:
    """The working folder with its pipeline."""
    from imocap_core.workspace import Workspace

    return Workspace(root_of(context))


def ask_about_scripts(context: typer.Context) -> None:
    """On a terminal, ask before scripts of the working folder run; elsewhere they are refused."""
    if not (sys.stdin.isatty() and sys.stdout.isatty()):
        return
    from imocap_core.pipeline.graph import allow_scripts, foreign_scripts

    scripts = foreign_scripts(workspace_of(context).pipeline())
    if scripts:
        typer.echo("The pipeline.yaml of this folder runs scripts that are no part of imocap:")
        typer.echo("".join(f"  {script}\n" for script in scripts), nl=False)
        if typer.confirm("They would run with your rights. Run them?"):
            allow_scripts(root_of(context))


def speaker(*, markup: bool = True) -> Console:
    """The terminal: long lines stay whole; without ``markup`` brackets are printed as they are."""
    from rich.console import Console

    return Console(highlight=False, soft_wrap=True, markup=markup)


@contextmanager
def progress_on(
    console: Console, as_json: bool = False, verbose: bool = False
) -> Iterator[Progress]:
    """The display of what a command does; none where it prints a document for scripts."""
    if as_json:
        yield None
        return
    from imocap_core.library.terminal import Terminal

    with Terminal(console, verbose=verbose) as display:
        yield display


def counted(number: int, thing: str) -> str:
    """'1 video', '2 videos'."""
    return f"{number} {thing}" + "s" * (number != 1)


def shortened(sentences: Sequence[str]) -> list[str]:
    """One line of several: the last sentence, and how many more --verbose shows."""
    if len(sentences) < 2:
        return list(sentences)
    others = counted(len(sentences) - 1, "more remark")
    return [f"{sentences[-1].rstrip('.')} ({others}: --verbose)."]


def print_json(document: Any) -> None:
    """Write a document of plain data, dataclass instances and paths; NaN and infinity as null."""
    sys.stdout.write(json.dumps(plain(document), indent=1, allow_nan=False) + "\n")


def plain(value: Any) -> Any:
    """The value as JSON's types."""
    from pydantic_core import to_json

    return json.loads(to_json(value, inf_nan_mode="null", fallback=lambda number: number.item()))


def wait_until_done(served: Served, open_page: bool) -> None:
    """Open a page that is served, and wait until its user is done, or for Ctrl-C.

    Without a screen no browser is opened: one for terminals would take this one.
    """
    screens = ("DISPLAY", "WAYLAND_DISPLAY", "BROWSER")
    try:
        if open_page and (sys.platform in ("darwin", "win32") or any(map(os.environ.get, screens))):
            webbrowser.open(served.address)
        while not served.done.wait(0.5):
            pass
    except Stopped as stop:
        if stop.exit_code != 128 + signal.SIGINT:
            raise
