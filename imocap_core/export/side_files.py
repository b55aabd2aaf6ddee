"""What is written beside every export: notes on axes and units, tables; and files come complete.

Files of an export come into their folder complete, and replace nothing but an older export.
export_<format>.json lists the files that were written with their digests. A file that no export
wrote, that somebody has changed since, or that belongs to an export in another format or world is
left alone, and the new one is refused.
"""

from __future__ import annotations

import json
import os
import tomllib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from imocap_core.errors import WorkFailed, WrongUse
from imocap_core.export.export_options import LAFAN1, ExportOptions
from imocap_core.export.npz_files import BETAS_NOTE
from imocap_core.files import draft_folder, sha256_of, write_csv
from imocap_core.io.writers.bvh import FPS
from imocap_core.io.writers.text_files import CameraCalibration
from imocap_core.result.artifacts import run_record
from imocap_core.result.result import CAMERA_UP, ActionResult
from imocap_core.result.video import VideoCamera, VideoResult
from imocap_core.variation import Variation

NOTES = "export_*.json"


def write_export(
    out: Path, name: str, notes: dict[str, Any], write: Callable[[Path], list[Path]]
) -> list[Path]:
    """Write files into a folder of drafts, and their notes with a digest of each; then move all to
    the folder `out`.

    Args:
        name: of the drafts. write: writes into a folder and returns the paths.

    WorkFailed, with nothing moved, when a file cannot be written or must not be replaced.
    """
    try:
        with draft_folder(out, name) as folder:
            files = write(folder)
            listed = notes | {"files": {file.name: sha256_of(file) for file in files}}
            files.append(folder / f"export_{notes['format']}.json")
            files[-1].write_text(json.dumps(listed, indent=2) + "\n", encoding="utf-8")
            return place(files, out, files[-1].name)
    except OSError as error:
        raise WorkFailed(f"cannot write to {out}: {error.strerror}") from None


def place(drafts: Sequence[Path], out: Path, notes: str) -> list[Path]:
    """Move files into the folder `out`; WorkFailed, with nothing moved, when one must not be
    replaced. notes: the name of this export's export_<format>.json."""
    earlier = {file.name: _listed(file) for file in sorted(out.glob(NOTES))}
    for draft in drafts:
        target = out / draft.name
        if (target.exists() or target.is_symlink()) and draft.name != notes:
            _must_be_replaceable(target, draft, earlier, notes)
    placed = [out / draft.name for draft in drafts]
    for draft, target in zip(drafts, placed, strict=True):
        os.replace(draft, target)
    return placed


def _must_be_replaceable(
    target: Path, draft: Path, earlier: dict[str, dict[str, str]], notes: str
) -> None:
    present = sha256_of(target) if target.is_file() else ""
    if present == sha256_of(draft):
        return
    owners = [name for name, files in earlier.items() if files.get(target.name) == present]
    if not owners:
        raise WorkFailed(
            f"{target} exists, and was not written by an export or has been changed since; choose "
            f"another folder with --out, or move it away"
        )
    others = [name for name in owners if name != notes]
    if others:
        raise WorkFailed(
            f"{target} belongs to {others[0]}, an export of other axes or of another run; choose "
            f"another folder with --out, or give both the same --up"
        )


def _listed(notes: Path) -> dict[str, str]:
    """The files that an export wrote, by its notes; none when these are not readable."""
    try:
        files = json.loads(notes.read_text(encoding="utf-8"))["files"]
        return {str(name): str(digest) for name, digest in files.items()}
    except (OSError, ValueError, LookupError, TypeError, AttributeError, RecursionError):
        return {}


