"""MakeHuman's 163 bones converted to SMPL's 24 joints and SMPL+H's 52: places, weights, T pose."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32, Int

Mix = Mapping[str, float]  # bone -> weight of its head; "mirror" bones are averaged in by hand


@dataclass(frozen=True)
class Rig:
    """B bones and V vertices; `base` is each vertex' number in MakeHuman's mesh."""

    names: tuple[str, ...]
    parents: tuple[int, ...]
    weights: Float[np.ndarray, "V B"]
    faces: Int[np.ndarray, "F 3"]
    base: Int[np.ndarray, " V"]

    def index(self, name: str) -> int:
        return self.names.index(name)


@dataclass(frozen=True)
class Joints:
    """A tree of joints, their places (weighted means of bone heads) and the bones each replaces."""

    names: tuple[str, ...]
    parents: tuple[int, ...]
    places: tuple[Mix, ...]
    bones: tuple[tuple[str, ...], ...]  # prefixes of bone names

    def place(self, rig: Rig, heads: Float[np.ndarray, "... B 3"]) -> Float[np.ndarray, "... J 3"]:
        """Places of the joints from the heads of the bones."""
        table = np.zeros((len(self.names), len(rig.names)))
        for j, mix in enumerate(self.places):
            for bone, weight in mix.items():
                table[j, rig.index(bone)] += weight
        return np.einsum("jb,...bc->...jc", table, heads)

    def kintree(self) -> Int[np.ndarray, "2 J"]:
        """SMPL's kintree_table: parents above joint numbers."""
        return np.array([self.parents, range(len(self.parents))], dtype=np.int64)


def _hip(side: str, other: str) -> Mix:
    """MakeHuman's thigh begins at its outside; the hip's centre is deeper, at the same height."""
    inward = 0.11
    return {f"upperleg01.{side}": 1 - inward, f"upperleg01.{other}": inward}


def _mean(*bones: str) -> Mix:
    return {bone: 1 / len(bones) for bone in bones}


TORSO = ("root", "pelvis.", "spine", "breast.")  # distributed by height, see `collect_weights`
_FACE = (
    "head",
    "jaw",
    "special",
    "oris",
    "tongue",
    "levator",
    "eye",
    "orbicularis",
    "temporalis",
    "oculi",
    "risorius",
)

_BODY: tuple[tuple[str, int, Mix, tuple[str, ...]], ...] = (
    ("pelvis", -1, {"spine05": 0.3, "spine04": 0.7}, TORSO),
    ("left_hip", 0, _hip("L", "R"), ("upperleg01.L", "upperleg02.L")),
    ("right_hip", 0, _hip("R", "L"), ("upperleg01.R", "upperleg02.R")),
    ("spine1", 0, {"spine03": 0.6, "spine02": 0.4}, ()),
    ("left_knee", 1, {"lowerleg01.L": 1.0}, ("lowerleg01.L", "lowerleg02.L")),
    ("right_knee", 2, {"lowerleg01.R": 1.0}, ("lowerleg01.R", "lowerleg02.R")),
    ("spine2", 3, {"spine02": 0.4, "spine01": 0.6}, ()),
    ("left_ankle", 4, {"foot.L": 1.0}, ("foot.L",)),
    ("right_ankle", 5, {"foot.R": 1.0}, ("foot.R",)),
    ("spine3", 6, {"spine01": 1.0}, ()),
    (
        "left_foot",
        7,
        _mean(*(f"toe{k}-1.L" for k in range(1, 6))),
        tuple(f"toe{k}-" for k in range(1, 6)),
    ),
    (
        "right_foot",
        8,
        _mean(*(f"toe{k}-1.R" for k in range(1, 6))),
        tuple(f"toe{k}-" for k in range(1, 6)),
    ),
    ("neck", 9, {"neck01": 1.0}, ("neck01", "neck02", "neck03")),
    ("left_collar", 9, {"clavicle.L": 0.6, "shoulder01.L": 0.4}, ("clavicle.L", "shoulder01.L")),
    ("right_collar", 9, {"clavicle.R": 0.6, "shoulder01.R": 0.4}, ("clavicle.R", "shoulder01.R")),
    ("head", 12, {"neck03": 0.5, "head": 0.5}, _FACE),
    ("left_shoulder", 13, {"upperarm01.L": 1.0}, ("upperarm01.L", "upperarm02.L")),
    ("right_shoulder", 14, {"upperarm01.R": 1.0}, ("upperarm01.R", "upperarm02.R")),
    ("left_elbow", 16, {"lowerarm01.L": 1.0}, ("lowerarm01.L", "lowerarm02.L")),
    ("right_elbow", 17, {"lowerarm01.R": 1.0}, ("lowerarm01.R", "lowerarm02.R")),
    ("left_wrist", 18, {"wrist.L": 1.0}, ("wrist.L", "metacarpal", "finger1-")),
    ("right_wrist", 19, {"wrist.R": 1.0}, ("wrist.R", "metacarpal", "finger1-")),
)
_FINGERS = (("index", 2), ("middle", 3), ("pinky", 5), ("ring", 4), ("thumb", 1))


