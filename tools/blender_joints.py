"""World joints of a BVH, GLB, FBX or USD file as Blender imports it. Runs where `bpy` is installed.

python tools/blender_joints.py FILE OUT.json --fps 30 --frames 0 10 20 [--up y|z] [--skin]

OUT.json: {"<armature>": {"<joint>": [[x, y, z], ...]}}, metres, Blender's world (z up), one row per
frame (from 0); "cameras": {"<name>": {"angle", "across", "location"}} in the first frame, the angle
of view in radians along the picture's "HORIZONTAL" or "VERTICAL" side; "fps": the scene's frame
rate after the import.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

import bpy


def main() -> int:
    """Import one file as a user would, with the importer's defaults."""
    arguments = argparse.ArgumentParser()
    arguments.add_argument("file", type=Path)
    arguments.add_argument("out", type=Path)
    arguments.add_argument("--fps", type=int, required=True)
    arguments.add_argument("--frames", type=int, nargs="+", required=True)
    arguments.add_argument("--up", choices=["y", "z"], default="y")
    arguments.add_argument("--skin", action="store_true")
    given = arguments.parse_args()
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene, first = bpy.context.scene, 0
    scene.render.fps = given.fps
    if given.file.suffix == ".bvh":
        axes = {"axis_forward": "-Z", "axis_up": "Y"}  # Blender's defaults
        if given.up == "z":
            axes = {"axis_forward": "Y", "axis_up": "Z"}
        bpy.ops.import_anim.bvh(filepath=str(given.file), frame_start=0, **axes)
        first = 1  # Blender puts a BVH file's first frame one after `frame_start`
    elif given.file.suffix == ".fbx":
        bpy.ops.import_scene.fbx(filepath=str(given.file), anim_offset=0)
    elif given.file.suffix == ".usd":
        bpy.ops.wm.usd_import(filepath=str(given.file))
    else:
        bpy.ops.import_scene.gltf(filepath=str(given.file))
    armatures = [o for o in scene.objects if o.type == "ARMATURE"]
    joints = {o.name: {bone.name: [] for bone in o.pose.bones} for o in armatures}
    for frame in given.frames:
        scene.frame_set(frame + first)
        for o in armatures:
            for bone in o.pose.bones:
                joints[o.name][bone.name].append(list(o.matrix_world @ bone.head))
    scene.frame_set(given.frames[0] + first)
    joints["cameras"] = {
        o.name: {
            "angle": o.data.angle,
            "across": o.data.sensor_fit,
            "location": list(o.matrix_world.translation),
        }
        for o in scene.objects
        if o.type == "CAMERA"
    }
    if given.skin:
        joints["skin"] = [skin_at(frame + first) for frame in given.frames]
    joints["fps"] = scene.render.fps / scene.render.fps_base
    given.out.write_text(json.dumps(joints))
    return 0


def skin_at(frame: int) -> list[list[float]]:
    """Vertices of the first skinned mesh, world."""
    scene = bpy.context.scene
    scene.frame_set(frame)
    body = next(o for o in scene.objects if o.type == "MESH" and o.find_armature())
    posed = body.evaluated_get(bpy.context.evaluated_depsgraph_get()).to_mesh()
    return [list(body.matrix_world @ vertex.co) for vertex in posed.vertices]


if __name__ == "__main__":
    sys.exit(main())
