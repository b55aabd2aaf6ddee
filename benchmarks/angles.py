"""`imocap benchmark angles`: errors of joint angles and of peak speeds, and of what is stated."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from rich.table import Table
from scipy.ndimage import gaussian_filter1d

from benchmarks.actions.captured_videos import Choice
from benchmarks.actions.prepare import chosen_names, ready_job
from benchmarks.chance import between_deg
from benchmarks.names import BenchmarkOptions
from benchmarks.parallel import ActionDisplay
from benchmarks.tables import markdown_of_rows, table_of_rows, write_rows, write_texts
from imocap_core.alignment import rigid
from imocap_core.library.result import Result
from imocap_core.pipeline import runner
from imocap_core.pipeline.runner import Display, Job
from imocap_core.result.video_motion import video_angles
from imocap_core.workspace import Workspace

# `imocap benchmark angles`: errors of angles, peak speeds and accelerations on captured trials.
#
# Bends of elbows and knees, which captured joints determine: mean absolute error, bias and limits
# of agreement (Bland and Altman, Lancet 327, 1986), and how many true angles lie within the band
# that the result states for 90 %. Of wrists and ankles the highest speed about the middle of the
# hips, and of all limbs' joints the accelerations there. Marker capture has noise of its own that
# differences blow up, so solved and captured joints go through the same Gaussian, as gait
# laboratories filter.

NAME = "angles"
BENDS = {"elbow": ("shoulder", "elbow", "wrist"), "knee": ("hip", "knee", "ankle")}
NINETY = 1.645  # standard deviations
PEAKS_FRAMES = 1.0  # standard deviation of the Gaussian before a peak is taken
FILTERS_FRAMES = (0.0, 1.0, 2.0)  # the same before accelerations
LIMBS = tuple(
    f"{side}_{joint}"
    for joint in ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")
    for side in ("left", "right")
)


@dataclass(frozen=True)
class AngleRow:
    """Of an angle over all frames: errors in degrees, and the share of frames, per cent, in which
    the true angle lies within the stated band of 90 %."""

    angle: str
    frames: int
    mean_absolute_deg: float
    bias_deg: float
    limits_deg: float
    within_band_pct: float


@dataclass(frozen=True)
class PeakRow:
    """Of a joint's highest speed over all videos, per cent of the true one."""

    joint: str
    videos: int
    median_error_pct: float
    median_absolute_error_pct: float


@dataclass(frozen=True)
class AccelerationRow:
    """Mean acceleration of the limbs' joints and mean length of its error, m/s², both motions
    through a Gaussian of `filter_frames`."""

    filter_frames: float
    true_m_s2: float
    error_m_s2: float


@dataclass(frozen=True)
class _Measured:
    angles: dict[str, list[Float[np.ndarray, "2 _"]]]  # errors and stated standard deviations
    peaks: dict[str, list[float]]
    accelerations: list[Float[np.ndarray, "F 2"]]  # a video: true and error, a row a filter


def report(options: BenchmarkOptions, workspace: Workspace, display: Display) -> list[Table | str]:
    """A row an angle, a row a joint, and a row a filter."""
    choice = Choice("trials", options.detector, videos=options.videos, only=options.only)
    measured = _Measured(defaultdict(list), defaultdict(list), [])
    for name in chosen_names(workspace.root, choice):
        shown = ActionDisplay(display, name)
        job = ready_job(workspace, choice, name, (), shown)
        runner.run(job, shown, job.pipeline.upstream("uncertainty"))
        _add(measured, Result.of_action(job.store, job.action), job)
    folder = workspace.root / "artifacts" / "benchmark" / f"{NAME}-{options.detector}"
    angles = [_angle_row(name, parts) for name, parts in sorted(measured.angles.items())]
    peaks = [_peak_row(name, errors) for name, errors in sorted(measured.peaks.items())]
    pairs = zip(FILTERS_FRAMES, np.mean(measured.accelerations, axis=0), strict=True)
    accelerations = [AccelerationRow(filtered, *map(float, row)) for filtered, row in pairs]
    tables: dict[str, Sequence[Any]] = {
        "angles": angles,
        "peaks": peaks,
        "accelerations": accelerations,
    }
    for name, rows in tables.items():
        write_rows(folder, name, rows)
    text = "\n\n".join(markdown_of_rows(rows) for rows in tables.values())
    write_texts(folder, {"results.md": text + "\n"})
    return [*(table_of_rows(rows) for rows in tables.values()), f"Written to {folder}"]


