"""`imocap detect`: find the people in an action's videos, and nothing more."""

from __future__ import annotations

from typing import Annotated

import typer
from rich.markup import escape

from imocap_core.cli.options import Sets, speaker, workspace_of
from imocap_core.cli.show import Terminal
from imocap_core.errors import WrongUse
from imocap_core.workspace import Workspace


def detect_command(
    context: typer.Context,
    action: Annotated[
        str | None, typer.Argument(help="A name below actions/, or an action's folder.")
    ] = None,
    setup: Annotated[
        bool, typer.Option("--setup", help="Only make the detector's environment.")
    ] = False,
    sets: Sets = [],  # noqa: B006
) -> None:
    """Find people in the videos that say `keypoints: detect`, and say where the keypoints are."""
    workspace = workspace_of(context)
    console = speaker()
    if (action is None) != setup:
        raise WrongUse("expected an action, or --setup alone: imocap detect ACTION")
    with Terminal(console) as display:
        if action is None:
            said = [_set_up(workspace, sets, display)]
        else:
            job = workspace.ready_job(action, sets, display)
            found = job.action.detected.items()
            said = [f"{video}: {file}" for video, file in found]
            said = said or [f"{job.action.file}: no video says keypoints: detect"]
    console.print(*map(escape, said), sep="\n")


def _set_up(workspace: Workspace, sets: list[str], display: Terminal) -> str:
    """Make the environment of the detector in force; which Python it is."""
    from imocap_core.detect.detectors import detector_of
    from imocap_core.detect.environment import python_for
    from imocap_core.pipeline.graph import settings

    pipeline = workspace.pipeline()
    params = settings(pipeline, {}, pipeline.file, sets).params
    detector = detector_of(params.detect, workspace.root)
    display.started("detect", [f"{detector.version} needs an environment of its own"])
    python = python_for(detector.packages, workspace.root, lambda what: display.progress(0.0, what))
    return f"{detector.version} runs in {python}"