def _hand_24(side: str, name: str, parent: int) -> tuple[str, int, Mix, tuple[str, ...]]:
    knuckles = _mean(*(f"finger{k}-1.{side}" for k in range(2, 6)))
    return (name, parent, knuckles, tuple(f"finger{k}-" for k in range(2, 6)))


def _hand_52(
    side: str, word: str, wrist: int, first: int
) -> list[tuple[str, int, Mix, tuple[str, ...]]]:
    rows = []
    for f, (finger, number) in enumerate(_FINGERS):
        for k in (1, 2, 3):
            bone = f"finger{number}-{k}.{side}"
            parent = wrist if k == 1 else first + 3 * f + k - 2
            rows.append((f"{word}_{finger}{k}", parent, {bone: 1.0}, (bone,)))
    return rows


def _joints(rows: list[tuple[str, int, Mix, tuple[str, ...]]]) -> Joints:
    names, parents, places, bones = zip(*rows, strict=True)
    return Joints(names, parents, places, bones)


JOINTS_24 = _joints([*_BODY, _hand_24("L", "left_hand", 20), _hand_24("R", "right_hand", 21)])
JOINTS_52 = _joints([*_BODY, *_hand_52("L", "left", 20, 22), *_hand_52("R", "right", 21, 37)])


def _owner(joints: Joints, bone: str) -> int:
    """The joint that replaces a bone: the longest matching prefix, on the same side."""
    best, length = -1, 0
    for j, prefixes in enumerate(joints.bones):
        sided = joints.names[j].startswith(("left_", "right_"))
        side = ".L" if joints.names[j].startswith("left_") else ".R"
        for prefix in prefixes:
            if (
                bone.startswith(prefix)
                and len(prefix) > length
                and (not sided or bone.endswith(side))
            ):
                best, length = j, len(prefix)
    if best < 0:
        raise ValueError(f"bone {bone}: no joint replaces it")
    return best


def collect_weights(
    rig: Rig, mean: Float[np.ndarray, "V 3"], joints: Joints, places: Float[np.ndarray, "J 3"]
) -> Float32[np.ndarray, "V J"]:
    """Skinning weights: bones summed, torso shared by height, smoothed, at most 4 each."""
    weights = np.zeros((len(mean), len(joints.names)))
    for b, bone in enumerate(rig.names):
        weights[:, _owner(joints, bone)] += rig.weights[:, b]
    torso = weights[:, 0].copy()
    weights[:, 0] = 0
    for joint, share in _torso_shares(mean[:, 1], joints, places).items():
        weights[:, joint] += torso * share
    weights = _smooth(weights, rig.faces, mean, joints, places)
    order = np.argsort(weights, axis=1)[:, :-4]
    np.put_along_axis(weights, order, 0.0, axis=1)
    weights[weights < 2e-3] = 0
    return (weights / weights.sum(1, keepdims=True)).astype(np.float32)


def _torso_shares(
    height: Float[np.ndarray, " V"], joints: Joints, places: Float[np.ndarray, "J 3"]
) -> dict[int, Float[np.ndarray, " V"]]:
    """Weights of pelvis, spine1, spine2, spine3, blended around the joints between them."""
    chain = [joints.names.index(n) for n in ("pelvis", "spine1", "spine2", "spine3")]
    widths = (0.07, 0.06, 0.06)  # metres either side of spine1, spine2, spine3
    above = [np.ones_like(height)]
    for joint, width in zip(chain[1:], widths, strict=True):
        t = np.clip((height - places[joint, 1]) / (2 * width) + 0.5, 0, 1)
        above.append(np.minimum(above[-1], t * t * (3 - 2 * t)))
    above.append(np.zeros_like(height))
    return {joint: above[i] - above[i + 1] for i, joint in enumerate(chain)}


def _smooth(
    weights: Float[np.ndarray, "V J"],
    faces: Int[np.ndarray, "F 3"],
    mean: Float[np.ndarray, "V 3"],
    joints: Joints,
    places: Float[np.ndarray, "J 3"],
) -> Float[np.ndarray, "V J"]:
    """Diffuse weights over the surface near the large joints, where MakeHuman's are too sharp."""
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    edges = np.unique(np.sort(edges, axis=1), axis=0)
    degree = np.bincount(edges.ravel(), minlength=len(mean)).astype(float)
    strength = np.zeros(len(mean))
    for name, radius in SMOOTHING_RADII_M.items():
        for joint in (j for j, n in enumerate(joints.names) if n.endswith(name)):
            distance = np.linalg.norm(mean - places[joint], axis=1)
            strength = np.maximum(strength, np.clip(2 - 2 * distance / radius, 0, 1))
    for _ in range(SMOOTHING_STEPS):
        total = np.zeros_like(weights)
        np.add.at(total, edges[:, 0], weights[edges[:, 1]])
        np.add.at(total, edges[:, 1], weights[edges[:, 0]])
        average = total / np.maximum(degree, 1)[:, None]
        weights = weights + 0.5 * strength[:, None] * (average - weights)
    return weights


