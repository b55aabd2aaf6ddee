"""The files of `imocap angles`: tables of joint angles, and their figure."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from jaxtyping import Float

from imocap_core.biomechanics.events import angle_events
from imocap_core.biomechanics.joint_angles import without_steps
from imocap_core.export.formats import Exported
from imocap_core.export.side_files import notes_of, write_export
from imocap_core.figures.page_figures import angle_figure
from imocap_core.figures.style import quiet, save
from imocap_core.io.writers.text_files import write_angles_csv, write_events_csv
from imocap_core.result.derived import MeanAngles, mean_angles
from imocap_core.result.result import ActionResult
from imocap_core.result.video import VideoResult
from imocap_core.result.video_motion import video_angles, video_events

FORMAT = "angles"
UP = "y"
Columns = dict[str, Float[np.ndarray, " T"]]


def export_angles(result: ActionResult, out: Path) -> Exported:
    """Write joint angles of every video and their mean over the performances below `out`.

    WorkFailed when `out` cannot be written, or a file there must not be replaced (`place`).
    """
    level = result if result.up_axis == UP else result.levelled(UP)
    common: ActionResult | None = level
    if level.time != "common":
        placed = any(np.isfinite(video.phase_s).any() for video in level)
        common = level.on_common_time() if placed else None

    def write(folder: Path) -> list[Path]:
        files = [f for v in level for f in _video_tables(folder, v, level.ground.tilt_sd_deg)]
        if common is None:
            return files
        mean = mean_angles(common)
        picture = folder / "angles.png"
        with quiet():
            save(angle_figure(result.action, mean.phase_s, mean.curves), picture)
        return [*files, _mean_table(folder, mean), _mean_events(folder, mean), picture]

    return Exported(write_export(out, "angles", notes_of(level, FORMAT), write), [])


def _video_tables(folder: Path, video: VideoResult, tilt_sd_deg: float) -> list[Path]:
    """The angles and the events of one video."""
    angles = video_angles(video, UP, tilt_sd_deg)
    columns: Columns = {
        "time_s": video.time_s,
        "frame": video.frames.astype(np.float64),
        "phase_s": video.phase_s,
    }
    for name, values in angles.angles_deg.items():
        columns[f"{name}_deg"] = values
        if name in angles.sd_deg:
            columns[f"{name}_sd_deg"] = angles.sd_deg[name]
    table, events = (folder / f"{video.id}_{kind}.csv" for kind in ("angles", "events"))
    write_angles_csv(table, columns)
    moments = (columns["time_s"], columns["frame"], columns["phase_s"])
    write_events_csv(events, video_events(video, angles, UP), *moments)
    return [table, events]


def _mean_events(folder: Path, mean: MeanAngles) -> Path:
    """The turning points of the mean angles; their standard deviations are over performances."""
    curves = {name: without_steps(curve) for name, curve in mean.curves.items()}
    events = angle_events(curves, {name: curve.sd_deg for name, curve in mean.curves.items()})
    events.sort(key=lambda event: event.index)
    file, unknown = folder / "mean_events.csv", np.full(len(mean.phase_s), np.nan)
    write_events_csv(file, events, mean.phase_s, unknown, mean.phase_s)
    return file


def _mean_table(folder: Path, mean: MeanAngles) -> Path:
    first = next(iter(mean.curves.values()))
    columns: Columns = {"phase_s": mean.phase_s, "performances": first.n.astype(np.float64)}
    for name, curve in mean.curves.items():
        columns[f"{name}_mean_deg"] = curve.mean_deg
        columns[f"{name}_sd_deg"] = curve.sd_deg
    file = folder / "mean_angles.csv"
    write_angles_csv(file, columns)
    return file
