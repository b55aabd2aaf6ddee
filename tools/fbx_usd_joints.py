"""World joints of an FBX or USD file as readers other than Blender read it.

python tools/fbx_usd_joints.py FILE OUT.json --frames 0 10 20

Runs where `ufbx` (FBX) or `usd-core` (USD) is installed. OUT.json: {"joints": {"<joint>": [[x, y,
z], ...]}, "fps", "metres" (of one unit), "up", "seconds" (length), "materials", "skinned" (joints
that move the skin)}, in the file's axes and unit, one row per frame (from 0).
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np


def main() -> None:
    """Read one file, write its joints."""
    arguments = argparse.ArgumentParser()
    arguments.add_argument("file", type=Path)
    arguments.add_argument("out", type=Path)
    arguments.add_argument("--frames", type=int, nargs="+", required=True)
    given = arguments.parse_args()
    read = read_fbx if given.file.suffix == ".fbx" else read_usd
    given.out.write_text(json.dumps(read(str(given.file), given.frames)))


def read_fbx(file: str, frames: list[int]) -> dict[str, Any]:
    """By ufbx, of whose Python package only what is used here did not crash."""
    import ufbx

    scene = ufbx.load_file(file)
    settings, stack = scene.settings, scene.anim_stacks[0]
    fps, first, anim = settings.frames_per_second, stack.time_begin, stack.anim
    nodes = list(scene.nodes)
    joints: dict[str, list[list[float]]] = {}
    scales = set()
    for frame in frames:
        world: dict[str, np.ndarray] = {}
        for node in nodes:
            local = ufbx.evaluate_transform(anim, node, first + frame / fps)
            above = world[node.parent.name] if node.parent is not None else np.eye(4)
            world[node.name] = above @ _matrix(local)
            scales |= {round(s, 4) for s in _numbers(local.scale, "xyz")}
            joints.setdefault(node.name, []).append(world[node.name][:3, 3].tolist())
    return {
        "joints": joints,
        "fps": fps,
        "metres": settings.unit_meters,
        "up": {0: "x", 2: "y", 4: "z"}[int(settings.axes.up)],
        "seconds": stack.time_end - stack.time_begin,
        "materials": [material.name for material in scene.materials],
        "skinned": len(scene.skin_deformers[0].clusters),
        "scales": sorted(scales),
    }


def _numbers(value: Any, names: str) -> list[float]:
    return [getattr(value, name) for name in names]


def _matrix(local: Any) -> np.ndarray:
    """(4, 4) translation, rotation and scale of a node."""
    x, y, z, w = _numbers(local.rotation, "xyzw")
    M = np.eye(4)
    M[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    M[:3, :3] *= _numbers(local.scale, "xyz")
    M[:3, 3] = _numbers(local.translation, "xyz")
    return M


def read_usd(file: str, frames: list[int]) -> dict[str, Any]:
    """By OpenUSD."""
    from pxr import Usd, UsdGeom, UsdShade, UsdSkel

    stage = Usd.Stage.Open(file)
    prims = list(stage.Traverse())
    skeleton = next(UsdSkel.Skeleton(p) for p in prims if p.IsA(UsdSkel.Skeleton))
    mesh = next(p for p in prims if p.IsA(UsdGeom.Mesh))
    cache = UsdSkel.Cache()
    query = cache.GetSkelQuery(skeleton)
    names = [path.split("/")[-1] for path in query.GetJointOrder()]
    joints: dict[str, list[list[float]]] = {name: [] for name in names}
    first, last = stage.GetStartTimeCode(), stage.GetEndTimeCode()
    for frame in frames:
        time = first + frame
        world = UsdGeom.Xformable(skeleton.GetPrim()).ComputeLocalToWorldTransform(time)
        for name, pose in zip(names, query.ComputeJointSkelTransforms(time), strict=True):
            joints[name].append(list((pose * world).ExtractTranslation()))
    return {
        "joints": joints,
        "fps": stage.GetTimeCodesPerSecond(),
        "metres": UsdGeom.GetStageMetersPerUnit(stage),
        "up": str(UsdGeom.GetStageUpAxis(stage)).lower(),
        "seconds": (last - first) / stage.GetTimeCodesPerSecond(),
        "materials": [p.GetName() for p in prims if p.IsA(UsdShade.Material)],
        "skinned": len(UsdSkel.BindingAPI(mesh).GetSkeletonRel().GetTargets()) and len(names),
    }


if __name__ == "__main__":
    main()
