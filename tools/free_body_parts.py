"""Landmarks on the free body's surface, and the part of a dressed person for each face."""

from __future__ import annotations

import numpy as np
from free_body_rig import JOINTS_24, JOINTS_52, Rig, _owner
from jaxtyping import Bool, Float, Int, UInt8

MIX = 8  # vertices of a landmark that is a weighted mean of vertices

# MakeHuman's vertex groups (mpfb2, basemesh_vertex_groups.json, CC0).
EAR_RADIUS_M = 0.036
IRIS_RADIUS_M = 0.007
EYES = {"left": (14598, 14669), "right": (14670, 14741)}
SIDES = (("left", ".L", 1.0), ("right", ".R", -1.0))


def bone_vertices(rig: Rig, *prefixes: str, least: float = 0.5) -> Int[np.ndarray, " N"]:
    """Vertices whose largest weights are those of bones with these prefixes."""
    columns = [i for i, name in enumerate(rig.names) if name.startswith(prefixes)]
    return np.flatnonzero(rig.weights[:, columns].sum(1) > least)


def landmarks(
    mean: Float[np.ndarray, "V 3"],
    directions: Float[np.ndarray, "V 3 B"],
    rig: Rig,
    joints: Float[np.ndarray, "S J 3"],
    coefficients: Float[np.ndarray, "S B"],
) -> dict[str, np.ndarray]:
    """landmark_names (L,), landmark_vertices (L, 8), landmark_weights (L, 8), rows sum to 1."""
    marks: dict[str, tuple[np.ndarray, np.ndarray]] = {}

    def vertex(
        name: str, candidates: Int[np.ndarray, " N"], score: Float[np.ndarray, " N"]
    ) -> None:
        best = candidates[np.argmax(score)]
        marks[name] = np.array([best]), np.ones(1)

    head = _head_vertices(rig)
    middle = head[np.abs(mean[head, 0]) < 0.01]
    vertex("nose", middle, mean[middle, 2])
    vertex("head_top", middle, mean[middle, 1])
    nose = mean[marks["nose"][0][0]]
    for word, side, sign in SIDES:
        _face(mean, rig, head, nose, word, sign, vertex)
        _foot(mean, rig, word, side, sign, vertex)
        _fingertips(mean, rig, word, side, vertex)
    for joint in range(22, 52):  # knuckles, for bodies without finger joints
        marks[JOINTS_52.names[joint]] = _mix(mean, directions, joints[:, joint], coefficients)
    vertices = np.zeros((len(marks), MIX), dtype=np.uint16)
    weights = np.zeros((len(marks), MIX), dtype=np.float32)
    for row, (index, share) in enumerate(marks.values()):
        vertices[row, : len(index)] = index
        weights[row, : len(index)] = share
    return {
        "landmark_names": np.array(list(marks)),
        "landmark_vertices": vertices,
        "landmark_weights": weights,
    }


def _head_vertices(rig: Rig) -> Int[np.ndarray, " N"]:
    owners = [
        i for i, name in enumerate(rig.names) if JOINTS_24.names[_owner(JOINTS_24, name)] == "head"
    ]
    skin = rig.base < 13380  # MakeHuman's own body group; above it eyes, teeth, tongue
    return np.flatnonzero((rig.weights[:, owners].sum(1) > 0.7) & skin)


def _eyeball(rig: Rig, side: str) -> Bool[np.ndarray, " V"]:
    first, last = EYES[side]
    return (rig.base >= first) & (rig.base <= last)


def _face(mean, rig, head, nose, word, sign, vertex) -> None:  # type: ignore[no-untyped-def]
    ball = np.flatnonzero(_eyeball(rig, word))
    vertex(f"{word}_eye", ball, mean[ball, 2])
    eye = mean[ball].mean(0)
    front = head[mean[head, 2] > eye[2] - 0.03]

    def near(name: str, x: float, y: float) -> None:
        vertex(name, front, -np.hypot(mean[front, 0] - sign * x, mean[front, 1] - y))

    near(f"{word}_eye_inner", abs(eye[0]) - 0.015, eye[1])
    near(f"{word}_eye_outer", abs(eye[0]) + 0.015, eye[1])
    near(f"{word}_mouth", 0.024, nose[1] - 0.04)
    flap = head[np.argsort(-sign * mean[head, 0])[:60]]
    centre = mean[flap].mean(0)
    vertex(f"{word}_ear", flap, -((mean[flap] - centre) ** 2).sum(1))


def _foot(mean, rig, word, side, sign, vertex) -> None:  # type: ignore[no-untyped-def]
    for name, toe in (("big_toe", 1), ("small_toe", 5)):
        tip = bone_vertices(rig, *(f"toe{toe}-{k}{side}" for k in (1, 2, 3)))
        vertex(f"{word}_{name}", tip, mean[tip, 2])
    foot = bone_vertices(rig, f"foot{side}", f"lowerleg02{side}")
    low = foot[mean[foot, 1] < mean[foot, 1].min() + 0.03]
    vertex(f"{word}_heel", low, -mean[low, 2])