def _add(measured: _Measured, result: Result, job: Job) -> None:
    level = result.levelled("y")
    assert job.action.truth is not None
    with np.load(Path(job.action.folder / job.action.truth)) as truth:
        names = [str(name) for name in truth["joint_names"]]
        for video in level:
            true = truth[f"{video.id}/joints"][video.frames.astype(int)]
            of = video_angles(video, "y", level.ground.tilt_sd_deg)
            for kind, side, joints in _bends(names):
                name = f"{side}_{kind}_flexion"
                error = of.angles_deg[name] - bend_deg(true[:, joints])
                measured.angles[kind].append(np.stack([error, of.sd_deg[name]]))
            solved = _about_hips(np.stack([video.joint(joint) for joint in LIMBS], axis=1))
            captured = _about_hips(true[:, [names.index(joint) for joint in LIMBS]])
            for name, error in _peaks(solved, captured, video.fps).items():
                measured.peaks[name].append(error)
            measured.accelerations.append(_accelerations(solved, captured, video.fps))


def _bends(names: list[str]) -> Iterator[tuple[str, str, list[int]]]:
    for kind, ends in BENDS.items():
        for side in ("left", "right"):
            yield kind, side, [names.index(f"{side}_{end}") for end in ends]


def _about_hips(joints: Float[np.ndarray, "T J 3"]) -> Float[np.ndarray, "T J 3"]:
    """`LIMBS` about the middle of the hips."""
    hips = [LIMBS.index(f"{side}_hip") for side in ("left", "right")]
    return joints - joints[:, hips].mean(axis=1, keepdims=True)


def _peaks(
    solved: Float[np.ndarray, "T J 3"], captured: Float[np.ndarray, "T J 3"], fps: float
) -> dict[str, float]:
    """Errors of the highest speeds of wrists and ankles, per cent of the captured ones."""
    errors = {}
    for joint in [name for name in LIMBS if name.endswith(("wrist", "ankle"))]:
        peak, true = (
            peak_m_s(gaussian_filter1d(of[:, LIMBS.index(joint)], PEAKS_FRAMES, axis=0), fps)
            for of in (solved, captured)
        )
        side, kind = joint.split("_")
        errors[f"{kind} {side}"] = 100 * (peak / true - 1)
    return errors


def _accelerations(
    solved: Float[np.ndarray, "T J 3"], captured: Float[np.ndarray, "T J 3"], fps: float
) -> Float[np.ndarray, "F 2"]:
    """Mean true acceleration and mean length of the error, m/s², a row a filter; the solved motion
    is turned onto the captured one by one rotation."""
    solved = rigid(solved.reshape(-1, 3), captured.reshape(-1, 3)).apply(solved)
    rows = []
    for frames in FILTERS_FRAMES:
        both = np.stack([solved, captured])
        smooth = gaussian_filter1d(both, frames, axis=1) if frames else both
        of_solved, of_captured = fps**2 * np.diff(smooth, 2, axis=1)
        parts = of_captured, of_solved - of_captured
        rows.append([np.linalg.norm(part, axis=-1).mean() for part in parts])
    return np.array(rows)


def peak_m_s(place_m: Float[np.ndarray, "T 3"], fps: float) -> float:
    """Highest speed of a joint, metres a second, by central differences."""
    return float(fps * np.linalg.norm(place_m[2:] - place_m[:-2], axis=-1).max() / 2)


def bend_deg(joints: Float[np.ndarray, "N 3 3"]) -> Float[np.ndarray, " N"]:
    """How far a limb of three joints is bent: 0 where it is straight."""
    return between_deg(joints[:, 1] - joints[:, 0], joints[:, 2] - joints[:, 1])


def _angle_row(name: str, parts: list[Float[np.ndarray, "2 _"]]) -> AngleRow:
    error, sd = np.concatenate(parts, axis=1)
    given = np.isfinite(error) & np.isfinite(sd)
    error, sd = error[given], sd[given]
    return AngleRow(
        angle=name,
        frames=len(error),
        mean_absolute_deg=float(np.abs(error).mean()),
        bias_deg=float(error.mean()),
        limits_deg=float(1.96 * error.std()),
        within_band_pct=float(100 * (np.abs(error) <= NINETY * sd).mean()),
    )


def _peak_row(name: str, errors: list[float]) -> PeakRow:
    given = np.array(errors)
    return PeakRow(name, len(given), float(np.median(given)), float(np.median(np.abs(given))))
