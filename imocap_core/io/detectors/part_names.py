"""Body parts by the names that people give them: which point of a layout `LeftKnee` is."""

from __future__ import annotations

import re
from collections.abc import Sequence

from imocap_core.body.layouts import layout_names

LAYOUTS = ("coco17", "halpe26", "body25", "body25b", "coco18", "h36m17", "mediapipe33")
FEWEST = 4  # matched names; fewer tell no person
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
    """left_knee for LeftKnee, L-knee, knee_l, "Left Knee"; other names in lower snake case."""
    words = re.sub(r"(?<=[a-z])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", " ", name).lower()
    parts = [part for part in re.split(r"[^a-z0-9]+", words) if part]
    parts = [piece for part in parts for piece in _split_side(part)]
    sides = [_SIDES[part] for part in parts if part in _SIDES]
    rest = "_".join(part for part in parts if part not in _SIDES)
    rest = _SAME.get(rest, rest)
    return f"{sides[0]}_{rest}" if len(sides) == 1 and rest else rest


def _split_side(part: str) -> tuple[str, ...]:
    """leftknee as left, knee."""
    for side in ("left", "right"):
        if part.startswith(side) and part != side:
            return side, part.removeprefix(side)
    return (part,)


def columns_of(names: Sequence[str], layout: str) -> dict[int, int]:
    """Column of the layout -> place in `names`, of the names that the layout has."""
    places: dict[str, int] = {}
    for place, name in enumerate(names):
        places.setdefault(plain_name(name), place)
    wanted = [_SAME.get(name, name) for name in layout_names(layout)]
    return {column: places[name] for column, name in enumerate(wanted) if name in places}


def best_layout(names: Sequence[str]) -> str | None:
    """The layout that has most of the names, the smallest of several; None if none has enough."""
    fitting = {layout: len(columns_of(names, layout)) for layout in LAYOUTS}
    best = max(LAYOUTS, key=lambda layout: (fitting[layout], -len(layout_names(layout))))
    return best if fitting[best] >= FEWEST else None


def known_columns(names: Sequence[str], layout: str, where: str) -> dict[int, int]:
    """As `columns_of`; ValueError when fewer than `FEWEST` are known."""
    found = columns_of(names, layout)
    if len(found) < FEWEST:
        raise ValueError(
            f"{where}: expected at least {FEWEST} body parts named like {layout}'s "
            f"({', '.join(layout_names(layout))}), got {', '.join(names)}; rename them"
        )
    return found
