"""Binary glTF 2.0 (GLB): animated skinned bodies and their cameras.

glTF is right-handed, metres, y up, cameras look along -z with y up: clips and cameras must be
in a world with y up. Every video has separate nodes; the animation `all` moves them all, and with
several videos each also has a separate one. Frames are keys in seconds, with linear (rotations:
spherical linear) interpolation.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from jaxtyping import Shaped as AnyDtype
from scipy.spatial.transform import Rotation

from imocap_core.body.model import Shaped
from imocap_core.io.writers.motion_clip import MotionClip
from imocap_core.render import vertex_normals

INFLUENCES = 4  # joints per vertex, the most that every program reads


@dataclass(frozen=True, eq=False)
class Skin:
    """A mesh at rest with skinning weights, without pose blend shapes.

    vertices: metres from the pelvis at rest. joints: indices of the joints that move each vertex,
    weights: theirs, summing to 1.
    """

    vertices: Float[np.ndarray, "V 3"]
    faces: Int[np.ndarray, "F 3"]
    joints: Int[np.ndarray, "V 4"]
    weights: Float[np.ndarray, "V 4"]


@dataclass(frozen=True, eq=False)
class ClipCamera:
    """A camera that may turn, zoom and move.

    K: pixels, of the first frame. zoom: focal length over K's, per frame of the clip or one. size:
    width, height. R_cam_from_world: per frame of the clip, or one when it never turns. centre:
    world, metres, likewise.
    """

    id: str
    K: Float[np.ndarray, "3 3"]
    zoom: Float[np.ndarray, " _"]
    size: tuple[int, int]
    R_cam_from_world: Float[np.ndarray, "_ 3 3"]
    centre: Float[np.ndarray, "_ 3"]


def skin_of(shaped: Shaped) -> Skin:
    """The surface of a shaped body, with the four largest weights of every vertex."""
    weights = shaped.model.weights.numpy()
    weights = np.pad(weights, ((0, 0), (0, max(0, INFLUENCES - weights.shape[1]))))
    order = np.argsort(-weights, axis=1, kind="stable")[:, :INFLUENCES]
    largest = np.take_along_axis(weights, order, axis=1)
    largest = largest / largest.sum(1, keepdims=True)
    return Skin(
        vertices=(shaped.vertices_rest - shaped.joints_rest[0]).numpy(),
        faces=shaped.model.faces.numpy(),
        joints=np.where(largest > 0, order, 0),
        weights=largest,
    )


MAGIC, VERSION = b"glTF", 2
JSON_CHUNK, BINARY_CHUNK = b"JSON", b"BIN\0"
COMPONENTS = {"float32": 5126, "uint32": 5125, "uint16": 5123, "uint8": 5121}
KINDS = {(): "SCALAR", (2,): "VEC2", (3,): "VEC3", (4,): "VEC4", (4, 4): "MAT4"}
VERTICES, INDICES = 34962, 34963  # purpose of a buffer view


class Numbers:
    """The binary block, to which arrays are appended; each is an accessor, named by its index."""

    def __init__(self) -> None:
        self.data = bytearray()
        self.views: list[dict[str, Any]] = []
        self.accessors: list[dict[str, Any]] = []

    def add(
        self,
        array: AnyDtype[np.ndarray, "N ..."],
        *,
        bounds: bool = False,
        target: int | None = None,
    ) -> int:
        """Append (N,), (N, 2|3|4) or (N, 4, 4) (row-major matrices); returns the accessor's index.

        bounds: write minimum and maximum, which glTF requires for positions and times. ValueError
        for another type or shape.
        """
        name, shape = array.dtype.name, array.shape[1:]
        if name not in COMPONENTS or shape not in KINDS or not len(array):
            raise ValueError(
                f"array: expected one or more of {', '.join(COMPONENTS)} in rows of "
                f"{', '.join(KINDS.values())}, got {name} {array.shape}"
            )
        columns = array.swapaxes(1, 2) if shape == (4, 4) else array  # glTF: column by column
        self.data += bytes(-len(self.data) % 4)
        view: dict[str, Any] = {"buffer": 0, "byteOffset": len(self.data)}
        little = np.ascontiguousarray(columns, dtype=array.dtype.newbyteorder("<"))
        self.data += little.tobytes()
        view["byteLength"] = little.nbytes
        if target is not None:
            view["target"] = target
        self.views.append(view)
        accessor: dict[str, Any] = {
            "bufferView": len(self.views) - 1,
            "componentType": COMPONENTS[name],
            "count": len(array),
            "type": KINDS[shape],
        }
        if bounds:
            rows = little.reshape(len(array), -1)
            accessor["min"] = rows.min(0).tolist()
            accessor["max"] = rows.max(0).tolist()
        self.accessors.append(accessor)
        return len(self.accessors) - 1


def _glb_bytes(tree: Mapping[str, Any], numbers: Numbers) -> bytes:
    """The file: a header, the JSON chunk, the binary chunk, each padded to four bytes."""
    block = bytes(numbers.data) + bytes(-len(numbers.data) % 4)
    whole = dict(tree)
    whole["accessors"], whole["bufferViews"] = numbers.accessors, numbers.views
    whole["buffers"] = [{"byteLength": len(numbers.data)}]
    text = json.dumps(whole, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I", len(text)) + JSON_CHUNK + text
    chunks += struct.pack("<I", len(block)) + BINARY_CHUNK + block
    return MAGIC + struct.pack("<II", VERSION, 12 + len(chunks)) + chunks


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
    return _glb_bytes(tree, numbers)


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
