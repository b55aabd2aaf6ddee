"""Results as motion clips and characters: a joint tree, a camera, a rig with a root bone."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from imocap_core.body import Shaped
from imocap_core.camera.gravity import heading, on_floor, y_up_axes
from imocap_core.export.export_options import ExportOptions
from imocap_core.io.writers.gltf import Actor, ClipCamera, skin_of
from imocap_core.io.writers.motion_clip import MotionClip, bone_tips
from imocap_core.io.writers.rigs import as_rig, skin_as_rig
from imocap_core.result.derived import FootLock
from imocap_core.result.result import ActionResult
from imocap_core.result.video import STATIC_TOLERANCE, VideoResult
from imocap_core.result.video_motion import shaped_body


def clip_of(video: VideoResult, shaped: Shaped) -> MotionClip:
    """One video's motion as a joint tree in motion."""
    rest = shaped.joints_rest.numpy()
    return MotionClip(
        id=video.id,
        joint_names=shaped.model.joint_names,
        parents=shaped.model.parents,
        rest=rest - rest[0],
        tips=bone_tips(shaped),
        R_local=video.rotations,
        pelvis=video.trans + rest[0],
        fps=video.fps,
        frames=video.frames.astype(np.float64),
        inside=video.inside,
        phase_s=video.phase_s,
    )


def camera_of(video: VideoResult) -> ClipCamera:
    """The camera that filmed it, with one rotation and one zoom where it is static."""
    camera = video.camera
    turning = np.abs(camera.R_first_from_frame - np.eye(3)).max() > STATIC_TOLERANCE
    return ClipCamera(
        id=video.id,
        K=camera.K,
        zoom=camera.zoom if np.ptp(camera.zoom) > STATIC_TOLERANCE else camera.zoom[:1],
        size=camera.size,
        R_cam_from_world=camera.R_per_frame if turning else camera.R[None],
        centre=camera.centre[None] if camera.path_m is None else camera.centre_per_frame,
    )


NAME = "root"


def with_root_bone(clip: MotionClip, up: str) -> MotionClip:
    """The same motion with a bone `root` above the pelvis, in a world whose y or z points up.

    The root is on the floor under the pelvis and turns with the body's heading about the vertical;
    the pelvis moves against it.
    """
    to_y = y_up_axes(up)
    turned = to_y.T @ heading(to_y @ clip.R_local[:, 0])
    R_local = np.concatenate([turned[:, None], clip.R_local], axis=1)
    R_local[:, 1] = np.swapaxes(turned, -1, -2) @ clip.R_local[:, 0]
    return replace(
        clip,
        joint_names=(NAME, *clip.joint_names),
        parents=(-1, *(parent + 1 for parent in clip.parents)),
        rest=np.concatenate([np.zeros((1, 3)), clip.rest]),
        tips={joint + 1: tip for joint, tip in clip.tips.items()},
        R_local=R_local,
        root=on_floor(clip.pelvis, up),
    )


def actors_of(result: ActionResult, options: ExportOptions) -> list[Actor]:
    """Every video's skinned character and camera, in a colour of its own."""
    from imocap_core.figures.style import VIDEO_COLORS

    actors = []
    for k, video in enumerate(result):
        shaped = shaped_body(video)
        colour = linear(VIDEO_COLORS[k % len(VIDEO_COLORS)])
        clip = clip_of(video, shaped)
        skin = skin_as_rig(skin_of(shaped), clip, options.names)
        if options.root_bone:
            skin = replace(skin, joints=skin.joints + 1)
        character = as_character(clip, options, result.up_axis)
        actors.append(Actor(character, skin, camera_of(video), colour))
    return actors


def as_character(clip: MotionClip, options: ExportOptions, up: str) -> MotionClip:
    """A clip with the joints' names, the rest pose and the root bone of a character."""
    named = as_rig(clip, options.names)
    return with_root_bone(named, up) if options.root_bone else named


def linear(hex_srgb: str) -> tuple[float, float, float]:
    """An sRGB colour (#rrggbb) in linear light, 0 to 1 (IEC 61966-2-1)."""
    screen = [int(hex_srgb[i : i + 2], 16) / 255 for i in (1, 3, 5)]
    red, green, blue = (c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in screen)
    return red, green, blue


def foot_lock_notes(locks: Mapping[str, FootLock]) -> list[str]:
    """A sentence for each video."""
    notes = []
    for video, lock in locks.items():
        short = f"; in {lock.short} frames a leg is too short for it" if lock.short else ""
        notes.append(
            f"{video}: feet in contact ({lock.contact_pct:.0f} % of the time) moved "
            f"{lock.slid_mm:.1f} mm a frame, now {lock.slides_mm:.1f}; joints changed by "
            f"{lock.moved_mm:.1f} mm on average, {lock.most_mm:.0f} at most{short}"
            if lock.contact_pct
            else f"{video}: no foot stands on the ground, nothing was locked"
        )
    return notes
