"""`imocap people`: the people in each video, the performer among them, and cuts between shots."""

from __future__ import annotations

import typer

from imocap_core.cli.json_output import print_json
from imocap_core.cli.options import ActionName, Json, Sets, root_of, speaker


def people_command(
    context: typer.Context,
    action: ActionName,
    sets: Sets = [],  # noqa: B006
    as_json: Json = False,
) -> None:
    """List the people tracked in each video.

    The performer comes first. Cuts between shots, and why a video cannot be used, are listed too.
    """
    from rich.markup import escape
    from rich.table import Table

    from imocap_core.library.people import people
    from imocap_core.library.terminal import Terminal

    if as_json:
        print_json({"videos": people(action, root=root_of(context), params=sets)})
        return
    console = speaker()
    with Terminal(console) as display:
        videos = people(action, root=root_of(context), params=sets, progress=display)
    for video in videos:
        table = Table("track", "frames", "visible", "score", "box, middle frame", title=video.id)
        for track in video.tracks:
            box = ", ".join(f"{value:.0f}" for value in track.box_px)
            table.add_row(
                str(track.number),
                f"{track.first_frame} to {track.last_frame}",
                f"{track.share:.0%}",
                f"{track.score:.2f}",
                escape(f"[{box}] in frame {track.box_frame}"),
            )
        if video.tracks:
            console.print(table)
        for note in video.notes:
            console.print(escape(f"{video.id}: {note}"))
        if video.fault is not None:
            console.print(escape(f"{video.id} cannot be used: {video.fault}"))
