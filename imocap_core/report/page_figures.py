"""The figures of a report that are made at the end of a run, beside those of `evaluate`."""

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

CYCLE, RESULTS, UNCERTAINTY = "cycle.jpg", "results.jpg", "uncertainty.png"


def draw_late_figures(
    folder: Path,
    shots: Sequence[SheetVideo],
    results: Sequence[SheetResult],
    keypoints: Keypoints,
    refined: RefineSync,
    claimed: Uncertainty,
    by_joint: Table | None,
    model: Model,
) -> list[Picture]:
    """Round three videos and back; the same frames under each of `results`; how sure each joint is.

    by_joint: the table `uncertainty_joints`, which has the true errors.
    """
    sync = refined.sync
    trip = chosen_trip(sync)
    starts = cycle_starts(sync, trip)
    wanted = cycle_frames(sync, trip, starts) if len(trip) > 1 else {}
    picks = picks_of(shots)
    cells: dict[str, dict[int, Image]] = {}
    where: dict[str, dict[int, Window]] = {}
    made = []
    for v, shot in enumerate(shots):
        shown = wanted.get(shot.keypoints.id, set()) | {t for w, t in picks if w == v}
        if shown:
            cells[shot.keypoints.id], where[shot.keypoints.id] = read_cells(shot, sorted(shown))
    with quiet():
        if len(trip) > 1:
            posed = {
                shot.keypoints.id: _with_skeletons(shot, sorted(wanted[shot.keypoints.id]), cells, where)
                for shot in shots
                if shot.keypoints.id in wanted
            }
            frames = {v.id: v.frames for v in keypoints.videos}
            save(cycle_figure(sync, trip, starts, posed, frames), folder / CYCLE)
            made.append(Picture(CYCLE, "How frames of the videos lead to each other and back."))
        save(results_sheet(shots, results, picks, cells, where, model), folder / RESULTS)
        said = "The recovered body under each answer, over the frame and from the side."
        made.append(Picture(RESULTS, said))
        save(uncertainty_figure(claimed, keypoints, sync, by_joint), folder / UNCERTAINTY)
        made.append(Picture(UNCERTAINTY, "How uncertain each joint is, overall and over time."))
    return made


def _with_skeletons(
    shot: SheetVideo,
    frames: Sequence[int],
    cells: dict[str, dict[int, Image]],
    where: dict[str, dict[int, Window]],
) -> dict[int, Image]:
    video = shot.keypoints.id
    drawn = moment_cells(shot, frames, cells[video], where[video])
    return dict(zip(frames, drawn, strict=True))
