"""A glTF 2.0 scene of motion clips: animated skinned bodies and their cameras.

glTF is right-handed, metres, y up, cameras look along -z with y up: clips and cameras must be
in a world with y up. Every video has separate nodes; the animation `all` moves them all, and with
several videos each also has a separate one. Frames are keys in seconds, with linear (rotations:
spherical linear) interpolation.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from imocap_core.io.writers.clip_body import ClipCamera, Skin, vertex_normals
from imocap_core.io.writers.glb import INDICES, VERTICES, Numbers, glb_bytes
from imocap_core.io.writers.motion_clip import MotionClip

Colour = tuple[float, float, float]  # linear light, 0 to 1
Tree = dict[str, Any]

GLTF_FROM_CV = np.diag([1.0, -1.0, -1.0])  # camera axes: y and z reversed
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
    """The content of the file."""
    numbers = Numbers()
    tree: Tree = {
        "asset": {"version": "2.0", "generator": "imocap", "extras": dict(notes)},
        "scene": 0,
        "scenes": [{"name": "imocap", "nodes": []}],
        **{name: [] for name in ("nodes", "meshes", "skins", "materials", "cameras")},
    }
    animations: list[tuple[str, Tree]] = []
    for actor in actors:
        animation = _Animation(numbers, actor.clip.times_s)
        joints = _add_joints(tree, animation, actor.clip)
        _add_body(tree, numbers, actor, joints)
        _add_camera(tree, animation, actor.camera)
        animations.append((actor.clip.id, animation.tree))
    tree["animations"] = _animations(animations)
    return glb_bytes(tree, numbers)


def quaternions(R: Float[np.ndarray, "T 3 3"]) -> Float[np.ndarray, "T 4"]:
    """Quaternions x, y, z, w, with signs such that neighbours have a positive dot product."""
    q = Rotation.from_matrix(R).as_quat()
    flips = np.where((q[1:] * q[:-1]).sum(1) < 0, -1.0, 1.0)
    return np.concatenate([q[:1], q[1:] * np.cumprod(flips)[:, None]])


class _Animation:
    """The samplers and channels of one video, all at the video's frame times."""

    def __init__(self, numbers: Numbers, times_s: Float[np.ndarray, " T"]) -> None:
        self.numbers = numbers
        self.times = numbers.add(times_s.astype(np.float32), bounds=True)
        self.tree: Tree = {"samplers": [], "channels": []}

    def add(self, node: int, path: str, values: Float[np.ndarray, "T _"]) -> None:
        output = self.numbers.add(values.astype(np.float32))
        samplers, channels = self.tree["samplers"], self.tree["channels"]
        channels.append({"sampler": len(samplers), "target": {"node": node, "path": path}})
        samplers.append({"input": self.times, "output": output, "interpolation": "LINEAR"})


def _add_joints(tree: Tree, animation: _Animation, clip: MotionClip) -> list[int]:
    """Add a node named by the video with the joints below it; returns the joints' node indices."""
    nodes = tree["nodes"]
    top = len(nodes)
    joints = [top + 1 + j for j in range(len(clip.parents))]
    rotations = [quaternions(clip.R_local[:, j]) for j in range(len(joints))]
    paths = {0: clip.pelvis} if clip.root is None else {0: clip.root, 1: clip.pelvis_from_root}
    nodes.append({"name": clip.id, "children": [joints[0]]})
    for j, name in enumerate(clip.joint_names):
        position = paths[j][0] if j in paths else clip.offsets[j]
        rotation = rotations[j][0].tolist()
        node = {"name": name, "translation": position.tolist(), "rotation": rotation}
        children = [joints[c] for c, parent in enumerate(clip.parents) if parent == j]
        nodes.append({**node, "children": children} if children else node)
        animation.add(joints[j], "rotation", rotations[j])
    for j, path in paths.items():
        animation.add(joints[j], "translation", path)
    tree["scenes"][0]["nodes"].append(top)
    return joints


def _add_body(tree: Tree, numbers: Numbers, actor: Actor, joints: list[int]) -> None:
    """Add the mesh at rest, its skin, its material, and the node that shows them."""
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
    body = {"mesh": len(tree["meshes"]) - 1, "skin": len(tree["skins"]) - 1}
    tree["scenes"][0]["nodes"].append(len(tree["nodes"]))
    tree["nodes"].append({"name": f"{clip.id}_body", **body})


def _add_camera(tree: Tree, animation: _Animation, camera: ClipCamera) -> None:
    """Add a perspective camera; its extras have the principal point and zoom, which glTF lacks."""
    width, height = camera.size
    perspective = {
        "yfov": 2.0 * float(np.arctan(0.5 * height / camera.K[1, 1])),
        "aspectRatio": width / height,
        "znear": NEAR_M,
    }
    extras = {"K": camera.K.tolist(), "size_px": [width, height]}
    if len(camera.zoom) > 1:
        extras["zoom"] = camera.zoom.tolist()
    rotations = quaternions(camera.R_cam_from_world.swapaxes(1, 2) @ GLTF_FROM_CV)
    name = f"{camera.id}_camera"
    node = len(tree["nodes"])
    if len(rotations) > 1:
        animation.add(node, "rotation", rotations)
    if len(camera.centre) > 1:
        animation.add(node, "translation", camera.centre)
    tree["scenes"][0]["nodes"].append(node)
    tree["nodes"].append(
        {
            "name": name,
            "camera": len(tree["cameras"]),
            "translation": camera.centre[0].tolist(),
            "rotation": rotations[0].tolist(),
        }
    )
    optics = {"type": "perspective", "perspective": perspective}
    tree["cameras"].append({"name": name, **optics, "extras": extras})


def _animations(per_video: Sequence[tuple[str, Tree]]) -> list[Tree]:
    """One animation of all videos, then one of each; they share the same numbers."""
    together: Tree = {"name": "all", "samplers": [], "channels": []}
    for _, one in per_video:
        first = len(together["samplers"])
        together["samplers"] += one["samplers"]
        together["channels"] += [{**c, "sampler": c["sampler"] + first} for c in one["channels"]]
    each = [{"name": name, **one} for name, one in per_video]
    return [together, *each] if len(each) > 1 else [{**together, "name": per_video[0][0]}]
