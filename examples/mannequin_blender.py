"""A mannequin for an armature with Rigify's names, a stage, and pictures of it; run by Blender.

Used by retarget_blender.py. The armature may have any proportions; the body is made of rounded
parts, one for each bone, all of whose vertices the bone moves.
"""

from __future__ import annotations

from pathlib import Path

import bpy
from mathutils import Matrix, Vector

# Half widths of a body part, of the rig's height: to the side and to the front.
PARTS = {
    "spine": (0.075, 0.055),
    "spine.001": (0.066, 0.048),
    "spine.002": (0.072, 0.053),
    "spine.003": (0.082, 0.056),
    "spine.004": (0.027, 0.027),
    "spine.005": (0.027, 0.027),
    "spine.006": (0.044, 0.054),
    "upper_arm": (0.026, 0.026),
    "forearm": (0.021, 0.021),
    "hand": (0.022, 0.013),
    "thigh": (0.043, 0.045),
    "shin": (0.029, 0.031),
    "foot": (0.024, 0.022),
    "toe": (0.022, 0.012),
}
LIMBS = ("upper_arm", "forearm", "thigh", "shin", "hand", "foot")
COLOURS = {
    "skin": (0.72, 0.36, 0.16, 1.0),
    "joints": (0.09, 0.11, 0.14, 1.0),
    "ground": (0.8, 0.8, 0.8, 1.0),
}


def add_body(rig: bpy.types.Object) -> None:
    """A mannequin of one rounded part for each bone, skinned to the rig."""
    height = rig.data.bones["spine.006"].tail_local.z
    parts = []
    for bone in rig.data.bones:
        size = PARTS.get(bone.name) or PARTS.get(bone.name.split(".")[0])
        if size is None:
            continue
        parts.append(_part(rig, bone, *(height * half for half in size)))
        if bone.name.split(".")[0] in LIMBS:
            thickness = 0.92 * height * min(size)
            parts.append(_ball(bone, thickness))
    bpy.ops.object.select_all(action="DESELECT")
    for part in parts:
        part.select_set(True)
    bpy.context.view_layer.objects.active = parts[0]
    bpy.ops.object.join()
    body = bpy.context.object
    body.name = "body"
    body.parent = rig
    body.modifiers.new("rig", "ARMATURE").object = rig


def _part(
    rig: bpy.types.Object, bone: bpy.types.Bone, aside: float, ahead: float
) -> bpy.types.Object:
    """An ellipsoid along a bone, or flat on the floor from the heel to the ball of a foot."""
    if bone.name.startswith("foot"):
        heel = rig.data.bones[bone.name.replace("foot", "heel.02")].head_local
        middle, ball = bone.head_local.copy(), bone.tail_local
        middle.y, middle.z = (heel.y + ball.y) / 2, ahead
        size = (aside, 0.62 * (heel.y - ball.y), ahead, 1)
        return _sphere(bone, Matrix.Translation(middle) @ Matrix.Diagonal(size), "skin")
    trunk = bone.name.startswith("spine") and bone.name != "spine.006"
    long = bone.length * (0.78 if trunk else 0.56)
    along = Matrix.Translation((0, bone.length / 2, 0))
    axes = bone.matrix_local.to_3x3()
    turned = abs(axes.col[0].x) >= abs(axes.col[2].x)  # which of its axes is to the side
    across = (aside, long, ahead, 1) if turned else (ahead, long, aside, 1)
    return _sphere(bone, bone.matrix_local @ along @ Matrix.Diagonal(across), "skin")


def _ball(bone: bpy.types.Bone, radius: float) -> bpy.types.Object:
    size = Matrix.Diagonal((radius, radius, radius, 1))
    return _sphere(bone, bone.matrix_local @ size, "joints")


def _sphere(bone: bpy.types.Bone, place: Matrix, material: str) -> bpy.types.Object:
    """All its vertices move with the bone."""
    bpy.ops.mesh.primitive_uv_sphere_add(segments=28, ring_count=18, radius=1.0)
    sphere = bpy.context.object
    sphere.data.transform(place)
    sphere.data.shade_smooth()
    sphere.vertex_groups.new(name=bone.name).add(range(len(sphere.data.vertices)), 1.0, "REPLACE")
    sphere.data.materials.append(_material(material))
    return sphere


def _material(name: str) -> bpy.types.Material:
    """One of `COLOURS`."""
    if name not in bpy.data.materials:
        made = bpy.data.materials.new(name)
        made.use_nodes = True
        surface = made.node_tree.nodes["Principled BSDF"]
        surface.inputs["Base Color"].default_value = COLOURS[name]
        surface.inputs["Roughness"].default_value = 0.55
    return bpy.data.materials[name]


def step_aside(performer: bpy.types.Object, metres: float) -> None:
    """Show the performer to the character's right."""
    bpy.ops.object.empty_add(location=(-metres, 0, 0))
    beside = bpy.context.object
    beside.name = "performer"
    performer.parent = beside


def stage(shown: list[bpy.types.Object], frames: range) -> None:
    """A floor, light, and a camera that sees the whole path."""
    places = []
    for frame in frames:
        bpy.context.scene.frame_set(frame)
        places += [rig.matrix_world @ bone.head for rig in shown for bone in rig.pose.bones]
    low = Vector(min(p[k] for p in places) for k in range(3))
    high = Vector(max(p[k] for p in places) for k in range(3))
    centre = (low + high) / 2
    bpy.ops.mesh.primitive_plane_add(size=200)
    bpy.context.object.data.materials.append(_material("ground"))
    bpy.ops.object.light_add(type="SUN", rotation=(0.7, -0.25, 0.5))
    bpy.context.object.data.energy = 2.2
    bpy.context.object.data.angle = 0.2
    scene = bpy.context.scene
    scene.world = bpy.data.worlds.new("sky")
    scene.world.use_nodes = True
    sky = scene.world.node_tree.nodes["Background"]
    sky.inputs["Color"].default_value = (0.8, 0.82, 0.85, 1.0)
    sky.inputs["Strength"].default_value = 0.5
    ahead = Vector((0.5, -1.0, 0.3)).normalized()
    bpy.ops.object.camera_add(location=centre + 1.75 * (high - low).length * ahead)
    scene.camera = bpy.context.object
    scene.camera.rotation_euler = (-ahead).to_track_quat("-Z", "Y").to_euler()
    scene.camera.data.angle = 0.5


def render(out: Path, frames: range, pictures: int, size: tuple[int, int]) -> None:
    """Pictures of even moments, traced by the processor."""
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.cycles.samples = 24
    scene.cycles.use_denoising = True
    scene.view_settings.view_transform = "Standard"
    scene.render.resolution_x, scene.render.resolution_y = size
    for n in range(pictures):
        frame = frames[round((n + 0.5) * len(frames) / pictures - 0.5)]
        scene.frame_set(frame)
        scene.render.filepath = str(out / f"frame_{frame:04d}.png")
        bpy.ops.render.render(write_still=True)
        print(scene.render.filepath)
