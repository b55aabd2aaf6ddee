"""Animated characters in GLB files to FBX or USD. Runs where `bpy` is.

python convert.py -- JOBS.json, or: blender --background --python convert.py -- JOBS.json

JOBS.json: a list of {"glb", "out" (.fbx or .usd), "name", "fps", "cm", "up"}. cm: write
centimetres, not metres. up: the axis that points up in a USD file, y or z.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import bpy

ARMATURE = "Armature"  # a node of this name above the bones is left out by Unreal's importer


def main() -> None:
    """Convert every file of the list."""
    jobs = json.loads(Path(sys.argv[sys.argv.index("--") + 1]).read_text(encoding="utf-8"))
    for job in jobs:
        _read(job)
        (_write_usd if job["out"].endswith(".usd") else _write_fbx)(job)


def _read(job: dict[str, Any]) -> None:
    """An empty scene, at the clip's frame rate before it is read: keys lie at whole frames."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.name = job["name"]
    scene.render.fps = max(1, round(job["fps"]))
    scene.render.fps_base = scene.render.fps / job["fps"]
    if job["cm"]:
        scene.unit_settings.scale_length = 0.01  # what is read is then 100 times as large
    bpy.ops.import_scene.gltf(filepath=job["glb"], bone_heuristic="TEMPERANCE")
    for other in [o for o in scene.objects if o.type not in ("ARMATURE", "MESH")]:
        bpy.data.objects.remove(other)
    armature = next(o for o in scene.objects if o.type == "ARMATURE")
    for shape in [o for o in scene.objects if o.type == "MESH" and o.parent is not armature]:
        bpy.data.objects.remove(shape)  # what the importer draws bones with
    for bone in armature.pose.bones:
        bone.custom_shape = None
    armature.name = ARMATURE
    action = armature.animation_data.action
    action.name = job["name"]
    scene.frame_start, scene.frame_end = (round(frame) for frame in action.frame_range)


def _write_fbx(job: dict[str, Any]) -> None:
    """Centimetres, y up, every frame a key."""
    bpy.ops.export_scene.fbx(
        filepath=job["out"],
        object_types={"ARMATURE", "MESH"},
        axis_forward="-Z",
        axis_up="Y",
        apply_scale_options="FBX_SCALE_NONE",
        add_leaf_bones=False,
        mesh_smooth_type="FACE",
        use_mesh_modifiers=False,
        bake_anim_use_nla_strips=False,
        bake_anim_use_all_actions=False,
        bake_anim_force_startend_keying=True,
        bake_anim_simplify_factor=0.0,
    )


def _write_usd(job: dict[str, Any]) -> None:
    """Metres; UsdSkel's skeleton, skin and animation, and a preview surface.

    Options that this Blender does not have are left out (4.2 writes metres always).
    """
    up = job["up"].upper()
    options: dict[str, Any] = {
        "filepath": job["out"],
        "export_animation": True,
        "export_armatures": True,
        "only_deform_bones": False,
        "export_materials": True,
        "generate_preview_surface": True,
        "export_cameras": False,
        "export_lights": False,
        "convert_world_material": False,
        "convert_orientation": True,
        "export_global_up_selection": up,
        "export_global_forward_selection": "NEGATIVE_Z" if up == "Y" else "Y",
        "convert_scene_units": "METERS",
        "root_prim_path": f"/{bpy.path.clean_name(job['name'])}",
    }
    available = bpy.ops.wm.usd_export.get_rna_type().properties.keys()
    bpy.ops.wm.usd_export(**{name: value for name, value in options.items() if name in available})


if __name__ == "__main__":
    main()
