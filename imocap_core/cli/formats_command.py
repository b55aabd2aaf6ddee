"""`imocap formats`: the files that are read and written."""

from __future__ import annotations

from typing import Annotated

import typer

from imocap_core.cli.json_output import print_json
from imocap_core.cli.options import Json, speaker

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
    from imocap_core.errors import WrongUse
    from imocap_core.library.format_listing import formats

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
