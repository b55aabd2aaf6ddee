"""`imocap pick`: choose performers, spans and anchors on a page in the browser."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer

from imocap_core.cli.options import action_names, root_of, speaker
from imocap_core.errors import Stopped


def pick_command(
    context: typer.Context,
    name: Annotated[
        str,
        typer.Argument(
            help="A name below actions/, or an action's folder.", autocompletion=action_names
        ),
    ],
    videos: Annotated[
        list[Path] | None, typer.Argument(help="Video files or folders, to make a new action of.")
    ] = None,
    open_page: Annotated[
        bool, typer.Option("--open/--no-open", help="Open the page in the browser.")
    ] = True,
    port: Annotated[
        int, typer.Option(min=0, max=65535, help="Port on this machine (default: any free one).")
    ] = 0,
) -> None:
    """Choose performers, frames and anchors on a page in the browser.

    The page is served on this machine only, until Done or Ctrl-C, and writes action.yaml.
    """
    import webbrowser

    from imocap_core.pick.pick import picking

    console = speaker(markup=False)
    serving = picking(name, videos or [], root_of(context), port, console.print)
    with serving as served, _interrupted():
        for remark in served.remarks:
            console.print(remark)
        console.print(f"Pick at {served.address}")
        console.print("The address is for you alone. Done on the page, or Ctrl-C, ends it.")
        if open_page and _has_screen():
            webbrowser.open(served.address)
        while not served.done.wait(0.5):
            pass
    console.print(f"action.yaml is up to date. Next: imocap run {name}")


@contextmanager
def _interrupted() -> Iterator[None]:
    """A body that Ctrl-C ends without an error."""
    try:
        yield
    except Stopped as stop:
        if stop.exit_code != 128 + signal.SIGINT:
            raise


def _has_screen() -> bool:
    """Whether a browser has where to open: without, one for terminals would take this one."""
    return sys.platform in ("darwin", "win32") or any(
        os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY", "BROWSER")
    )
