"""The files of `imocap export`, by format."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

from imocap_core.detect.environment import Announce
from imocap_core.errors import WrongUse
from imocap_core.export.blender import FORMATS as OF_BLENDER
from imocap_core.export.blender import blender_program, write_characters
from imocap_core.export.clips import actors_of, as_character, clip_of, foot_lock_notes
from imocap_core.export.export_options import LAFAN1, ExportOptions
from imocap_core.export.laboratory import trial_of, write_opensim
from imocap_core.export.npz_files import (
    video_arrays,
    write_amass,
    write_cameras,
    write_sync,
    write_video,
)
from imocap_core.export.side_files import calibration_of, notes_of, write_export, write_variation
from imocap_core.export.view_file import write_mcap, write_rrd
from imocap_core.io.writers.bvh import as_lafan1, write_bvh
from imocap_core.io.writers.c3d import c3d_bytes
from imocap_core.io.writers.gltf import write_glb
from imocap_core.io.writers.motion_clip import MotionClip, scaled, upright_rest
from imocap_core.io.writers.text_files import write_calibration, write_joints_csv, write_trc
from imocap_core.result import derived
from imocap_core.result.result import ActionResult, Time
from imocap_core.result.video import VideoResult
from imocap_core.result.video_motion import shaped_body
from imocap_core.variation import Variation

DEFAULT_UP = {
    "bvh": "y",
    "glb": "y",
    "trc": "y",
    "c3d": "z",
    "opensim": "y",
    "mcap": "z",
    "rrd": "z",
    "amass": "z",
    "fbx": "y",
    "usd": "y",
    "calib": "z",
}  # the others keep the reference camera's axes

TURNED = "is y up, and programs of z up (Blender, Unreal) turn it when they read it"
ONLY_UP = {  # formats of one axis: which, and why
    "glb": ("y", f"a GLB file {TURNED}"),
    "fbx": ("y", f"an FBX file {TURNED}"),
    "opensim": ("y", "OpenSim's ground is y up"),
    "amass": ("z", "AMASS's files are z up, and their readers turn them"),
}
DEFAULT = ExportOptions()
CENTIMETRES = 100.0  # a metre


@dataclass(frozen=True)
class Exported:
    """The files written, and sentences about them for the user."""

    files: list[Path]
    notes: list[str]


def export(
    result: ActionResult,
    format: str,
    out: Path,
    up: str | None = None,
    time: Time = "own",
    options: ExportOptions = DEFAULT,
    announce: Announce = lambda step: None,
    variation: Variation | None = None,
) -> Exported:
    """Write a result below the folder `out`.

    Args:
        format: one of `WRITERS`.
        up: the axis (y or z) that points up in a world levelled by the ground; None: as usual for
            the format (`DEFAULT_UP`), or as the result is.
        time: own: as the result is; common: all videos at the moments of one grid.
        options: what of it, where its origin is, as what character.
        announce: called before a slow step, the installation of Blender for fbx and usd.
        variation: its mean and modes instead of the videos.

    WrongUse for what a format cannot hold, WorkFailed when the result lacks something, `out` cannot
    be written, or a file there must not be replaced (`place`).
    """
    check_format(format, up)
    options.check(format)
    if options.names == LAFAN1 and up == "z":
        raise WrongUse("--up z: files of LAFAN1's kind are y up; leave --up out")
    if format in OF_BLENDER:
        blender_program(announce)
    up = up or DEFAULT_UP.get(format) or ("y" if options.levelled else None)
    placed = result if up in (None, result.up_axis) else result.levelled(str(up))
    one_clip = options.mean or variation is not None
    together = (time == "common" or one_clip) and result.time != "common"
    written = placed.on_common_time() if together else placed
    written = derived.mean_performance(written) if one_clip else written.only(options.videos)
    if variation is not None:
        written = derived.mode_clips(written, variation)
    if options.origin == "start":
        first = written.videos[0]
        placed, written = derived.from_start(placed, first), derived.from_start(written, first)
    locks: dict[str, derived.FootLock] = {}
    if options.lock_feet:
        written, locks = derived.with_locked_feet(written)
    notes = notes_of(written, format, options)
    notes |= {"options": asdict(options)} if options != DEFAULT else {}
    notes |= {"foot_lock": {v: asdict(lock) for v, lock in locks.items()}} if locks else {}

    def write(folder: Path) -> list[Path]:
        files = WRITERS[format](folder, written, options)
        files += [write_sync(folder, placed.sync), write_cameras(folder, placed)]
        return files if variation is None else files + write_variation(folder, variation)

    files = write_export(out, "export", notes, write)
    left_out = ", ".join(written.left_out)
    remarks = (
        [f"left out, as they have no place on the common axis: {left_out}"] if left_out else []
    )
    return Exported(files, [*remarks, *foot_lock_notes(locks)])


def check_format(format: str, up: str | None) -> None:
    """WrongUse for an unknown format, or one that cannot have this axis up."""
    if format not in WRITERS:
        raise WrongUse(f"--format: expected one of {', '.join(WRITERS)}, got {format}")
    only, why = ONLY_UP.get(format, (up, ""))
    if up not in (None, only):
        raise WrongUse(f"--up {up}: {why}; leave --up out")


def _of_each(
    out: Path, result: ActionResult, ending: str, write: Callable[[Path, VideoResult], object]
) -> list[Path]:
    """One file per video, named after it."""
    files = [out / f"{video.id}{ending}" for video in result]
    for file, video in zip(files, result, strict=True):
        write(file, video)
    return files


def _clip(video: VideoResult) -> MotionClip:
    return clip_of(video, shaped_body(video))


def _bvh(out: Path, result: ActionResult, options: ExportOptions) -> list[Path]:
    def write(file: Path, video: VideoResult) -> None:
        if options.names == LAFAN1:
            character = as_lafan1(_clip(video))
        else:
            up = result.up_axis
            character = upright_rest(as_character(_clip(video), options, up), up)
        write_bvh(file, scaled(character, CENTIMETRES) if options.names == LAFAN1 else character)

    return _of_each(out, result, ".bvh", write)


def _glb(out: Path, result: ActionResult, options: ExportOptions) -> list[Path]:
    file = out / f"{result.action}.glb"
    write_glb(file, actors_of(result, options), notes_of(result, "glb"))
    return [file]


def _by_blender(out: Path, result: ActionResult, options: ExportOptions, format: str) -> list[Path]:
    """One character per file; Blender gets a world with y up, as GLB has."""
    program = blender_program(lambda step: None)
    actors = actors_of(derived.turned_y_up(result), options)
    notes = notes_of(result, format)
    return write_characters(program, out, actors, format, notes, result.up_axis)


WRITERS: dict[str, Callable[[Path, ActionResult, ExportOptions], list[Path]]] = {
    "npz": lambda out, result, _: [write_video(out, v, result) for v in result],
    "bvh": _bvh,
    "glb": _glb,
    "trc": lambda out, result, _: _of_each(
        out, result, ".trc", lambda f, v: write_trc(f, _clip(v))
    ),
    "csv": lambda out, result, _: _of_each(
        out, result, "_joints.csv", lambda f, v: write_joints_csv(f, _clip(v), v.joint_sd_mm)
    ),
    "c3d": lambda out, result, _: _of_each(
        out, result, ".c3d", lambda f, v: f.write_bytes(c3d_bytes(trial_of(v, result.up_axis)))
    ),
    "opensim": lambda out, result, _: write_opensim(out, result),
    "mcap": lambda out, result, _: write_mcap(out, result),
    "rrd": lambda out, result, _: write_rrd(out, result),
    "amass": lambda out, result, _: [
        file for v in result for file in write_amass(out, v.id, video_arrays(v, result))
    ],
    "fbx": lambda out, result, options: _by_blender(out, result, options, "fbx"),
    "usd": lambda out, result, options: _by_blender(out, result, options, "usd"),
    "calib": lambda out, result, _: write_calibration(
        out, [calibration_of(video.camera) for video in result]
    ),
}
