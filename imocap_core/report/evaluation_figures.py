"""Figures of the stage evaluate, written to the report's folder."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from imocap_core.artifacts.schemas import RefineSync, Sync
from imocap_core.body import Model
from imocap_core.conventions import EVAL_12
from imocap_core.evaluate.results import StageResult
from imocap_core.evaluate.scoreboard import joint_errors_mm
from imocap_core.figures.body_sheet import CAPTION, body_sheet, sheet_ids, upright_world
from imocap_core.figures.contact_sheets import (
    SheetVideo,
    detected_cells,
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

ROUND_ERRORS = {"sync_error_pct": "sync error (%)", "pa_mpjpe_mm": "P-MPJPE (mm)"}


def draw_plots(
    folder: Path,
    sync: Sync,
    refined: RefineSync,
    results: Sequence[StageResult],
    truth: Truth | None,
    true_positions: Mapping[str, Float[np.ndarray, " _"]],
    round_errors: Sequence[Mapping[str, float]],
) -> list[Picture]:
    """Plots: errors, synchronisation, cameras and paths, the rounds of the loop.

    Args:
        sync, refined: the first synchronisation, and the loop's result.
        true_positions: video id -> (T,) index into the reference. round_errors: per round, metric
            -> mean over the videos; empty without truth.
    """
    motion = refined.motion
    with quiet():
        figures = [
            (_joint_errors(results, truth), "joint_errors.png", "Error of each joint."),
            (
                warp_figure(sync, refined.sync, true_positions),
                "warp.png",
                "Position of each frame of each video in the reference video.",
            ),
            (
                affinity_figure(refined.sync, true_positions),
                "affinity.png",
                "Affinity of the poses before and after cycle consistency, with the matched path.",
            ),
            (
                scene_figure(motion.videos, motion.cameras, motion.reference),
                "scene.png",
                "Recovered cameras and the path of the root in each video.",
            ),
            (_rounds(refined, round_errors), "rounds.png", "Cost and errors of each round."),
        ]
        return [
            _written(folder, figure, name, caption)
            for figure, name, caption in figures
            if figure is not None
        ]


def draw_contact_sheets(
    folder: Path, videos: Sequence[SheetVideo], refined: RefineSync, model: Model
) -> list[Picture]:
    """Contact sheets over the videos' frames, and body sheets of two of the videos.

    The first contact sheet shows all videos at the same moments.
    """
    sync = refined.sync
    of_bodies, ground = sheet_ids(refined, videos), upright_world(refined)
    reference = videos[sync.ids.index(sync.reference)].keypoints
    moments = spread(len(reference.frames))
    together, sheets = [], []
    with quiet():
        for video, sync_map, camera in zip(videos, sync.maps, refined.motion.cameras, strict=True):
            name = video.keypoints.id
            of_video = [int(t) for t in spread(len(video.keypoints.frames))]
            of_moments = frames_of_moments(sync_map, moments)
            needed = sorted({*of_video, *(t for t in of_moments if t is not None)})
            cells, cuts = read_cells(video, needed)
            together.append(moment_cells(video, of_moments, cells, cuts))
            figure = video_sheet(video, model, of_video, cells, cuts)
            caption = f"{name}: detections, monocular and final body."
            sheets.append(_written(folder, figure, f"overlay_{name}.jpg", caption))
            if name in of_bodies:
                pictures = cells
                if video.file is None:
                    pictures = detected_cells(video, of_video, cells, cuts)
                figure = body_sheet(video, camera, ground, model, of_video, pictures)
                caption = CAPTION.format(video=name)
                sheets.append(_written(folder, figure, f"body_{name}.jpg", caption))
        figure = contact_sheet(
            together,
            [video.keypoints.id for video in videos],
            [f"{sync.reference} frame {reference.frames[t]}" for t in moments],
            "The same moments in every video",
            "each column shows matched frames with the skeleton of the final result",
        )
        caption = "The same moments of the action in every video."
        if len(videos) == 1:
            caption = "Moments of the video, with the recovered skeleton."
        first = _written(folder, figure, "moments.jpg", caption)
    return [first, *sheets]


def _written(folder: Path, figure: Figure, name: str, caption: str) -> Picture:
    save(figure, folder / name)
    return Picture(name, caption)


def _joint_errors(results: Sequence[StageResult], truth: Truth | None) -> Figure | None:
    errors = {result.name: joint_errors_mm(result, truth, EVAL_12) for result in results}
    scored = {name: error for name, error in errors.items() if error is not None}
    return joint_error_figure(EVAL_12, scored) if scored else None


def _rounds(refined: RefineSync, errors: Sequence[Mapping[str, float]]) -> Figure | None:
    if len(refined.rounds) < 2:
        return None
    scored = {
        title: [error[metric] for error in errors]
        for metric, title in ROUND_ERRORS.items()
        if all(metric in error for error in errors)
    }
    costs = [r.cost for r in refined.rounds]
    changes = [r.sync_change_frames for r in refined.rounds]
    return rounds_figure(costs, changes, scored, refined.best)
