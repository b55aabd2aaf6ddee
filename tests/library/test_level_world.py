"""`--up y` and `--up z` are one world, in every format."""

from __future__ import annotations

import json
import struct
from pathlib import Path

import numpy as np
import pytest

from imocap_core.camera.gravity import Z_UP_FROM_Y_UP as Q
from tests.library.conftest import SmallRun


def test_motions_and_cameras_are_those_of_the_y_up_world_turned_by_a_quarter(
    small_run: SmallRun,
) -> None:
    y, z = (small_run.result.levelled(up) for up in "yz")
    for a, b in zip(y, z, strict=True):
        np.testing.assert_allclose(b.joints, a.joints @ Q.T, atol=1e-9)
        np.testing.assert_allclose(b.rotations[:, 0], Q @ a.rotations[:, 0], atol=1e-9)
        np.testing.assert_allclose(b.rotations[:, 1:], a.rotations[:, 1:], atol=1e-9)
        np.testing.assert_allclose(b.vertices(np.array([3])), a.vertices(np.array([3])) @ Q.T)
        np.testing.assert_allclose(b.camera.centre, Q @ a.camera.centre, atol=1e-9)
        np.testing.assert_allclose(b.camera.R, a.camera.R @ Q.T, atol=1e-9)


def test_levelling_again_changes_nothing(small_run: SmallRun) -> None:
    once, back = small_run.result.levelled("y"), small_run.result.levelled("z").levelled("y")
    for a, b in zip(once, back, strict=True):
        np.testing.assert_allclose(b.joints, a.joints, atol=1e-9)
    common = small_run.result.on_common_time().levelled("y")
    for a, b in zip(once.on_common_time(), common, strict=True):
        np.testing.assert_allclose(b.camera.centre, a.camera.centre, atol=1e-9)
        np.testing.assert_allclose(b.trans, a.trans, atol=1e-9)


@pytest.mark.parametrize(("up", "axis"), [("y", 1), ("z", 2)])
def test_a_result_has_its_ground(small_run: SmallRun, up: str, axis: int) -> None:
    result, level = small_run.result, small_run.result.levelled(up)
    np.testing.assert_allclose(np.linalg.norm(result.ground.up), 1.0)
    assert 0.3 < result.ground.tilt_sd_deg < 10
    assert result.ground.height_sd_mm >= 10
    np.testing.assert_allclose(level.ground.up, np.eye(3)[axis], atol=1e-9)
    np.testing.assert_allclose(level.ground.origin, 0, atol=1e-9)
    for before, after in zip(result, level, strict=True):
        height = result.ground.height_m(before.joints)
        np.testing.assert_allclose(after.joints[..., axis], height, atol=1e-9)


def test_files_of_both_are_one_world(small_run: SmallRun, tmp_path: Path) -> None:
    y, z = (
        {f.name: f for f in small_run.result.export("npz", tmp_path / up, up=up)} for up in "yz"
    )
    for name in ("v1.npz", "v2.npz"):
        with np.load(y[name]) as a, np.load(z[name]) as b:
            np.testing.assert_allclose(b["joints"], a["joints"] @ Q.T, atol=1e-6)
            np.testing.assert_allclose(b["R"], a["R"] @ Q.T, atol=1e-6)
            np.testing.assert_allclose(b["t"], a["t"], atol=1e-6)
    bvh = [small_run.result.export("bvh", tmp_path / f"bvh_{up}", up=up)[0] for up in "yz"]
    a, b = (_root_path(file) for file in bvh)
    np.testing.assert_allclose(b, a @ Q.T, atol=1e-5)


def test_a_glb_of_the_z_up_world_is_that_of_the_y_up_world(
    small_run: SmallRun, tmp_path: Path
) -> None:
    glb = [small_run.result.levelled(up).export("glb", tmp_path / up)[0] for up in "yz"]
    a, b = (_binary_chunk(file) for file in glb)
    np.testing.assert_allclose(b, a, atol=1e-5)


def _root_path(bvh: Path) -> np.ndarray:
    """(T, 3) positions of the root in a BVH file."""
    motion = bvh.read_text().split("Frame Time:")[1].splitlines()[1:]
    return np.array([[float(x) for x in line.split()[:3]] for line in motion if line.strip()])


def _binary_chunk(glb: Path) -> np.ndarray:
    """The numbers of a GLB file, all that are of single precision."""
    content = glb.read_bytes()
    (length,) = struct.unpack_from("<I", content, 12)
    gltf = json.loads(content[20 : 20 + length])
    data = content[28 + length :]
    parts = []
    for accessor in gltf["accessors"]:
        if accessor["componentType"] == 5126:
            view = gltf["bufferViews"][accessor["bufferView"]]
            size = {"SCALAR": 1, "VEC3": 3, "VEC4": 4, "MAT4": 16}.get(accessor["type"], 2)
            start = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
            parts.append(np.frombuffer(data, "<f4", size * accessor["count"], start))
    return np.concatenate(parts)