SMOOTHING_STEPS = 6
SMOOTHING_RADII_M = {
    "hip": 0.22,
    "shoulder": 0.15,
    "knee": 0.14,
    "elbow": 0.1,
    "collar": 0.15,
    "ankle": 0.08,
    "neck": 0.12,
}


def t_pose(
    vertices: Float[np.ndarray, "S V 3"], heads: Float[np.ndarray, "S B 3"], rig: Rig
) -> tuple[Float[np.ndarray, "S V 3"], Float[np.ndarray, "S B 3"]]:
    """MakeHuman's resting pose to a T: arms along x, palms down, thighs nearly upright, feet flat.

    Vertices and bone heads of each of S bodies, by linear blend skinning with its own joints.
    """
    rotations = np.broadcast_to(np.eye(3), (*heads.shape, 3)).copy()
    for side, sign in ((".L", 1.0), (".R", -1.0)):
        _straighten_arm(rotations, heads, rig, side, sign)
        _straighten_leg(rotations, heads, rig, side, sign)
    moved = heads.copy()
    for bone, parent in enumerate(rig.parents):
        if parent >= 0:
            step = heads[:, bone] - heads[:, parent]
            moved[:, bone] = moved[:, parent] + np.einsum("sab,sb->sa", rotations[:, parent], step)
    posed = np.zeros_like(vertices)
    for bone in range(len(rig.names)):
        used = np.flatnonzero(rig.weights[:, bone])
        local = vertices[:, used] - heads[:, None, bone]
        world = local @ rotations[:, bone].transpose(0, 2, 1) + moved[:, None, bone]
        posed[:, used] += rig.weights[used, bone, None] * world
    return posed, moved


def _unit(vector: Float[np.ndarray, "... 3"]) -> Float[np.ndarray, "... 3"]:
    return vector / np.linalg.norm(vector, axis=-1, keepdims=True)


def _between(
    start: Float[np.ndarray, "S 3"], end: Float[np.ndarray, "... 3"]
) -> Float[np.ndarray, "S 3 3"]:
    """Smallest rotations that turn unit vectors start into end (3,) or (S, 3)."""
    end = np.broadcast_to(end, start.shape)
    axis = np.cross(start, end)
    cosine = (start * end).sum(-1)
    k = np.zeros((*start.shape, 3))
    k[:, 0, 1], k[:, 0, 2], k[:, 1, 2] = -axis[:, 2], axis[:, 1], -axis[:, 0]
    k -= k.transpose(0, 2, 1)
    return np.eye(3) + k + k @ k / (1 + cosine)[:, None, None]


def _about_x(angle: Float[np.ndarray, " S"]) -> Float[np.ndarray, "S 3 3"]:
    matrix = np.zeros((len(angle), 3, 3))
    matrix[:, 0, 0] = 1
    matrix[:, 1, 1] = matrix[:, 2, 2] = np.cos(angle)
    matrix[:, 2, 1] = np.sin(angle)
    matrix[:, 1, 2] = -matrix[:, 2, 1]
    return matrix


def _straighten_arm(
    rotations: Float[np.ndarray, "S B 3 3"],
    heads: Float[np.ndarray, "S B 3"],
    rig: Rig,
    side: str,
    sign: float,
) -> None:
    def head(bone: str) -> Float[np.ndarray, "S 3"]:
        return heads[:, rig.index(bone + side)]

    out = np.array([sign, 0.0, 0.0])
    upper = _between(_unit(head("lowerarm01") - head("upperarm01")), out)
    fore = _between(_unit(head("wrist") - head("lowerarm01")), out)
    hand = _between(_unit(head("finger3-1") - head("wrist")), out)
    across = np.einsum("sab,sb->sa", hand, head("finger2-1") - head("finger5-1"))
    twist = np.arctan2(across[:, 1], across[:, 2])  # about x, brings the index side to +z
    shares = {"upperarm01": 0.0, "upperarm02": 0.0, "lowerarm01": 1 / 3, "lowerarm02": 2 / 3}
    for bone, name in enumerate(rig.names):
        if not name.endswith(side):
            continue
        stem = name.removesuffix(side)
        if stem in shares:
            base = upper if stem.startswith("upper") else fore
            rotations[:, bone] = _about_x(shares[stem] * twist) @ base
        elif stem.startswith(("wrist", "metacarpal", "finger")):
            rotations[:, bone] = _about_x(twist) @ hand


def _straighten_leg(
    rotations: Float[np.ndarray, "S B 3 3"],
    heads: Float[np.ndarray, "S B 3"],
    rig: Rig,
    side: str,
    sign: float,
) -> None:
    places = JOINTS_24.place(rig, heads)
    joint = JOINTS_24.names.index("left_hip" if side == ".L" else "right_hip")
    hip, knee, ankle = places[:, joint], places[:, joint + 3], places[:, joint + 6]
    thigh = _between(_unit(knee - hip), _unit(np.array([0.09 * sign, -1.0, 0.0])))
    shin = _between(_unit(ankle - knee), _unit(np.array([-0.02 * sign, -1.0, -0.06])))
    for stem, rotation in (("upperleg", thigh), ("lowerleg", shin)):
        for half in ("01", "02"):
            rotations[:, rig.index(stem + half + side)] = rotation
