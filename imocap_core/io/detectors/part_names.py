"""Points of a layout by the names that users give body parts: `LeftKnee` is left_knee."""

from __future__ import annotations

import re
from collections.abc import Sequence

from imocap_core.body.layouts import layout_names

LAYOUTS = ("coco17", "halpe26", "body25", "body25b", "coco18", "h36m17", "mediapipe33")
MIN_MATCHED = 4  # names of a layout; with fewer the layout stays unknown
_SIDES = {"l": "left", "lt": "left", "left": "left", "r": "right", "rt": "right", "right": "right"}
_SAME = {
    "bigtoe": "big_toe",
    "smalltoe": "small_toe",
    "littletoe": "small_toe",
    "little_toe": "small_toe",
    "toe": "big_toe",
    "foot_index": "big_toe",
    "headtop": "head_top",
    "top_head": "head_top",
    "top_of_head": "head_top",
    "vertex": "head_top",
    "midhip": "mid_hip",
    "hip_middle": "mid_hip",
    "pelvis": "mid_hip",
}


def plain_name(name: str) -> str:
    """left_knee for LeftKnee, L-knee, knee_l, "Left Knee"; other names in snake case."""
    words = re.sub(r"(?<=[a-z])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", " ", name).lower()
    parts = [part for part in re.split(r"[^a-z0-9]+", words) if part]
    parts = [piece for part in parts for piece in _split_side(part)]
    sides = [_SIDES[part] for part in parts if part in _SIDES]
    rest = "_".join(part for part in parts if part not in _SIDES)
    rest = _SAME.get(rest, rest)
    return f"{sides[0]}_{rest}" if len(sides) == 1 and rest else rest


def _split_side(part: str) -> tuple[str, ...]:
    """leftknee -> left, knee."""
    for side in ("left", "right"):
        if part.startswith(side) and part != side:
            return side, part.removeprefix(side)
    return (part,)


def columns_of(names: Sequence[str], layout: str) -> dict[int, int]:
    """Column of the layout -> index in `names`, for the names that the layout has."""
    index_of: dict[str, int] = {}
    for index, name in enumerate(names):
        index_of.setdefault(plain_name(name), index)
    points = [_SAME.get(name, name) for name in layout_names(layout)]
    return {column: index_of[name] for column, name in enumerate(points) if name in index_of}


def best_layout(names: Sequence[str]) -> str | None:
    """The layout with the most matched names, the smallest of several; None if too few match."""
    fitting = {layout: len(columns_of(names, layout)) for layout in LAYOUTS}
    best = max(LAYOUTS, key=lambda layout: (fitting[layout], -len(layout_names(layout))))
    return best if fitting[best] >= MIN_MATCHED else None


def matched_columns(names: Sequence[str], layout: str, where: str) -> dict[int, int]:
    """As `columns_of`; ValueError when fewer than `MIN_MATCHED` names match."""
    columns = columns_of(names, layout)
    if len(columns) < MIN_MATCHED:
        raise ValueError(
            f"{where}: expected at least {MIN_MATCHED} body parts named like {layout}'s "
            f"({', '.join(layout_names(layout))}), got {', '.join(names)}; rename them"
        )
    return columns
