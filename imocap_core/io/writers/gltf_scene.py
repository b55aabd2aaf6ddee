"""A glTF 2.0 scene of performances: skinned bodies that move, and the cameras that saw them.

glTF is right-handed, metres, y up, cameras look along -z with y up: clips and cameras must come in
a world of y up. Every video has its own nodes; the animation `all` moves them all, and with several
videos each also has one of its own. Frames are keys in seconds, linear (rotations spherical)
between them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from imocap_core.io.writers.clip_body import ClipCamera, Skin, vertex_normals
from imocap_core.io.writers.glb import INDICES, VERTICES, Numbers, glb_bytes
from imocap_core.io.writers.motion_clip import MotionClip

Array = NDArray[np.float64]
Colour = tuple[float, float, float]  # linear light, 0 to 1
Tree = dict[str, Any]

GLTF_FROM_CV = np.diag([1.0, -1.0, -1.0])  # a camera's axes: y and z the other way round
NEAR_M = 0.01
ROUGHNESS = 0.9


@dataclass(frozen=True, eq=False)
class Actor:
    """One video in the scene."""

    clip: MotionClip
    skin: Skin
    camera: ClipCamera
    colour: Colour


def write_glb(file: Path, actors: Sequence[Actor], notes: Mapping[str, Any]) -> None:
    """Write the scene; `notes` go into the file's `asset.extras`."""
    file.write_bytes(scene_bytes(actors, notes))


def scene_bytes(actors: Sequence[Actor], notes: Mapping[str, Any]) -> bytes:
    """The whole file."""
    numbers = Numbers()
    tree: Tree = {
        "asset": {"version": "2.0", "generator": "imocap", "extras": dict(notes)},
        "scene": 0,
        "scenes": [{"name": "imocap", "nodes": []}],
        **{name: [] for name in ("nodes", "meshes", "skins", "materials", "cameras")},
    }
    moves: list[tuple[str, Tree]] = []
    for actor in actors:
        own = _Moves(numbers, actor.clip.times_s)
        joints = _add_joints(tree, own, actor.clip)
        _add_body(tree, numbers, actor, joints)
        _add_camera(tree, own, actor.camera)
        moves.append((actor.clip.id, own.animation))
    tree["animations"] = _animations(moves)
    return glb_bytes(tree, numbers)


def quaternions(R: Array) -> Array:
    """(T, 4) x, y, z, w of rotations (T, 3, 3), each on the side of the one before."""
    q = Rotation.from_matrix(R).as_quat()
    flips = np.where((q[1:] * q[:-1]).sum(1) < 0, -1.0, 1.0)
    return np.concatenate([q[:1], q[1:] * np.cumprod(flips)[:, None]])


class _Moves:
    """The samplers and channels of one video, all on its own times."""

    def __init__(self, numbers: Numbers, times_s: Array) -> None:
        self.numbers = numbers
        self.times = numbers.add(times_s.astype(np.float32), bounds=True)
        self.animation: Tree = {"samplers": [], "channels": []}

    def add(self, node: int, path: str, values: Array) -> None:
        output = self.numbers.add(values.astype(np.float32))
        samplers, channels = self.animation["samplers"], self.animation["channels"]
        channels.append({"sampler": len(samplers), "target": {"node": node, "path": path}})
        samplers.append({"input": self.times, "output": output, "interpolation": "LINEAR"})


def _add_joints(tree: Tree, moves: _Moves, clip: MotionClip) -> list[int]:
    """A node named by the video, the joints below it; the joints' node indices."""
    nodes = tree["nodes"]
    top = len(nodes)
    joints = [top + 1 + j for j in range(len(clip.parents))]
    turns = [quaternions(clip.R_local[:, j]) for j in range(len(joints))]
    nodes.append({"name": clip.id, "children": [joints[0]]})
    for j, name in enumerate(clip.joint_names):
        place = clip.pelvis[0] if j == 0 else clip.offsets[j]
        node = {"name": name, "translation": place.tolist(), "rotation": turns[j][0].tolist()}
        children = [joints[c] for c, parent in enumerate(clip.parents) if parent == j]
        nodes.append({**node, "children": children} if children else node)
        moves.add(joints[j], "rotation", turns[j])
    moves.add(joints[0], "translation", clip.pelvis)
    tree["scenes"][0]["nodes"].append(top)
    return joints


