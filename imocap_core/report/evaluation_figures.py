"""All figures of a report, written to its folder."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from imocap_core.artifacts.schemas import RefineSync, Sync
from imocap_core.body import Model
from imocap_core.conventions import EVAL_12
from imocap_core.evaluate.scoreboard import StageResult, joint_errors_mm
from imocap_core.figures.contact_sheets import (
    SheetVideo,
    frames_of_moments,
    moment_cells,
    read_cells,
    spread,
    video_sheet,
)
from imocap_core.figures.error_figure import joint_error_figure
from imocap_core.figures.overlays import contact_sheet
from imocap_core.figures.scene_figure import scene_figure
from imocap_core.figures.style import quiet, save
from imocap_core.figures.sync_figures import affinity_figure, rounds_figure, warp_figure
from imocap_core.io.truth import Truth
from imocap_core.report.files import Picture

Array = NDArray[np.float64]

ROUND_ERRORS = {"sync_error_pct": "sync error (%)", "pa_mpjpe_mm": "P-MPJPE (mm)"}


def draw_numbers(
    folder: Path,
    sync: Sync,
    refined: RefineSync,
    answers: Sequence[StageResult],
    truth: Truth | None,
    true_positions: Mapping[str, Array],
    round_errors: Sequence[Mapping[str, float]],
) -> list[Picture]:
    """Figures of numbers: errors, synchronisation, cameras and paths, the rounds of the loop.

    Args:
        true_positions: video id -> (T,) index into the reference. round_errors: per round, metric
            -> mean over the videos; empty without truth.
    """
    with quiet():
        made = [
            (_joint_errors(answers, truth), "joint_errors.png", "Error of each joint."),
            (
                warp_figure(sync, refined.sync, true_positions),
                "warp.png",
                "Where each frame of each video lies in the reference video.",
            ),
            (
                affinity_figure(refined.sync, true_positions),
                "affinity.png",
                "Affinity of the poses before and after cycle consistency, with the path found.",
            ),
            (
                scene_figure(
                    refined.motion.videos, refined.motion.cameras, refined.motion.reference
                ),
                "scene.png",
                "Recovered cameras and the path of the root in each video.",
            ),
            (
                _rounds(refined, round_errors),
                "rounds.png",
                "What each round of the loop brought.",
            ),
        ]
        return [_written(folder, fig, name, said) for fig, name, said in made if fig is not None]


def draw_contact_sheets(
    folder: Path, shots: Sequence[SheetVideo], refined: RefineSync, model: Model
) -> list[Picture]:
    """Contact sheets over the real frames; the first one shows all videos at the same moments."""
    sync = refined.sync
    reference = sync.ids.index(sync.reference)
    moments = spread(sync.lengths[reference])
    together, sheets = [], []
    with quiet():
        for shot, found in zip(shots, sync.maps, strict=True):
            own = [int(t) for t in spread(len(shot.keypoints.frames))]
            at = frames_of_moments(found, moments)
            wanted = sorted({*own, *(t for t in at if t is not None)})
            cells, where = read_cells(shot, wanted)
            together.append(moment_cells(shot, at, cells, where))
            figure = video_sheet(shot, model, own, cells, where)
            caption = f"{shot.keypoints.id}: detections, monocular and final body."
            sheets.append(_written(folder, figure, f"overlay_{shot.keypoints.id}.jpg", caption))
        figure = contact_sheet(
            together,
            [shot.keypoints.id for shot in shots],
            [f"{sync.reference} frame {shots[reference].keypoints.frames[t]}" for t in moments],
            "The same moments in every video",
            "each column shows the frames that were matched; the skeleton is the final answer's",
        )
        first = _written(
            folder, figure, "moments.jpg", "The same moments of the action in every video."
        )
    return [first, *sheets]


def _written(folder: Path, figure: Figure, name: str, caption: str) -> Picture:
    save(figure, folder / name)
    return Picture(name, caption)


def _joint_errors(answers: Sequence[StageResult], truth: Truth | None) -> Figure | None:
    errors = {a.name: joint_errors_mm(a, truth, EVAL_12) for a in answers}
    known = {name: error for name, error in errors.items() if error is not None}
    return joint_error_figure(EVAL_12, known) if known else None


def _rounds(refined: RefineSync, errors: Sequence[Mapping[str, float]]) -> Figure | None:
    if len(refined.rounds) < 2:
        return None
    known = {
        title: [error[metric] for error in errors]
        for metric, title in ROUND_ERRORS.items()
        if all(metric in error for error in errors)
    }
    costs = [r.cost for r in refined.rounds]
    changes = [r.sync_change_frames for r in refined.rounds]
    return rounds_figure(costs, changes, known, refined.best)