def write_variation(out: Path, variation: Variation) -> list[Path]:
    """variation.npz with all of it, variation.csv with the angles' bands, scores.csv."""
    modes, bands = variation.modes, variation.angles
    np.savez_compressed(
        out / "variation.npz",
        ids=variation.ids,
        phase_s=variation.phase_s,
        joint_names=variation.joint_names,
        mean_R_local=variation.R_local,
        mean_joints_m=variation.joints,
        mode_share=modes.share,
        mode_turns_rad=modes.turns,
        mode_shifts_m=modes.shifts,
        scores_sd=modes.scores,
        held_out=variation.held_out,
        angles=list(bands),
        angle_mean_deg=np.stack([band.mean_deg for band in bands.values()]),
        angle_sd_deg=np.stack([band.sd_deg for band in bands.values()]),
    )
    phase = [f"{t:.4f}" for t in variation.phase_s]
    rows = [
        [t, name, *(f"{x:.3f}" for x in numbers)]
        for name, band in bands.items()
        for t, *numbers in zip(phase, band.mean_deg, band.sd_deg, strict=True)
    ]
    write_csv(out / "variation.csv", ["phase_s", "angle", "mean_deg", "sd_deg"], rows)
    head = ["video", *(f"mode{k + 1}_sd" for k in range(len(modes.share)))]
    scores = zip(variation.ids, modes.scores, strict=True)
    write_csv(out / "scores.csv", head, [[v, *(f"{x:.3f}" for x in row)] for v, row in scores])
    return [out / name for name in ("variation.npz", "variation.csv", "scores.csv")]


def calibration_of(camera: VideoCamera) -> CameraCalibration:
    """A camera as calibration files hold it; WrongUse for one that turns, zooms or moves."""
    if not camera.is_static:
        raise WrongUse(
            f"--format calib: the camera of {camera.id} turns, zooms or moves, and a calibration "
            "file holds one pose a camera; leave it out with --video, or export npz, which has "
            "the camera of every frame"
        )
    lens = tuple(camera.distortion.tolist())
    return CameraCalibration(camera.id, camera.size, camera.K, camera.R, camera.t, lens)


_TEXTS = tomllib.loads(Path(__file__).with_name("notes.toml").read_text(encoding="utf-8"))
SMPL_FORMATS = ("npz", "amass")
AHEAD = {"y": "-z", "z": "+y"}


def notes_of(
    result: ActionResult, format: str, options: ExportOptions | None = None
) -> dict[str, Any]:
    """Everything that a reader of the files needs besides the numbers."""
    notes: dict[str, Any] = {
        "action": result.action,
        "format": format,
        "up_axis": result.up_axis,
        "world": _TEXTS["camera_world"]
        if result.up_axis == CAMERA_UP
        else _TEXTS["level_world"].format(up=result.up_axis, ahead=AHEAD[result.up_axis]),
        "handedness": "right",
        "units": {what: unit or None for what, unit in _TEXTS["units"][format].items()},
        "pivot": _TEXTS["smpl_pivot" if format in SMPL_FORMATS else "pivot"],
        "time": _TEXTS[f"{result.time}_time"],
        "reference": result.reference,
        "body_model": result.model,
        "betas": BETAS_NOTE if format == "amass" else _TEXTS["betas"],
        "videos": {video.id: _video(result, video) for video in result},
        "run": run_record(result.artifacts),
    }
    if format == "bvh":
        notes["rest"] = _TEXTS["bvh_rest"]
    if options is not None and options.names == LAFAN1:
        notes["units"] = notes["units"] | {"length": "centimetre"}
        notes["rest"], notes["frames_per_second"] = _TEXTS["lafan1_rest"], FPS
    if result.left_out:
        notes["left_out"] = list(result.left_out)
    return notes


def _video(result: ActionResult, video: VideoResult) -> dict[str, Any]:
    notes: dict[str, Any] = {
        "frames_per_second": video.fps,
        "frames": len(video.frames),
        "first_source_frame": float(video.frames[0]),
        "last_source_frame": float(video.frames[-1]),
        "hands": video.hands is not None,
    }
    if video.keypoints.moments is not None:
        notes["variable_frame_rate"] = _TEXTS["variable"]
        notes["first_time_s"], notes["last_time_s"] = map(float, video.time_s[[0, -1]])
    if result.time == "common":
        notes["first_phase_s"] = float(video.phase_s[0])
        notes["outside_s"] = float((~video.inside).sum() / video.fps)
    return notes