def _fingertips(mean, rig, word, side, vertex) -> None:  # type: ignore[no-untyped-def]
    for finger, number in (("thumb", 1), ("index", 2), ("middle", 3), ("ring", 4), ("pinky", 5)):
        tip = bone_vertices(rig, f"finger{number}-3{side}")
        root = mean[bone_vertices(rig, f"finger{number}-1{side}")].mean(0)
        vertex(f"{word}_{finger}_tip", tip, ((mean[tip] - root) ** 2).sum(1))


def _mix(
    mean: Float[np.ndarray, "V 3"],
    directions: Float[np.ndarray, "V 3 B"],
    joint: Float[np.ndarray, "S 3"],
    coefficients: Float[np.ndarray, "S B"],
) -> tuple[Int[np.ndarray, " N"], Float[np.ndarray, " N"]]:
    """The 8 nearest vertices, weighted to follow a joint (S, 3) over the shape space."""
    design = np.concatenate([np.ones((len(coefficients), 1)), coefficients], axis=1)
    target = np.linalg.lstsq(design, joint, rcond=None)[0]
    near = np.argsort(((mean - target[0]) ** 2).sum(1))[:MIX]
    rows = np.concatenate([100 * np.ones((1, MIX)), mean[near].T, 0.1 * np.eye(MIX) * 0.02])
    values = np.concatenate([[100], target[0], np.full(MIX, 0.1 * 0.02 / MIX)])
    share = np.linalg.lstsq(rows, values, rcond=None)[0]
    return near, share / share.sum()


def face_parts(
    mean: Float[np.ndarray, "V 3"],
    rig: Rig,
    joints: Float[np.ndarray, "J 3"],
    ears: dict[str, int],
    eyes: dict[str, int],
) -> UInt8[np.ndarray, " F"]:
    """(F,) 0 skin, 1 hair (and irises), 2 shirt, 3 trousers, 4 shoes, by the T pose."""
    place_of = {name: joints[j] for j, name in enumerate(JOINTS_24.names)}
    owner = np.array([_owner(JOINTS_24, name) for name in rig.names])
    dominant = owner[rig.weights.argmax(1)]
    names = np.array(JOINTS_24.names)[dominant]
    head = np.zeros(len(mean), bool)
    head[_head_vertices(rig)] = True
    x, y, z = np.abs(mean[:, 0]), mean[:, 1], mean[:, 2]
    part = np.zeros(len(mean), dtype=np.uint8)
    leg = np.isin(
        names,
        [
            "left_hip",
            "right_hip",
            "left_knee",
            "right_knee",
            "left_ankle",
            "right_ankle",
            "left_foot",
            "right_foot",
        ],
    )
    torso = np.isin(
        names,
        [
            "pelvis",
            "spine1",
            "spine2",
            "spine3",
            "left_collar",
            "right_collar",
            "neck",
            "left_shoulder",
            "right_shoulder",
        ],
    )
    waist = place_of["pelvis"][1] + 0.02
    sleeve = place_of["left_shoulder"][0] + 0.55 * (
        place_of["left_elbow"][0] - place_of["left_shoulder"][0]
    )
    collar = place_of["neck"][1] + 0.01 - 0.35 * (z - place_of["neck"][2])  # lower in front
    part[torso & (y >= waist) & (x < sleeve) & ((y < collar) | (x > 0.065))] = 2
    part[(leg | torso) & (y < waist)] = 3
    part[leg & (y >= waist)] = 2
    part[leg & (y < place_of["left_ankle"][1] + 0.015)] = 4
    part[head & _hair(mean, head)] = 1
    for side in ("left", "right"):
        part[head & (np.linalg.norm(mean - mean[ears[side]], axis=1) < EAR_RADIUS_M)] = 0
        pupil = mean[eyes[side]]
        part[_eyeball(rig, side) & (np.linalg.norm(mean - pupil, axis=1) < IRIS_RADIUS_M)] = 1
    return _per_quad(part, rig.faces)


def _per_quad(
    part: UInt8[np.ndarray, " V"], faces: Int[np.ndarray, "F 3"]
) -> UInt8[np.ndarray, " F"]:
    """Both triangles of a quad show one part, the median of its corners': seams run straight.

    `faces` lists the first triangles (a, b, c) of all quads, then the second ones (a, c, d).
    """
    half = len(faces) // 2
    quads = np.concatenate([faces[:half], faces[half:, 2:]], axis=1)
    return np.tile(np.sort(part[quads], axis=1)[:, 1], 2)


def _hair(mean: Float[np.ndarray, "V 3"], head: Bool[np.ndarray, " V"]) -> Bool[np.ndarray, " V"]:
    """Above a slope from the hairline on the forehead down to the nape."""
    top = mean[head][:, 1].max()
    front, back = mean[head][:, 2].max(), mean[head][:, 2].min()
    depth = (front - mean[:, 2]) / (front - back)  # 0 at the nose, 1 at the back of the head
    line = np.interp(depth, [0.0, 0.2, 0.45, 0.6, 1.0], [0.055, 0.06, 0.11, 0.14, 0.17])
    return mean[:, 1] > top - line
