"""One video of an action.yaml made several of one file, with its anchors and forbidden spans."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

from ruamel.yaml.comments import CommentedMap

from imocap_core.pick.entries import flow, put, video_entry


def split_video(data: Any, video: str, starts: Sequence[int], count: int | None) -> None:
    """Split a video where new ones begin; the first part keeps its id.

    ValueError when a place is outside the used frames.
    """
    entry = video_entry(data, video)
    if entry.get("frames") is None and count is None:
        raise ValueError(f"{video}: its frames are not counted yet; wait until it has been read")
    first, stop = entry.get("frames") or (0, count or 0)
    edges: list[int] = [first, *sorted(set(starts)), stop]
    if any(b <= a for a, b in pairwise(edges)):
        raise ValueError(f"{video}: expected places to split between frames {first} and {stop}")
    names = [video, *_new_names(data, video, len(edges) - 2)]
    parts = dict(zip(names, pairwise(edges), strict=True))
    place = data["videos"].index(entry) + 1
    for name, span in list(parts.items())[1:]:
        part = _plain(entry) | {"id": name, "frames": list(span)}
        _leave_person(part, span)
        data["videos"].insert(place, _as_written(entry, part))
        place += 1
    put(entry, "frames", list(parts[video]))
    if not _person_is_in(entry, parts[video]):
        put(entry, "person", None)
    for anchor in data.get("anchors") or []:
        _move_anchor(anchor, video, parts)
    _split_forbidden(data, video, parts)


def _new_names(data: Any, video: str, number: int) -> list[str]:
    taken = {entry["id"] for entry in data["videos"]}
    names: list[str] = []
    n = 2
    while len(names) < number:
        if f"{video}_{n}" not in taken:
            names.append(f"{video}_{n}")
        n += 1
    return names


def _plain(value: Any) -> Any:
    """Without comments, which belong to the original."""
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    return [_plain(item) for item in value] if isinstance(value, list) else value


def _as_written(entry: Any, part: dict[str, Any]) -> Any:
    """In one line where the original is, else a line a field."""
    if not isinstance(entry, CommentedMap):
        return part
    if entry.fa.flow_style():
        return flow(part)
    return CommentedMap((field, flow(value)) for field, value in part.items())


def _person_is_in(entry: Any, span: tuple[int, int]) -> bool:
    person = entry.get("person")
    return person is None or person.get("frame") is None or span[0] <= person["frame"] < span[1]


def _leave_person(part: dict[str, Any], span: tuple[int, int]) -> None:
    """Without the performer of other frames, or by a number, which another part may not have."""
    person = part.get("person")
    if person is not None and (person.get("track") or not _person_is_in(part, span)):
        del part["person"]


def _move_anchor(anchor: Any, video: str, parts: Mapping[str, tuple[int, int]]) -> None:
    """To the part of a video that its frame is in."""
    frame = anchor.get(video)
    for name, (first, stop) in parts.items():
        if frame is not None and first <= frame < stop and name != video:
            del anchor[video]
            anchor[name] = frame


def _split_forbidden(data: Any, video: str, parts: Mapping[str, tuple[int, int]]) -> None:
    spans = data.get("forbidden") or []
    for span in [s for s in spans if s["video"] == video]:
        first, stop = span["frames"]
        inside = {n: (max(a, first), min(b, stop)) for n, (a, b) in parts.items()}
        for name, (a, b) in inside.items():
            if a < b:
                spans.append(flow({"video": name, "frames": [a, b]}))
        spans.remove(span)
