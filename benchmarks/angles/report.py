"""`imocap benchmark angles`: errors of joint angles and peak speeds on captured trials.

Bends of elbows and knees, which captured joints determine: mean absolute error, bias and limits of
agreement (Bland and Altman, Lancet 327, 1986), and how many true angles lie within the band that
the result states for 90 %. Of wrists and ankles the highest speed about the middle of the hips.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float
from rich.table import Table
from scipy.ndimage import gaussian_filter1d

from benchmarks.actions.choice import Choice
from benchmarks.actions.prepare import chosen_names, ready_job
from benchmarks.chance.takes import between_deg
from benchmarks.names import BenchmarkOptions, table_of_rows
from benchmarks.parallel import ActionDisplay
from benchmarks.tables import write_rows
from imocap_core.library.result import Result
from imocap_core.pipeline import runner
from imocap_core.pipeline.runner import Display, Job
from imocap_core.result.video import VideoResult
from imocap_core.result.video_motion import video_angles
from imocap_core.workspace import Workspace

NAME = "angles"
BENDS = {"elbow": ("shoulder", "elbow", "wrist"), "knee": ("hip", "knee", "ankle")}
NINETY = 1.645  # standard deviations
SMOOTH_FRAMES = 1.0  # of the true joints, whose noise has peaks of its own


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
class _Measured:
    angles: dict[str, list[Float[np.ndarray, "2 _"]]]  # errors and stated standard deviations
    peaks: dict[str, list[float]]


def report(options: BenchmarkOptions, workspace: Workspace, display: Display) -> list[Table | str]:
    """A row an angle, and a row a joint."""
    choice = Choice("trials", options.detector, videos=options.videos, only=options.only)
    measured = _Measured(defaultdict(list), defaultdict(list))
    for name in chosen_names(workspace.root, choice):
        shown = ActionDisplay(display, name)
        job = ready_job(workspace, choice, name, (), shown)
        runner.run(job, shown, job.pipeline.upstream("uncertainty"))
        _add(measured, Result.of_action(job.store, job.action), job)
    folder = workspace.root / "artifacts" / "benchmark" / f"{NAME}-{options.detector}"
    angles = [_angle_row(name, parts) for name, parts in sorted(measured.angles.items())]
    peaks = [_peak_row(name, errors) for name, errors in sorted(measured.peaks.items())]
    write_rows(folder, "angles", angles)
    write_rows(folder, "peaks", peaks)
    return [table_of_rows(angles), table_of_rows(peaks), f"Written to {folder}"]


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
            for name, (peak, true_peak) in _peaks(video, true, names).items():
                measured.peaks[name].append(100 * (peak / true_peak - 1))


def _bends(names: list[str]) -> Iterator[tuple[str, str, list[int]]]:
    for kind, ends in BENDS.items():
        for side in ("left", "right"):
            yield kind, side, [names.index(f"{side}_{end}") for end in ends]


def _peaks(
    video: VideoResult, true: Float[np.ndarray, "T J 3"], names: list[str]
) -> dict[str, tuple[float, float]]:
    peaks = {}
    for kind in ("wrist", "ankle"):
        for side in ("left", "right"):
            joint = f"{side}_{kind}"
            solved = video.joint(joint) - (video.joint("left_hip") + video.joint("right_hip")) / 2
            hips = (true[:, names.index("left_hip")] + true[:, names.index("right_hip")]) / 2
            captured = gaussian_filter1d(true[:, names.index(joint)] - hips, SMOOTH_FRAMES, axis=0)
            peaks[f"{kind} {side}"] = (peak_m_s(solved, video.fps), peak_m_s(captured, video.fps))
    return peaks


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
