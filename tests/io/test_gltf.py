"""GLB files read back from their bytes: the skin moves as the body does, cameras see as ours do."""

import json
import struct
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from imocap_core.io.writers import gltf
from tests.io.made_clips import Made, made_clip

TYPES = {code: np.dtype(name) for name, code in gltf.COMPONENTS.items()}
WIDTHS = {kind: shape for shape, kind in gltf.KINDS.items()}
K = np.array([[700.0, 0, 320], [0, 690, 180], [0, 0, 1]])


def camera(frames: int, turning: bool = True, walk_m: float = 0.0) -> gltf.ClipCamera:
    turns = Rotation.from_rotvec(np.linspace([0.1, 3.0, 0], [0, 3.4, 0.1], frames)).as_matrix()
    centre = np.array([[0, 1.5, 3.0]])
    if walk_m:
        centre = centre + np.linspace(0, walk_m, frames)[:, None]
    return gltf.ClipCamera("v1", K, np.ones(1), (640, 360), turns if turning else turns[:1], centre)


def actor(made: Made, walk_m: float = 0.0, **changes: Any) -> gltf.Actor:
    clip = replace(made.clip, **changes)
    clip_camera = replace(camera(len(clip.frames), walk_m=walk_m), id=clip.id)
    return gltf.Actor(clip, gltf.skin_of(made.shaped), clip_camera, (0.2, 0.3, 0.4))


class Read:
    """A GLB file by its bytes alone."""

    def __init__(self, data: bytes) -> None:
        magic, version, length = struct.unpack("<4sII", data[:12])
        assert (magic, version, length) == (b"glTF", 2, len(data))
        size, kind = struct.unpack("<I4s", data[12:20])
        assert kind == b"JSON"
        self.tree = json.loads(data[20 : 20 + size])
        rest = data[20 + size :]
        size, kind = struct.unpack("<I4s", rest[:8])
        assert (kind, size) == (b"BIN\0", len(rest) - 8)
        self.block = rest[8:]
        self.nodes = self.tree["nodes"]

    def array(self, index: int) -> np.ndarray:
        accessor = self.tree["accessors"][index]
        view = self.tree["bufferViews"][accessor["bufferView"]]
        dtype, shape = TYPES[accessor["componentType"]], WIDTHS[accessor["type"]]
        raw = self.block[view["byteOffset"] : view["byteOffset"] + view["byteLength"]]
        array = np.frombuffer(raw, dtype).reshape(accessor["count"], *shape)
        return array.swapaxes(1, 2) if shape == (4, 4) else array

    def animated(self, animation: int, frame: int) -> list[np.ndarray]:
        """World matrices (4, 4) of all nodes at a key of an animation."""
        posed = [dict(node) for node in self.nodes]
        moving = self.tree["animations"][animation]
        for channel in moving["channels"]:
            output = self.array(moving["samplers"][channel["sampler"]]["output"])
            posed[channel["target"]["node"]][channel["target"]["path"]] = output[frame]
        world = [np.eye(4)] * len(posed)

        def visit(index: int, above: np.ndarray) -> None:
            matrix = np.eye(4)
            matrix[:3, 3] = posed[index].get("translation", np.zeros(3))
            turn = posed[index].get("rotation", [0, 0, 0, 1])
            matrix[:3, :3] = Rotation.from_quat(turn).as_matrix()
            world[index] = above @ matrix
            for child in posed[index].get("children", []):
                visit(child, world[index])

        for root in self.tree["scenes"][0]["nodes"]:
            visit(root, np.eye(4))
        return world

    def skinned(self, mesh_node: int, world: list[np.ndarray]) -> np.ndarray:
        """Vertices (V, 3) of a skinned node, as glTF defines it."""
        node = self.nodes[mesh_node]
        skin = self.tree["skins"][node["skin"]]
        attributes = self.tree["meshes"][node["mesh"]]["primitives"][0]["attributes"]
        bind = self.array(skin["inverseBindMatrices"])
        bones = np.stack([world[j] @ bind[k] for k, j in enumerate(skin["joints"])])
        rest = self.array(attributes["POSITION"])
        rest = np.concatenate([rest, np.ones((len(rest), 1))], axis=1)
        joints, weights = self.array(attributes["JOINTS_0"]), self.array(attributes["WEIGHTS_0"])
        moved = np.einsum("vkab,vb->vka", bones[joints], rest)
        return (weights[..., None] * moved).sum(1)[:, :3]

    def node(self, name: str) -> int:
        return [n["name"] for n in self.nodes].index(name)


@pytest.mark.parametrize("hands", [False, True])
def test_the_skin_moves_as_the_body_does(hands: bool) -> None:
    made = made_clip(hands=hands)
    read = Read(gltf.scene_bytes([actor(made)], {}))
    surface = made.posed.mesh().vertices.numpy()
    body = read.node("v1_body")
    joints = read.tree["skins"][0]["joints"]
    assert [read.nodes[j]["name"] for j in joints] == list(made.clip.joint_names)
    for frame in (0, 5, 11):
        world = read.animated(0, frame)
        theirs = np.stack([world[j][:3, 3] for j in joints])
        assert 1000 * np.abs(theirs - made.clip.joints[frame]).max() < 0.01  # millimetres
        assert 1000 * np.abs(read.skinned(body, world) - surface[frame]).max() < 0.01


def test_what_a_viewer_shows_without_playing_is_the_first_frame() -> None:
    made = made_clip()
    read = Read(gltf.scene_bytes([actor(made)], {}))
    read.tree["animations"][0]["channels"] = []
    world = read.animated(0, 0)
    theirs = np.stack([world[j][:3, 3] for j in read.tree["skins"][0]["joints"]])
    np.testing.assert_allclose(theirs, made.clip.joints[0], atol=1e-5)


