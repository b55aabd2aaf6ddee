"""Figures of the report's page, drawn at the end of a run beside those of the stage evaluate."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from imocap_core.artifacts.schemas import Keypoints, RefineSync, Table, Uncertainty
from imocap_core.body import Model
from imocap_core.figures.contact_sheets import SheetVideo, moment_cells, read_cells
from imocap_core.figures.cycle_figure import cycle_figure
from imocap_core.figures.cycle_trip import chosen_trip, cycle_frames, cycle_starts
from imocap_core.figures.overlays import Image, Window
from imocap_core.figures.results_sheet import SheetResult, picks_of, results_sheet
from imocap_core.figures.style import quiet, save
from imocap_core.figures.uncertainty_figure import uncertainty_figure
from imocap_core.report.files import Picture
from imocap_core.workers import at_once

CYCLE, RESULTS, UNCERTAINTY = "cycle.jpg", "results.jpg", "uncertainty.png"


def draw_page_figures(
    folder: Path,
    videos: Sequence[SheetVideo],
    results: Sequence[SheetResult],
    keypoints: Keypoints,
    refined: RefineSync,
    claimed: Uncertainty,
    by_joint: Table | None,
    model: Model,
) -> list[Picture]:
    """Round trips over three videos; the same frames under each of `results`; the uncertainty of
    each joint.

    by_joint: the table `uncertainty_joints`, which has the true errors.
    """
    sync = refined.sync
    trip = chosen_trip(sync)
    starts = cycle_starts(sync, trip)
    of_trip = cycle_frames(sync, trip, starts) if len(trip) > 1 else {}
    picks = picks_of(videos)
    shown = [
        sorted(of_trip.get(video.keypoints.id, set()) | {t for w, t in picks if w == v})
        for v, video in enumerate(videos)
    ]
    read = [(video, frames) for video, frames in zip(videos, shown, strict=True) if frames]
    cells: dict[str, dict[int, Image]] = {}
    cuts: dict[str, dict[int, Window]] = {}
    of_videos = at_once(lambda item: read_cells(*item), read)
    for (video, _), (cells_of, cuts_of) in zip(read, of_videos, strict=True):
        cells[video.keypoints.id], cuts[video.keypoints.id] = cells_of, cuts_of
    drawn = []
    with quiet():
        if len(trip) > 1:
            posed = {
                name: _with_skeletons(video, sorted(of_trip[name]), cells[name], cuts[name])
                for video in videos
                if (name := video.keypoints.id) in of_trip
            }
            frames = {v.id: v.frames for v in keypoints.videos}
            save(cycle_figure(sync, trip, starts, posed, frames), folder / CYCLE)
            drawn.append(Picture(CYCLE, "Matches of frames from video to video and back."))
        save(results_sheet(videos, results, picks, cells, cuts, model), folder / RESULTS)
        caption = "The recovered body under each result, over the frame and from the side."
        drawn.append(Picture(RESULTS, caption))
        save(uncertainty_figure(claimed, keypoints, sync, by_joint), folder / UNCERTAINTY)
        drawn.append(Picture(UNCERTAINTY, "Uncertainty of each joint, overall and over time."))
    return drawn


def _with_skeletons(
    video: SheetVideo, frames: Sequence[int], cells: dict[int, Image], cuts: dict[int, Window]
) -> dict[int, Image]:
    return dict(zip(frames, moment_cells(video, frames, cells, cuts), strict=True))