def _add_body(tree: Tree, numbers: Numbers, actor: Actor, joints: list[int]) -> None:
    """The mesh at rest, its skin, its material, and the node that shows them."""
    skin, clip = actor.skin, actor.clip
    bind = np.tile(np.eye(4, dtype=np.float32), (len(joints), 1, 1))
    bind[:, :3, 3] = -clip.rest
    wide = len(skin.vertices) > 65535
    index = skin.faces.astype(np.uint32 if wide else np.uint16).ravel()
    normals = vertex_normals(skin.vertices, skin.faces)
    attributes = {
        "POSITION": numbers.add(skin.vertices.astype(np.float32), bounds=True, target=VERTICES),
        "NORMAL": numbers.add(normals.astype(np.float32), target=VERTICES),
        "JOINTS_0": numbers.add(skin.joints.astype(np.uint8), target=VERTICES),
        "WEIGHTS_0": numbers.add(skin.weights.astype(np.float32), target=VERTICES),
    }
    primitive = {
        "attributes": attributes,
        "indices": numbers.add(index, target=INDICES),
        "material": len(tree["materials"]),
    }
    colour = {"baseColorFactor": [*actor.colour, 1.0]}
    surface = {**colour, "metallicFactor": 0.0, "roughnessFactor": ROUGHNESS}
    tree["materials"].append({"name": clip.id, "pbrMetallicRoughness": surface})
    skinned = {"joints": joints, "inverseBindMatrices": numbers.add(bind), "skeleton": joints[0]}
    tree["skins"].append({"name": clip.id, **skinned})
    tree["meshes"].append({"name": f"{clip.id}_body", "primitives": [primitive]})
    at = {"mesh": len(tree["meshes"]) - 1, "skin": len(tree["skins"]) - 1}
    tree["scenes"][0]["nodes"].append(len(tree["nodes"]))
    tree["nodes"].append({"name": f"{clip.id}_body", **at})


def _add_camera(tree: Tree, moves: _Moves, camera: ClipCamera) -> None:
    """A perspective camera; extras hold what glTF has no place for: principal point and zoom."""
    width, height = camera.size
    perspective = {
        "yfov": 2.0 * float(np.arctan(0.5 * height / camera.K[1, 1])),
        "aspectRatio": width / height,
        "znear": NEAR_M,
    }
    known = {"K": camera.K.tolist(), "size_px": [width, height]}
    if len(camera.zoom) > 1:
        known["zoom"] = camera.zoom.tolist()
    turns = quaternions(camera.R_cam_from_world.swapaxes(1, 2) @ GLTF_FROM_CV)
    name = f"{camera.id}_camera"
    node = len(tree["nodes"])
    if len(turns) > 1:
        moves.add(node, "rotation", turns)
    tree["scenes"][0]["nodes"].append(node)
    tree["nodes"].append(
        {
            "name": name,
            "camera": len(tree["cameras"]),
            "translation": camera.centre.tolist(),
            "rotation": turns[0].tolist(),
        }
    )
    optics = {"type": "perspective", "perspective": perspective}
    tree["cameras"].append({"name": name, **optics, "extras": known})


def _animations(moves: Sequence[tuple[str, Tree]]) -> list[Tree]:
    """One of all videos, then one of each; they share their numbers."""
    together: Tree = {"name": "all", "samplers": [], "channels": []}
    for _, own in moves:
        first = len(together["samplers"])
        together["samplers"] += own["samplers"]
        together["channels"] += [{**c, "sampler": c["sampler"] + first} for c in own["channels"]]
    each = [{"name": name, **own} for name, own in moves]
    return [together, *each] if len(each) > 1 else [{**together, "name": moves[0][0]}]
