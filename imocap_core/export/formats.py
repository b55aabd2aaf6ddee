"""The files of `imocap export`, by format: each from the same result."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from imocap_core.artifacts.store import Store
from imocap_core.errors import WorkFailed, WrongUse
from imocap_core.export.clips import camera_of, shaped_of, take_of
from imocap_core.export.common_time import on_common_time
from imocap_core.export.mcap_view import write_mcap
from imocap_core.export.notes import notes_of, write_notes
from imocap_core.export.sources import read_result
from imocap_core.export.tables import exported, write_beside
from imocap_core.export.values import Result, Time
from imocap_core.io.writers.bvh import write_bvh
from imocap_core.io.writers.clip_body import skin_of
from imocap_core.io.writers.export_npz import write_video
from imocap_core.io.writers.gltf_scene import Actor, write_glb
from imocap_core.io.writers.joints_csv import write_joints_csv
from imocap_core.io.writers.motion_clip import MotionClip, upright_rest
from imocap_core.io.writers.trc import write_trc

DEFAULT_UP = {
    "bvh": "y",
    "glb": "y",
    "trc": "y",
    "mcap": "z",
}  # the others keep the reference camera's axes


@dataclass(frozen=True)
class Exported:
    """The files written, and what the user should know of them."""

    files: list[Path]
    said: list[str]


def export(
    store: Store,
    action: str,
    format: str,
    out: Path,
    up: str | None,
    time: Time,
    folder: Path | None = None,
) -> Exported:
    """Write an action's result below `out`; `folder` is where its videos are, which mcap shows.

    WrongUse or WorkFailed say what stands against it.
    """
    if format not in WRITERS:
        raise WrongUse(f"--format: expected one of {', '.join(WRITERS)}, got {format}")
    if format == "glb" and up == "z":
        raise WrongUse(
            "--up z: a GLB file is y up by its specification, and programs of z up (Blender) turn "
            "it when they read it; leave --up out"
        )
    whole = replace(read_result(store, action, up or DEFAULT_UP.get(format)), folder=folder)
    result = on_common_time(whole) if time == "common" else whole
    try:
        out.mkdir(parents=True, exist_ok=True)
        files = WRITERS[format](out, result)
        files += [*write_beside(out, whole), write_notes(out, notes_of(result, format))]
    except OSError as error:
        raise WorkFailed(f"cannot write to {out}: {error.strerror}") from None
    return Exported(files, _said(result))


def _npz(out: Path, result: Result) -> list[Path]:
    return [write_video(out, exported(p, result)) for p in result.performances]


def _bvh(out: Path, result: Result) -> list[Path]:
    def write(file: Path, take: MotionClip) -> None:
        write_bvh(file, upright_rest(take, result.up_axis))

    return _a_file_each(out, result, ".bvh", write)


def _trc(out: Path, result: Result) -> list[Path]:
    return _a_file_each(out, result, ".trc", write_trc)


def _csv(out: Path, result: Result) -> list[Path]:
    return _a_file_each(out, result, "_joints.csv", write_joints_csv)


def _a_file_each(
    out: Path, result: Result, ending: str, write: Callable[[Path, MotionClip], object]
) -> list[Path]:
    """One file a video, named by it."""
    files = []
    for p in result.performances:
        files.append(out / f"{p.id}{ending}")
        write(files[-1], take_of(p, shaped_of(result, p)))
    return files


def _glb(out: Path, result: Result) -> list[Path]:
    from imocap_core.figures.style import VIDEO_COLORS

    actors = []
    for k, p in enumerate(result.performances):
        shaped = shaped_of(result, p)
        colour = linear(VIDEO_COLORS[k % len(VIDEO_COLORS)])
        actors.append(Actor(take_of(p, shaped), skin_of(shaped), camera_of(p), colour))
    file = out / f"{result.action}.glb"
    write_glb(file, actors, notes_of(result, "glb"))
    return [file]


WRITERS: dict[str, Callable[[Path, Result], list[Path]]] = {
    "npz": _npz,
    "bvh": _bvh,
    "glb": _glb,
    "trc": _trc,
    "csv": _csv,
    "mcap": write_mcap,
}


def linear(hex_srgb: str) -> tuple[float, float, float]:
    """A colour as written for screens (#rrggbb), in linear light (IEC 61966-2-1)."""
    screen = [int(hex_srgb[i : i + 2], 16) / 255 for i in (1, 3, 5)]
    red, green, blue = (c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in screen)
    return red, green, blue


def _said(result: Result) -> list[str]:
    if not result.left_out:
        return []
    return [f"left out, as they have no place on the common axis: {', '.join(result.left_out)}"]
