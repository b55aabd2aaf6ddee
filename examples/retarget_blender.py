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
performer's: bones point where the performer's point, the path is scaled by the legs' length, and
the legs bend such that the feet stand where the performer's do.
"""

from __future__ import annotations

import argparse
import json
import struct
import sys
from math import degrees
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
    arms, legs = limb_errors_deg(performer, rig, frames)
    print(f"{len(frames)} frames; arms within {arms:.2f} degrees, legs within {legs:.2f}")
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
    if not tree.get("animations"):
        sys.exit(f"{file}: no animation")
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
    low, floor = standing_height(performer, frames), rig.data.bones["toe.L"].head_local.z

    def scaled(place: Vector) -> Vector:
        return Vector((scale * place.x, scale * place.y, scale * (place.z - low) + floor))

    for frame in frames:
        bpy.context.scene.frame_set(frame)
        posed: dict[str, Quaternion] = {}
        for bone in rig.pose.bones:  # parents come first
            if bone.name in turns:
                posed[bone.name] = turned(performer, bone.name) @ turns[bone.name]
            else:
                posed[bone.name] = unturned(bone, rest, posed)
        root = root_place(rig, posed, scaled(middle_of_hips(performer)))
        for side in "LR":
            place_foot(rig, posed, root, side, scaled(joint(performer, f"toe.{side}")))
        for bone in rig.pose.bones:
            resting = unturned(bone, rest, posed)
            bone.rotation_quaternion = resting.inverted() @ posed[bone.name]
            bone.keyframe_insert("rotation_quaternion", frame=frame)
        spine = rig.pose.bones["spine"]
        spine.location = spine.bone.matrix_local.inverted() @ root
        spine.keyframe_insert("location", frame=frame)


def unturned(
    bone: bpy.types.PoseBone, rest: dict[str, Quaternion], posed: dict[str, Quaternion]
) -> Quaternion:
    """A bone that follows its parent."""
    if bone.parent is None:
        return rest[bone.name]
    above = bone.parent.name
    return posed[above] @ rest[above].inverted() @ rest[bone.name]


def root_place(rig: bpy.types.Object, posed: dict[str, Quaternion], hips: Vector) -> Vector:
    """Where the root bone begins when the middle of the hips is at a place."""
    middle = (vector(rig, posed, "spine", "thigh.L") + vector(rig, posed, "spine", "thigh.R")) / 2
    return hips - middle


def vector(rig: bpy.types.Object, posed: dict[str, Quaternion], name: str, to: str) -> Vector:
    """From a bone's joint to another joint that it moves."""
    bones = rig.data.bones
    turn = posed[name] @ bones[name].matrix_local.to_quaternion().inverted()
    return turn @ (bones[to].head_local - bones[name].head_local)


def place_foot(
    rig: bpy.types.Object, posed: dict[str, Quaternion], root: Vector, side: str, ball: Vector
) -> None:
    """Turn thigh and shin such that the ball of the foot is at a place: inverse kinematics.

    The hips and the foot's turn stay; the knee bends by the law of cosines, in its own plane.
    """
    thigh, shin, foot = (f"{part}.{side}" for part in ("thigh", "shin", "foot"))
    hip = root + vector(rig, posed, "spine", thigh)
    upper, lower = vector(rig, posed, thigh, shin), vector(rig, posed, shin, foot)
    wanted = ball - vector(rig, posed, foot, f"toe.{side}") - hip
    a, b = upper.length, lower.length
    far = min(max(wanted.length, abs(a - b) + 1e-5), a + b - 1e-5)
    cosine = (far**2 - a**2 - b**2) / (2 * a * b)
    along = upper.normalized()
    aside = lower - lower.dot(along) * along
    behind = posed[thigh] @ rig.data.bones[thigh].matrix_local.to_quaternion().inverted()
    aside += 0.02 * (behind @ Vector((0.0, 1.0, 0.0)))  # where knees bend to, of a straight leg
    aside = (aside - aside.dot(along) * along).normalized()
    bent = b * (cosine * along + (1 - cosine**2) ** 0.5 * aside)
    leg = (upper + bent).rotation_difference(wanted)
    posed[thigh] = leg @ posed[thigh]
    posed[shin] = leg @ lower.rotation_difference(bent) @ posed[shin]


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


def middle_of_hips(armature: bpy.types.Object) -> Vector:
    """Between the hips now, world."""
    return (joint(armature, "thigh.L") + joint(armature, "thigh.R")) / 2


def standing_height(performer: bpy.types.Object, frames: range) -> float:
    """The height of the balls of the performer's feet where they stand."""
    heights = []
    for frame in frames:
        bpy.context.scene.frame_set(frame)
        heights.append(min(joint(performer, f"toe.{side}").z for side in "LR"))
    return sorted(heights)[len(heights) // 10]


def limb_errors_deg(
    performer: bpy.types.Object, rig: bpy.types.Object, frames: range
) -> tuple[float, float]:
    """The largest angles between arms, and between legs, of the rig and of the performer."""
    worst = [0.0, 0.0]
    for frame in frames:
        bpy.context.scene.frame_set(frame)
        for part in POINTING:
            for name in (f"{part}.L", f"{part}.R"):
                ours, theirs = (
                    joint(a, following(name)) - joint(a, name) for a in (performer, rig)
                )
                leg = part in ("thigh", "shin")
                worst[leg] = max(worst[leg], degrees(ours.angle(theirs)))
    return worst[0], worst[1]


if __name__ == "__main__":
    main()
