"""Keypoints of a body: detectors' layouts (data/layouts.toml)."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from importlib import resources
from typing import Any

import numpy as np
from jaxtyping import Float

from imocap_core.body.points import ModelArrays, PointSet, make_points
from imocap_core.conventions import EVAL_12, EVAL_14, EVAL_17, SMPL_JOINTS, SMPLH_JOINTS

_RUN = re.compile(r"^\((\w+)\) \* (\d+)$")
_FIXED: dict[str, tuple[str, ...]] = {
    "smpl24": SMPL_JOINTS,
    "smplh52": SMPLH_JOINTS,
    "eval12": EVAL_12,
    "eval14": EVAL_14,
    "eval17": EVAL_17,
}


@dataclass(frozen=True)
class Keypoint:
    """One column of a layout: the detector's name, and the point of the body at which it lies."""

    name: str
    point: str


def layouts() -> tuple[str, ...]:
    """The names of all layouts."""
    return (*_table()["layouts"], *_FIXED)


def layout_names(layout: str) -> tuple[str, ...]:
    """All K keypoint names of a layout in the detector's order, including those of no body."""
    return tuple(keypoint.name for keypoint in layout_keypoints(layout))


@lru_cache(maxsize=64)
def layout_keypoints(layout: str) -> tuple[Keypoint, ...]:
    """The columns of a layout. ValueError for an unknown layout lists all layouts."""
    if layout not in layouts():
        raise ValueError(f"layout: expected one of {', '.join(layouts())}, got {layout!r}")
    return tuple(_expand(layout))


def body_layout(layout: str) -> str:
    """The layout of the body and feet of a whole-body layout; any other layout itself."""
    return {"wholebody133": "coco23", "halpe136": "halpe26"}.get(layout, layout)


def hand_columns(layout: str) -> list[list[int]] | None:
    """Columns of the left and of the right hand's 21 points; None for layouts without them."""
    names = layout_names(layout)
    hands = [layout_names(f"{side}_hand21") for side in ("left", "right")]
    if not all(name in names for hand in hands for name in hand):
        return None
    return [[names.index(name) for name in hand] for hand in hands]


def layout_points(model: ModelArrays, layout: str) -> PointSet:
    """The points of a layout on a body, without those that the body does not have (see
    `PointSet.columns`). ValueError when the body has none of them."""
    available = [
        (column, keypoint.name, mix)
        for column, keypoint in enumerate(layout_keypoints(layout))
        if (mix := _locate(model, keypoint.point)) is not None
    ]
    if not available:
        raise ValueError(f"layout {layout}: body model {model.name} has none of its keypoints")
    columns, names, mixes = zip(*available, strict=True)
    points = make_points(model, names, [mix[0] for mix in mixes], [mix[1] for mix in mixes])
    return replace(points, columns=columns)


def joint_mix(layout: str, name: str) -> Mapping[str, float]:
    """The shares of SMPL's joints in a keypoint's point. ValueError when it has other parts."""
    point = next(keypoint.point for keypoint in layout_keypoints(layout) if keypoint.name == name)
    joint: dict[str, dict[str, float]] = {"joints": {point: 1.0}}
    mix: dict[str, dict[str, float]] = _table()["points"].get(point, [joint])[0]
    if set(mix) != {"joints"}:
        raise ValueError(f"{layout}, {name}: expected a mix of joints, got {mix}")
    return mix["joints"]


@lru_cache(maxsize=1)
def _table() -> dict[str, Any]:
    source = resources.files("imocap_core.body") / "data" / "layouts.toml"
    return tomllib.loads(source.read_text(encoding="utf-8"))


def _expand(layout: str) -> Iterator[Keypoint]:
    if layout in _FIXED:
        yield from (Keypoint(name, name) for name in _FIXED[layout])
        return
    for entry in _table()["layouts"][layout]:
        if entry.startswith("@"):
            yield from _expand(entry[1:])
        elif run := _RUN.match(entry):
            yield from (Keypoint(f"{run[1]}{i}", f"{run[1]}{i}") for i in range(int(run[2])))
        else:
            name, _, point = entry.partition(" = ")
            yield Keypoint(name, point or name)


Mixes = tuple[Mapping[int, float], Mapping[int, float]]


def _locate(model: ModelArrays, point: str) -> Mixes | None:
    """A point as (mix of joints, mix of vertices), or None when the body does not have it."""
    by_name = [{"joints": {point: 1.0}}, {"landmarks": {point: 1.0}}]
    alternatives: Sequence[dict[str, dict[str, float]]] = _table()["points"].get(point, by_name)
    for mix in alternatives:
        joints, landmarks = mix.get("joints", {}), mix.get("landmarks", {})
        if set(joints) <= set(model.joint_names) and set(landmarks) <= set(model.landmarks):
            vertices: dict[int, float] = {}
            for name, share in landmarks.items():
                for vertex, weight in model.landmarks[name]:
                    vertices[vertex] = vertices.get(vertex, 0.0) + share * weight
            return {model.joint_names.index(n): w for n, w in joints.items()}, vertices
    return None


HEAD, HANDS = ("nose", "eye", "ear", "mouth", "head"), ("thumb", "index", "pinky", "finger")


def point_shares(names: Sequence[str]) -> Float[np.ndarray, " K"]:
    """Weight of each keypoint: all of the head count as one, and all of both hands as two, however
    many a detector marks there; they tell nothing of legs."""
    shares = np.ones(len(names))
    for words, total in ((HEAD, 1), (HANDS, 2)):
        part = [any(w in name for w in words) and "foot" not in name for name in names]
        if sum(part) > total:
            shares[part] = total / sum(part)
    return shares
