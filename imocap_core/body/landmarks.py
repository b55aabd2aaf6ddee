"""Surface landmarks of any body in SMPL's rest pose, found by its geometry and its joints.

The free body brings its own (see tools/free_body_parts.py). Official files bring none, so the
points that detectors see are looked for: the tip of the nose is the foremost vertex of the head's
middle, the heel the rearmost of the foot's lowest, and so on. Metres, y up, facing +z.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from imocap_core.body.protocols import Landmark

Floats = NDArray[np.float64]
Indices = NDArray[np.intp]

_EYE_OFFSET_M = (0.031, 0.038)  # from the tip of the nose: sideways and up, of a mean adult
_EYE_REACH_M = 0.008
_EAR_SHARE = 0.02  # of the head's vertices: those furthest to one side are that ear


def find_landmarks(
    template: Floats, weights: Floats, joints: Floats, names: Sequence[str]
) -> dict[str, Landmark]:
    """Landmarks by name, each one vertex; parts that the joints cannot tell apart are left out.

    template (V, 3), weights (V, J), joints (J, 3) at rest, names (J,).
    """
    owner = np.array(names)[weights.argmax(axis=1)]
    found: dict[str, int] = {}
    head = np.flatnonzero(np.isin(owner, ("head", "jaw", "left_eye", "right_eye")))
    if len(head):
        found |= _head(template, head, owner)
    for side, sign in (("left", 1.0), ("right", -1.0)):
        foot = np.flatnonzero(np.isin(owner, (f"{side}_ankle", f"{side}_foot")))
        if len(foot):
            found |= _foot(template, foot, side, sign)
        for finger in ("thumb", "index", "middle", "ring", "pinky"):
            tip = np.flatnonzero(owner == f"{side}_{finger}3")
            if len(tip):
                root = joints[list(names).index(f"{side}_{finger}1")]
                away = ((template[tip] - root) ** 2).sum(axis=1)
                found[f"{side}_{finger}_tip"] = int(tip[away.argmax()])
    return {name: ((vertex, 1.0),) for name, vertex in found.items()}


def _head(template: Floats, head: Indices, owner: NDArray[np.str_]) -> dict[str, int]:
    sideways = np.abs(template[head, 0])
    middle = head[sideways <= max(0.05 * np.ptp(template[head, 0]), sideways.min())]
    nose = int(middle[template[middle, 2].argmax()])
    found = {"nose": nose, "head_top": int(middle[template[middle, 1].argmax()])}
    front = head[template[head, 2] >= template[head, 2].mean()]
    for side, sign in (("left", 1.0), ("right", -1.0)):
        ball = np.flatnonzero(owner == f"{side}_eye")
        if len(ball):
            found[f"{side}_eye"] = int(ball[template[ball, 2].argmax()])
        else:
            place = template[nose, :2] + np.array([sign * _EYE_OFFSET_M[0], _EYE_OFFSET_M[1]])
            away = np.linalg.norm(template[front, :2] - place, axis=1)
            near = front[away <= max(_EYE_REACH_M, away.min())]
            found[f"{side}_eye"] = int(near[template[near, 2].argmax()])
        count = max(1, int(_EAR_SHARE * len(head)))
        ear = head[np.argsort(-sign * template[head, 0])[:count]]
        away = ((template[ear] - template[ear].mean(axis=0)) ** 2).sum(axis=1)
        found[f"{side}_ear"] = int(ear[away.argmin()])
    return found


def _foot(template: Floats, foot: Indices, side: str, sign: float) -> dict[str, int]:
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
    faces: NDArray[np.int64], triangles: NDArray[np.int64], barycentric: Floats
) -> dict[str, Landmark]:
    """SMPL-X's 51 face landmarks as face17 ... face67 of the 68: all but the moving contour.

    faces (F, 3); triangles (51,) into faces; barycentric (51, 3), rows sum to 1.
    """
    marks: dict[str, Landmark] = {}
    for number, (triangle, mix) in enumerate(zip(triangles, barycentric, strict=True), start=17):
        total = mix.sum()
        marks[f"face{number}"] = tuple(
            (int(v), float(w / total)) for v, w in zip(faces[triangle], mix, strict=True)
        )
    return marks