def test_keys_are_the_frames_times_and_turns_take_the_short_way() -> None:
    made = made_clip(fps=25.0)
    read = Read(gltf.scene_bytes([actor(made)], {}))
    animation = read.tree["animations"][0]
    for sampler in animation["samplers"]:
        accessor = read.tree["accessors"][sampler["input"]]
        assert (accessor["min"], accessor["max"]) == ([0.0], [pytest.approx(11 / 25)])
        np.testing.assert_allclose(read.array(sampler["input"]), np.arange(12) / 25, atol=1e-7)
        turns = read.array(sampler["output"])
        if turns.shape[1] == 4:
            assert ((turns[1:] * turns[:-1]).sum(1) > 0).all()


def test_quaternions_do_not_flip() -> None:
    R = Rotation.from_rotvec(np.linspace([0, 0, 0], [0, 9.0, 0], 50)).as_matrix()
    q = gltf.quaternions(R)
    assert ((q[1:] * q[:-1]).sum(1) > 0.9).all()
    np.testing.assert_allclose(Rotation.from_quat(q).as_matrix(), R, atol=1e-12)


@pytest.mark.parametrize("walk_m", [0.0, 0.4])
@pytest.mark.parametrize("frame", [0, 11])
def test_a_point_falls_on_the_pixel_that_our_camera_sees_it_at(frame: int, walk_m: float) -> None:
    """Up to the principal point, which glTF's cameras have in the middle."""
    made = made_clip()
    read = Read(gltf.scene_bytes([actor(made, walk_m)], {}))
    world = read.animated(0, frame)[read.node("v1_camera")]
    optics = read.tree["cameras"][0]["perspective"]
    point = made.clip.joints[frame, 0]
    x, y, z = np.linalg.inv(world)[:3] @ [*point, 1]
    high = np.tan(optics["yfov"] / 2)
    clip = np.array([x / (-z * high * optics["aspectRatio"]), y / (-z * high)])
    pixel = np.array([320 + 320 * clip[0], 180 - 180 * clip[1]])
    ours = camera(12, walk_m=walk_m)
    in_camera = ours.R_cam_from_world[frame] @ (point - ours.centre[frame if walk_m else 0])
    assert in_camera[2] > 0
    expected = [320 + 690 * in_camera[0] / in_camera[2], 180 + 690 * in_camera[1] / in_camera[2]]
    np.testing.assert_allclose(pixel, expected, atol=0.01)
    assert read.tree["cameras"][0]["extras"]["K"] == K.tolist()


def test_a_still_camera_has_no_keys() -> None:
    made = made_clip()
    still = replace(actor(made), camera=camera(12, turning=False))
    read = Read(gltf.scene_bytes([still], {}))
    moved = {c["target"]["node"] for c in read.tree["animations"][0]["channels"]}
    assert read.node("v1_camera") not in moved


def test_every_video_has_nodes_of_its_own_and_all_play_together() -> None:
    first, second = made_clip(seed=1), made_clip(seed=2, frames=9)
    read = Read(gltf.scene_bytes([actor(first), actor(second, id="v2")], {"up_axis": "y"}))
    assert [a["name"] for a in read.tree["animations"]] == ["all", "v1", "v2"]
    together, one, two = (len(a["channels"]) for a in read.tree["animations"])
    assert together == one + two
    theirs = read.animated(0, 8)
    alone = read.animated(2, 8)
    for k, joint in enumerate(read.tree["skins"][1]["joints"]):
        np.testing.assert_allclose(theirs[joint][:3, 3], second.clip.joints[8, k], atol=1e-5)
        np.testing.assert_array_equal(theirs[joint], alone[joint])
    assert read.tree["asset"]["extras"] == {"up_axis": "y"}
    assert all(m["pbrMetallicRoughness"]["metallicFactor"] == 0 for m in read.tree["materials"])


def test_parts_lie_within_the_block_and_aligned() -> None:
    read = Read(gltf.scene_bytes([actor(made_clip())], {}))
    assert len(read.block) % 4 == 0
    for view in read.tree["bufferViews"]:
        assert view["byteOffset"] % 4 == 0
        assert view["byteOffset"] + view["byteLength"] <= read.tree["buffers"][0]["byteLength"]
    weights = read.array(read.tree["meshes"][0]["primitives"][0]["attributes"]["WEIGHTS_0"])
    np.testing.assert_allclose(weights.sum(1), 1.0, atol=1e-6)


def test_what_gltf_can_not_hold_is_said() -> None:
    with pytest.raises(ValueError, match=r"array: expected .* got float64 \(2, 3\)"):
        gltf.Numbers().add(np.zeros((2, 3)))
    with pytest.raises(ValueError, match=r"got float32 \(0, 3\)"):
        gltf.Numbers().add(np.zeros((0, 3), dtype=np.float32))


def test_other_libraries_open_it(tmp_path: Path) -> None:
    """pygltflib and trimesh, where they are installed."""
    made = made_clip()
    file = tmp_path / "a.glb"
    gltf.write_glb(file, [actor(made)], {})
    pygltflib = pytest.importorskip("pygltflib", reason="pygltflib reads it where installed")
    read = pygltflib.GLTF2().load(file)
    assert [n.name for n in read.nodes][:2] == ["v1", "pelvis"]
    trimesh = pytest.importorskip("trimesh", reason="trimesh reads it where installed")
    scene = trimesh.load(file)
    (mesh,) = scene.geometry.values()
    assert mesh.vertices.shape == (13492, 3)
