"""`imocap init`: a new action for some videos."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from imocap_core.cli.options import counted, root_of, speaker


def init_command(
    context: typer.Context,
    name: Annotated[str, typer.Argument(help="Name of the new action.")],
    videos: Annotated[list[Path], typer.Argument(help="Videos of one action, or their folder.")],
) -> None:
    """Make actions/NAME/action.yaml for some videos."""
    from imocap_core.library.new_action import new_action
    from imocap_core.library.people import detector_is_set_up

    made = new_action(name, videos, root_of(context))
    for remark in made.remarks:
        speaker(markup=False).print(remark)
    once = (
        ""
        if detector_is_set_up(root=root_of(context))
        else " The first run fetches the detector, some 320 MB."
    )
    speaker(markup=False).print(
        f"Wrote {made.file}, of {counted(len(made.videos), 'video')}. "
        f"Next: imocap run {made.name}.{once}"
    )
