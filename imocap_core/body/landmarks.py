"""Surface landmarks of any body in SMPL's rest pose, located by its geometry and its joints.

The free body has a table of landmarks (see tools/free_body_parts.py). Official files have none, so
the points of detectors are located: the tip of the nose is the foremost vertex of the head's
middle, the heel the rearmost of the foot's lowest, and so on. Metres, y up, facing +z.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int

from imocap_core.body.protocols import Landmark

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
