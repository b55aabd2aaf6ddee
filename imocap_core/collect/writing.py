"""action.yaml of collected occurrences, each with a comment that says where it is from."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

from imocap_core.collect.listing import CollectedList, ListedOccurrence
from imocap_core.pipeline.action import DETECT, FILE_NAME
from imocap_core.whole_files import write_whole

HEAD = """\
# Collected by imocap: every video is an occurrence of the action in a longer film. collected.json
# lists all shots and occurrences, and why some are not here. More fields: see docs/actions.md.
"""


def write_action(folder: Path, collected: CollectedList, alone: dict[str, bool]) -> Path:
    """Write folder/action.yaml; its path.

    alone: of each chosen occurrence, whether its shot shows nobody else.
    """
    parts = [HEAD, f"name: {collected.name}\n", "videos:\n"]
    for occurrence in collected.chosen:
        parts += [f"  # {_comment(collected, occurrence)}\n"]
        entry = _entry(collected, occurrence, alone=alone[occurrence.id])
        text = yaml.safe_dump([entry], sort_keys=False, default_flow_style=None, width=1000)
        parts += [f"  {line}\n" for line in text.splitlines()]
    file = folder / FILE_NAME
    write_whole(file, "".join(parts))
    return file


def clock(time_s: float) -> str:
    """Minutes and seconds, with hours where there are any: 1:02.4, 1:00:02.4."""
    minutes, rest = divmod(round(time_s, 1), 60)
    hours, minutes = divmod(int(minutes), 60)
    return f"{hours}:{minutes:02d}:{rest:04.1f}" if hours else f"{minutes}:{rest:04.1f}"


def _comment(collected: CollectedList, o: ListedOccurrence) -> str:
    film = Path(collected.films[o.film].video).name
    speed = "" if 0.8 < o.speed < 1.25 else f", about {o.speed:.2g} times the speed"
    first, last = map(clock, o.seconds)
    where = f"{_one_line(film)}, shot {o.shot}, {first} to {last}"
    return f"{where}: {o.view}, {o.height_px:.0f} px{speed}"


def _one_line(text: str) -> str:
    """A file's name without what would end a comment."""
    return "".join(c if c.isprintable() else "?" for c in text)


def _entry(collected: CollectedList, o: ListedOccurrence, *, alone: bool) -> dict[str, Any]:
    entry: dict[str, Any] = {
        "id": o.id,
        "video": collected.films[o.film].video,
        "keypoints": DETECT,
        "frames": list(o.frames),
    }
    if o.mirrored:
        entry["mirrored"] = True
    if not alone:
        entry["person"] = {"frame": o.box_frame, "box": [round(x) for x in o.box_px]}
    return entry
