"""Entries of an action.yaml, plain or with comments, and their fields as people write them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ruamel.yaml.comments import CommentedMap, CommentedSeq


def video_entry(data: Any, video: str) -> Any:
    """The entry of a video. ValueError when there is none."""
    for entry in data["videos"]:
        if entry["id"] == video:
            return entry
    raise ValueError(f"there is no video {video} in action.yaml")


def flow(value: Any) -> Any:
    """Lists and mappings in one line, as people write them."""
    if isinstance(value, dict):
        line: Any = CommentedMap((key, flow(item)) for key, item in value.items())
    elif isinstance(value, (list, tuple)):
        line = CommentedSeq(map(flow, value))
    else:
        return value
    line.fa.set_flow_style()
    return line


def put(entry: Any, field: str, value: Any) -> None:
    """Set a field; without a value it is null where it stands, and else absent.

    A new field comes before the last one, behind which comments on what follows may stand.
    """
    if field in entry:
        entry[field] = flow(value)
    elif value is not None and isinstance(entry, CommentedMap):
        entry.insert(max(len(entry) - 1, 1), field, flow(value))
    elif value is not None:
        entry[field] = value if not isinstance(value, tuple) else list(value)


def remove_items(data: Any, field: str, unwanted: Callable[[Any], bool]) -> None:
    """Remove items of a list; the field goes with the last one."""
    items = data.get(field) or []
    for n in reversed([n for n, item in enumerate(items) if unwanted(item)]):
        del items[n]
    if field in data and not items:
        del data[field]


def listed(data: Any, item: Any) -> Any:
    """A list of one item for a field of `data`, an item a line."""
    return CommentedSeq([item]) if isinstance(data, CommentedMap) else [item]
