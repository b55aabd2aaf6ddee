"""Axes, units, frame rates and pivot of an export, written to export_<format>.json."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from imocap_core.export.options import LAFAN1, ExportOptions
from imocap_core.io.writers.amass_npz import BETAS_NOTE
from imocap_core.io.writers.lafan1 import FPS
from imocap_core.result.result import CAMERA_UP, ActionResult
from imocap_core.result.run_record import run_record
from imocap_core.result.video import VideoResult

UNITS = {
    "npz": {"length": "metre", "angle": "radian (axis-angle)"},
    "bvh": {"length": "metre", "angle": "degree (Euler, R = Rz Ry Rx)"},
    "glb": {"length": "metre", "angle": "unit quaternion x, y, z, w"},
    "trc": {"length": "millimetre", "angle": None},
    "csv": {"length": "metre", "angle": None},
    "opensim": {"length": "metre (trc: millimetre)", "angle": "degree (ISB, docs/angles.md)"},
    "c3d": {"length": "millimetre", "angle": "degree (ISB, docs/angles.md)"},
    "angles": {"length": None, "angle": "degree (ISB, docs/angles.md)"},
    "fbx": {"length": "centimetre", "angle": "degree (Euler, per node)"},
    "usd": {"length": "metre", "angle": "unit quaternion"},
    "calib": {"length": "metre", "angle": "radian (rotation vector)"},
    "mcap": {"length": "metre", "angle": "unit quaternion x, y, z, w"},
    "amass": {"length": "metre", "angle": "radian (axis-angle)"},
}
REST = "T pose; joints' axes at rest are the world's; the body faces +z with y up, -y with z up"
LAFAN1_REST = "LAFAN1's: every joint's x points along its bone, all angles 0"
PIVOT = (
    "pelvis: a body's translation is that of its pelvis joint, about which its global orientation "
    "turns; every other joint turns about itself"
)
SMPL_PIVOT = (
    "pelvis, in SMPL's convention: vertices = LBS(poses, turned about the rest pelvis) + trans, so "
    "the pelvis is at rest pelvis + trans; the free body's rest pelvis is the origin"
)
SMPL_FORMATS = ("npz", "amass")
OUR_BETAS = "of this body model; another model's mean other shapes"
CAMERA_WORLD = "the axes of the reference camera in its first used frame: x right, y down, z ahead"
LEVEL_WORLD = (
    "level: {up} up, right-handed, the ground at {up} = 0, the origin on it under the bodies; the "
    "reference camera looks along {ahead}"
)
VARIABLE = (
    "the file's frames are not evenly spaced in time: rows are even moments, at fractional frames"
)
AHEAD = {"y": "-z", "z": "+y"}
OWN = "own: one row or key for every used frame of the video, in its frame rate"
COMMON = (
    "common: one time axis for all videos (the sync artifact's phase, seconds of the reference), "
    "in steps of the reference's frames, so that equal times are equal moments of the action. "
    "Before a video's first and after its last moment it stands still in its nearest pose "
    "(`outside_s` below, and inside = 0 where the format has the column)"
)


def notes_of(
    result: ActionResult, format: str, options: ExportOptions | None = None
) -> dict[str, Any]:
    """Everything that a reader of the files needs besides the numbers."""
    notes: dict[str, Any] = {
        "action": result.action,
        "format": format,
        "up_axis": result.up_axis,
        "world": _world(result.up_axis),
        "handedness": "right",
        "units": UNITS[format],
        "pivot": SMPL_PIVOT if format in SMPL_FORMATS else PIVOT,
        "time": COMMON if result.time == "common" else OWN,
        "reference": result.reference,
        "body_model": result.model,
        "betas": BETAS_NOTE if format == "amass" else OUR_BETAS,
        "videos": {video.id: _video(result, video) for video in result},
        "run": run_record(result.artifacts),
    }
    if format == "bvh":
        notes["rest"] = REST
    if options is not None and options.scale == "cm":
        notes["units"] = notes["units"] | {"length": "centimetre"}
    if options is not None and options.names == LAFAN1:
        notes["rest"], notes["frames_per_second"] = LAFAN1_REST, FPS
    if result.left_out:
        notes["left_out"] = list(result.left_out)
    return notes


def _world(up_axis: str) -> str:
    if up_axis == CAMERA_UP:
        return CAMERA_WORLD
    return LEVEL_WORLD.format(up=up_axis, ahead=AHEAD[up_axis])


def write_notes(out: Path, notes: dict[str, Any]) -> Path:
    """Write out/export_<format>.json and return its path."""
    file = out / f"export_{notes['format']}.json"
    file.write_text(json.dumps(notes, indent=2) + "\n", encoding="utf-8")
    return file


def _video(result: ActionResult, video: VideoResult) -> dict[str, Any]:
    notes: dict[str, Any] = {
        "frames_per_second": video.fps,
        "frames": len(video.frames),
        "first_source_frame": float(video.frames[0]),
        "last_source_frame": float(video.frames[-1]),
        "hands": video.hands is not None,
    }
    if video.keypoints.moments is not None:
        notes["variable_frame_rate"] = VARIABLE
        notes["first_time_s"], notes["last_time_s"] = map(float, video.time_s[[0, -1]])
    if result.time == "common":
        notes["first_phase_s"] = float(video.phase_s[0])
        notes["outside_s"] = float((~video.inside).sum() / video.fps)
    return notes
