"""`imocap detect`: detect the people in an action's videos, and nothing more."""

from __future__ import annotations

from typing import Annotated

import typer

from imocap_core.cli.options import Sets, action_names, root_of, speaker
from imocap_core.errors import WrongUse


def detect_command(
    context: typer.Context,
    action: Annotated[
        str | None,
        typer.Argument(
            help="A name below actions/, or an action's folder.", autocompletion=action_names
        ),
    ] = None,
    setup: Annotated[
        bool, typer.Option("--setup", help="Only make the detector's environment.")
    ] = False,
    sets: Sets = [],  # noqa: B006
) -> None:
    """Detect people in the videos, and nothing more.

    Runs on the videos with `keypoints: detect`, and prints the files of keypoints.
    """
    from rich.markup import escape

    from imocap_core.library.people import detect, not_detected, set_up_detector
    from imocap_core.library.terminal import Terminal

    console = speaker()
    if (action is None) != setup:
        raise WrongUse("expected an action, or --setup alone: imocap detect ACTION")
    with Terminal(console) as display:
        if action is None:
            detector, python = set_up_detector(root=root_of(context), params=sets, progress=display)
            lines = [f"{detector} runs in {python}"]
        else:
            files = detect(action, root=root_of(context), params=sets, progress=display)
            lines = [f"{video}: {file}" for video, file in files.items()]
            faults = not_detected(action, root=root_of(context), params=sets)
            lines += [f"{video} cannot be used: {fault}" for video, fault in faults.items()]
            lines = lines or [f"{action}: no video has keypoints: detect"]
    console.print(*map(escape, lines), sep="\n")
