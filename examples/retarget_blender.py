"""Put an exported action onto a free character: the human rig of Rigify, which comes with Blender.

    imocap run --name serve VIDEOS
    imocap export serve --format fbx --out serve_fbx --mean --origin start \\
        --names rigify --root-bone --lock-feet
    .venv-blender/bin/python examples/retarget_blender.py serve_fbx/mean.fbx --out serve_character
    blender serve_character/character.blend

The export installs Blender's module `bpy` in .venv-blender (or takes IMOCAP_BLENDER's); with a
Blender that is installed, the third line is

    blender --background --python examples/retarget_blender.py -- serve_fbx/mean.fbx --out ...

FILE is an FBX or GLB file with the names of Rigify. The rig gets other proportions than the
performer's: bones point where the performer's point, the hips' path is scaled by the legs' length.
"""

from __future__ import annotations

import argparse
import json
import struct
import sys
from pathlib import Path

import bpy
from mathutils import Quaternion, Vector

sys.path.insert(0, str(Path(__file__).parent))
from mannequin_blender import add_body, render, stage, step_aside

# These point where the performer's do; other bones turn as the performer's: soles lie flat at rest.
POINTING = ("upper_arm", "forearm", "thigh", "shin")


def main() -> None:
    """Read the file, retarget, save, render."""
    words = sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else sys.argv[1:]
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("file", type=Path)
    arguments.add_argument("--out", type=Path, required=True)
    arguments.add_argument("--pictures", type=int, default=4)
    arguments.add_argument("--size", type=int, nargs=2, default=(640, 480))
    arguments.add_argument("--alone", action="store_true", help="without the performer beside it")
    given = arguments.parse_args(words)
    given.out.mkdir(parents=True, exist_ok=True)
    bpy.ops.wm.read_factory_settings(use_empty=True)
    performer, frames = read_performer(given.file)
    rig = human_rig()
    missing = [n for n in ("spine", "thigh.L", "upper_arm.R") if n not in performer.data.bones]
    if missing:
        sys.exit(f"{given.file}: no bone {missing[0]}; export it with --names rigify")
    retarget(performer, rig, frames)
    print(
        f"{len(frames)} frames; limbs within {limb_error_deg(performer, rig, frames):.2f} degrees"
    )
    add_body(rig)
    if given.alone:
        for thing in [*performer.children, performer]:
            bpy.data.objects.remove(thing)
    else:
        step_aside(performer, 0.6 * rig.data.bones["spine.006"].tail_local.z)
    stage([rig] if given.alone else [rig, performer], frames)
    bpy.ops.wm.save_as_mainfile(filepath=str((given.out / "character.blend").resolve()))
    render(given.out.resolve(), frames, given.pictures, given.size)


def read_performer(file: Path) -> tuple[bpy.types.Object, range]:
    """The armature of an FBX or GLB file, keys on whole frames; the scene's frames are the clip's.

    A GLB file's keys are seconds: the scene gets its frame rate before they are read.
    """
    scene = bpy.context.scene
    if file.suffix.lower() == ".fbx":
        bpy.ops.import_scene.fbx(filepath=str(file), anim_offset=0)
    else:
        scene.render.fps = round(glb_fps(file))
        bpy.ops.import_scene.gltf(filepath=str(file))
    armature = next((o for o in scene.objects if o.type == "ARMATURE"), None)
    if armature is None or armature.animation_data is None:
        sys.exit(f"{file}: no animated armature")
    for other in [o for o in scene.objects if armature not in (o, o.parent)]:
        bpy.data.objects.remove(other)  # cameras, other performers, what bones are drawn with
    first, last = (round(frame) for frame in armature.animation_data.action.frame_range)
    scene.frame_start, scene.frame_end = first, last
    return armature, range(first, last + 1)


def glb_fps(file: Path) -> float:
    """Keys per second of the longest animated track."""
    data = file.read_bytes()
    (length,) = struct.unpack_from("<I", data, 12)
    tree = json.loads(data[20 : 20 + length])
    times = [tree["accessors"][s["input"]] for s in tree["animations"][0]["samplers"]]
    longest = max(times, key=lambda t: t["count"])
    return (longest["count"] - 1) / max(longest["max"][0], 1e-6)


def human_rig() -> bpy.types.Object:
    """Rigify's human metarig, without hands' and face's details."""
    bpy.ops.preferences.addon_enable(module="rigify")
    bpy.ops.object.armature_basic_human_metarig_add()
    rig = bpy.context.object
    rig.name = "character"
    for bone in rig.pose.bones:
        bone.rotation_mode = "QUATERNION"
    return rig


