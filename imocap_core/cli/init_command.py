"""`imocap init`: a new action for some videos."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from imocap_core.cli.options import root_of, speaker


def init_command(
    context: typer.Context,
    name: Annotated[str, typer.Argument(help="Name of the new action.")],
    videos: Annotated[list[Path], typer.Argument(help="Videos of one action, or their folder.")],
) -> None:
    """Make actions/NAME/action.yaml for some videos."""
    from imocap_core.library.new_action import new_action

    made = new_action(name, videos, root_of(context))
    for remark in made.remarks:
        speaker(markup=False).print(remark)
    speaker(markup=False).print(
        f"Wrote {made.file}, of {len(made.videos)} videos. Next: imocap run {name} (or make all "
        f"ACTION={name}). The first run makes an environment for the detector, BlazePose, "
        "which needs the network once."
    )
