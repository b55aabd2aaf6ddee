"""A result's performers as characters: skinned, named as a rig, with a root bone."""

from __future__ import annotations

from dataclasses import replace

from imocap_core.export.clips import camera_of, clip_of
from imocap_core.export.options import ExportOptions
from imocap_core.io.writers.clip_body import Skin, skin_of
from imocap_core.io.writers.gltf_scene import Actor
from imocap_core.io.writers.motion_clip import MotionClip
from imocap_core.io.writers.rigs import as_rig, skin_as_rig
from imocap_core.io.writers.root_bone import with_root_bone
from imocap_core.result.result import ActionResult
from imocap_core.result.video_body import shaped_body


def actors_of(result: ActionResult, options: ExportOptions) -> list[Actor]:
    """Every video's skinned character and camera, in a colour of its own."""
    from imocap_core.figures.style import VIDEO_COLORS

    actors = []
    for k, video in enumerate(result):
        shaped = shaped_body(video)
        colour = linear(VIDEO_COLORS[k % len(VIDEO_COLORS)])
        clip = clip_of(video, shaped)
        skin = skin_of_character(skin_of(shaped), clip, options)
        character = as_character(clip, options, result.up_axis)
        actors.append(Actor(character, skin, camera_of(video), colour))
    return actors


def as_character(clip: MotionClip, options: ExportOptions, up: str) -> MotionClip:
    """A clip with the joints' names, the rest pose and the root bone of a character."""
    named = as_rig(clip, options.names)
    return with_root_bone(named, up) if options.root_bone else named


def skin_of_character(skin: Skin, clip: MotionClip, options: ExportOptions) -> Skin:
    """The skin that belongs to `as_character` of a clip."""
    posed = skin_as_rig(skin, clip, options.names)
    return replace(posed, joints=posed.joints + 1) if options.root_bone else posed


def linear(hex_srgb: str) -> tuple[float, float, float]:
    """An sRGB colour (#rrggbb) in linear light, 0 to 1 (IEC 61966-2-1)."""
    screen = [int(hex_srgb[i : i + 2], 16) / 255 for i in (1, 3, 5)]
    red, green, blue = (c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in screen)
    return red, green, blue