def retarget(performer: bpy.types.Object, rig: bpy.types.Object, frames: range) -> None:
    """Key every frame of the rig's bones that the performer has too."""
    turns = {name: to_performers_rest(performer, rig, name) for name in common(performer, rig)}
    rest = {bone.name: bone.matrix_local.to_quaternion() for bone in rig.data.bones}
    scale = leg_length(rig) / leg_length(performer)
    low = lowest_ankle(performer, frames)
    for frame in frames:
        bpy.context.scene.frame_set(frame)
        posed: dict[str, Quaternion] = {}
        for bone in rig.pose.bones:  # parents come first
            above = bone.parent.name if bone.parent else None
            local = rest[above].inverted() @ rest[bone.name] if above else rest[bone.name]
            resting = posed[above] @ local if above else local
            name = bone.name
            posed[name] = turned(performer, name) @ turns[name] if name in turns else resting
            bone.rotation_quaternion = resting.inverted() @ posed[name]
            bone.keyframe_insert("rotation_quaternion", frame=frame)
        place_hips(performer, rig, posed["spine"], scale, low)
        rig.pose.bones["spine"].keyframe_insert("location", frame=frame)


def common(performer: bpy.types.Object, rig: bpy.types.Object) -> list[str]:
    """Bones of both, parents first."""
    return [bone.name for bone in rig.pose.bones if bone.name in performer.data.bones]


def turned(performer: bpy.types.Object, name: str) -> Quaternion:
    """How the performer's bone is turned against its rest, in the world."""
    bone = performer.pose.bones[name]
    world = performer.matrix_world.to_quaternion()
    rest = world @ bone.bone.matrix_local.to_quaternion()
    return world @ bone.matrix.to_quaternion() @ rest.inverted()


def to_performers_rest(performer: bpy.types.Object, rig: bpy.types.Object, name: str) -> Quaternion:
    """The rig's bone at rest, turned to point as the performer's does at rest (limbs), or as it
    is; a hand goes with its forearm."""
    rest = rig.data.bones[name].matrix_local.to_quaternion()
    part = name.split(".")[0]
    if part == "hand":
        return aligning(performer, rig, name.replace("hand", "forearm")) @ rest
    return aligning(performer, rig, name) @ rest if part in POINTING else rest


def aligning(performer: bpy.types.Object, rig: bpy.types.Object, name: str) -> Quaternion:
    """The smallest turn from the direction of the rig's limb at rest to the performer's."""
    return direction(rig, name).rotation_difference(direction(performer, name))


def direction(armature: bpy.types.Object, name: str) -> Vector:
    """From a limb's joint to the next one at rest, world."""
    bones, world = armature.data.bones, armature.matrix_world
    return world.to_3x3() @ (bones[following(name)].head_local - bones[name].head_local)


def following(name: str) -> str:
    """The next joint of a limb."""
    after = {"upper_arm": "forearm", "forearm": "hand", "thigh": "shin", "shin": "foot"}
    part, side = name.split(".")
    return f"{after[part]}.{side}"


def leg_length(armature: bpy.types.Object) -> float:
    """Thigh and shin, metres."""
    return sum(direction(armature, f"{part}.L").length for part in ("thigh", "shin"))


def joint(armature: bpy.types.Object, name: str) -> Vector:
    """Where a joint is now, world."""
    return armature.matrix_world @ armature.pose.bones[name].head


def lowest_ankle(performer: bpy.types.Object, frames: range) -> float:
    """The height at which the performer's ankles stand on the ground."""
    heights = []
    for frame in frames:
        bpy.context.scene.frame_set(frame)
        heights.append(min(joint(performer, f"foot.{side}").z for side in "LR"))
    return sorted(heights)[len(heights) // 10]


def place_hips(
    performer: bpy.types.Object, rig: bpy.types.Object, turn: Quaternion, scale: float, low: float
) -> None:
    """Move the rig such that the middle of its hips follows the performer's, scaled from where the
    ankles stand."""
    bones = rig.data.bones
    root, ankle = bones["spine"], bones["foot.L"].head_local.z
    middle = (joint(performer, "thigh.L") + joint(performer, "thigh.R")) / 2
    wanted = Vector((scale * middle.x, scale * middle.y, scale * (middle.z - low) + ankle))
    rest = (bones["thigh.L"].head_local + bones["thigh.R"].head_local) / 2 - root.head_local
    offset = turn @ root.matrix_local.to_quaternion().inverted() @ rest
    local = root.matrix_local.inverted() @ (wanted - offset)
    rig.pose.bones["spine"].location = local


def limb_error_deg(performer: bpy.types.Object, rig: bpy.types.Object, frames: range) -> float:
    """The largest angle between a limb of the rig and of the performer."""
    worst = 0.0
    for frame in frames:
        bpy.context.scene.frame_set(frame)
        for name in (f"{part}.{side}" for part in POINTING for side in "LR"):
            ours, theirs = (joint(a, following(name)) - joint(a, name) for a in (performer, rig))
            worst = max(worst, ours.angle(theirs))
    return worst * 57.29578


if __name__ == "__main__":
    main()
