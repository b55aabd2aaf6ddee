"""`imocap init`: a new action for some videos."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from imocap_core.cli.options import root_of, speaker


def init_command(
    context: typer.Context,
    name: Annotated[str, typer.Argument(help="Name of the new action.")],
    videos: Annotated[list[Path], typer.Argument(help="Video files of one action.")],
) -> None:
    """Make actions/NAME/action.yaml for some videos."""
    from imocap_core.library.new_action import init_action, repetitions_of

    file = init_action(name, videos, root=root_of(context))
    for note in repetitions_of(videos):
        speaker(markup=False).print(note)
    speaker(markup=False).print(
        f"Wrote {file}. Next: imocap run {name} (or make all ACTION={name}). The first run makes "
        "an environment for the detector, BlazePose, which needs the network once."
    )
