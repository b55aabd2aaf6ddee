"""Keypoints of any body: detectors' layouts (data/layouts.toml), and surface landmarks.

Surface landmarks of any body in SMPL's rest pose, located by its geometry and its joints. The free
body has a table of landmarks (see tools/free_body_parts.py). Official files have none, so the
points of detectors are located: the tip of the nose is the foremost vertex of the head's middle,
the heel the rearmost of the foot's lowest, and so on. Metres, y up, facing +z.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from importlib import resources
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from imocap_core.body.kinematics import Landmark, ModelArrays
from imocap_core.body.points import PointSet, make_points
from imocap_core.conventions import EVAL_12, EVAL_14, EVAL_17, SMPL_JOINTS, SMPLH_JOINTS

_EYE_OFFSET_M = (0.031, 0.038)  # from the tip of the nose: sideways and up, of a mean adult
_EYE_REACH_M = 0.008
_EAR_SHARE = 0.02  # of the head's vertices: those furthest to one side are that ear


def find_landmarks(
    template: Float[np.ndarray, "V 3"],
    weights: Float[np.ndarray, "V J"],
    joints: Float[np.ndarray, "J 3"],
    names: Sequence[str],
) -> dict[str, Landmark]:
    """Landmarks by name, each one vertex; parts without joints of their own are left out.

    Args:
        template, joints: at rest. weights: skinning weights. names: of the joints.
    """
    owner = np.array(names)[weights.argmax(axis=1)]
    vertices: dict[str, int] = {}
    head = np.flatnonzero(np.isin(owner, ("head", "jaw", "left_eye", "right_eye")))
    if len(head):
        vertices |= _head(template, head, owner)
    for side, sign in (("left", 1.0), ("right", -1.0)):
        foot = np.flatnonzero(np.isin(owner, (f"{side}_ankle", f"{side}_foot")))
        if len(foot):
            vertices |= _foot(template, foot, side, sign)
        for finger in ("thumb", "index", "middle", "ring", "pinky"):
            tip = np.flatnonzero(owner == f"{side}_{finger}3")
            if len(tip):
                root = joints[list(names).index(f"{side}_{finger}1")]
                away = ((template[tip] - root) ** 2).sum(axis=1)
                vertices[f"{side}_{finger}_tip"] = int(tip[away.argmax()])
    return {name: ((vertex, 1.0),) for name, vertex in vertices.items()}


def _head(
    template: Float[np.ndarray, "V 3"], head: Int[np.ndarray, " N"], owner: np.ndarray
) -> dict[str, int]:
    sideways = np.abs(template[head, 0])
    middle = head[sideways <= max(0.05 * np.ptp(template[head, 0]), sideways.min())]
    nose = int(middle[template[middle, 2].argmax()])
    vertices = {"nose": nose, "head_top": int(middle[template[middle, 1].argmax()])}
    front = head[template[head, 2] >= template[head, 2].mean()]
    for side, sign in (("left", 1.0), ("right", -1.0)):
        ball = np.flatnonzero(owner == f"{side}_eye")
        if len(ball):
            vertices[f"{side}_eye"] = int(ball[template[ball, 2].argmax()])
        else:
            place = template[nose, :2] + np.array([sign * _EYE_OFFSET_M[0], _EYE_OFFSET_M[1]])
            away = np.linalg.norm(template[front, :2] - place, axis=1)
            near = front[away <= max(_EYE_REACH_M, away.min())]
            vertices[f"{side}_eye"] = int(near[template[near, 2].argmax()])
        count = max(1, int(_EAR_SHARE * len(head)))
        ear = head[np.argsort(-sign * template[head, 0])[:count]]
        away = ((template[ear] - template[ear].mean(axis=0)) ** 2).sum(axis=1)
        vertices[f"{side}_ear"] = int(ear[away.argmin()])
    return vertices


def _foot(
    template: Float[np.ndarray, "V 3"], foot: Int[np.ndarray, " N"], side: str, sign: float
) -> dict[str, int]:
    outward = sign * template[foot, 0]
    inner = foot[outward <= np.median(outward)]
    outer = foot[outward >= outward.min() + 0.75 * np.ptp(outward)]
    low = foot[template[foot, 1] <= template[foot, 1].min() + 0.03]
    return {
        f"{side}_big_toe": int(inner[template[inner, 2].argmax()]),
        f"{side}_small_toe": int(outer[template[outer, 2].argmax()]),
        f"{side}_heel": int(low[template[low, 2].argmin()]),
    }


def static_face_landmarks(
    faces: Int[np.ndarray, "F 3"],
    triangles: Int[np.ndarray, " L"],
    barycentric: Float[np.ndarray, "L 3"],
) -> dict[str, Landmark]:
    """SMPL-X's 51 static face landmarks as face17 ... face67 of the 68, without the contour.

    triangles: indices of faces. barycentric: weights of their corners, rows sum to 1.
    """
    marks: dict[str, Landmark] = {}
    for number, (triangle, mix) in enumerate(zip(triangles, barycentric, strict=True), start=17):
        total = mix.sum()
        marks[f"face{number}"] = tuple(
            (int(v), float(w / total)) for v, w in zip(faces[triangle], mix, strict=True)
        )
    return marks


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
