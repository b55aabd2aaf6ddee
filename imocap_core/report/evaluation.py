"""All tables and figures of the stage evaluate, in the order of the report."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from imocap_core.artifacts.schemas import (
    Camera,
    CameraMotion,
    InitialSmpl,
    Keypoints,
    Redetect,
    RefineSync,
    Sync,
    SyncMap,
    Table,
    Uncertainty,
)
from imocap_core.body import Model
from imocap_core.camera.gravity import GroundAlignment
from imocap_core.conventions import EVAL_12
from imocap_core.evaluate.action_scores import ActionScores
from imocap_core.evaluate.scoreboard import StageResult, joint_errors_mm
from imocap_core.figures.overlays import Image, contact_sheet
from imocap_core.figures.result_figures import joint_error_figure, scene_figure
from imocap_core.figures.sheets import (
    CAPTION,
    SheetVideo,
    body_sheet,
    detected_cells,
    frames_of_moments,
    moment_cells,
    read_cells,
    sheet_ids,
    spread,
    upright_world,
    video_sheet,
)
from imocap_core.figures.style import quiet, save
from imocap_core.figures.sync_figures import affinity_figure, rounds_figure, warp_figure
from imocap_core.io.truth import Truth
from imocap_core.metrics.scoring import ALL_VIDEOS
from imocap_core.report import tables
from imocap_core.report.table_files import Picture
from imocap_core.report.uncertainty_tables import (
    leave_one_out_tables,
    observability_table,
    trust_tables,
    uncertainty_tables,
)
from imocap_core.workers import thread_map


def evaluation_tables(
    scores: ActionScores,
    keypoints: Keypoints,
    camera_motion: CameraMotion,
    initial: InitialSmpl,
    refined: RefineSync,
    claimed: Uncertainty,
    again: Redetect,
    truth: Truth | None,
) -> list[Table]:
    """The tables that the report shows."""
    every = [*scores.rows, *scores.summary]
    return [
        *tables.metric_tables(scores.rows, scores.summary),
        *tables.joint_tables(scores),
        *tables.hand_tables(every),
        *([tables.round_table(refined, scores.rounds)] if len(refined.rounds) > 1 else []),
        *tables.second_look_tables(again),
        tables.video_table(keypoints, camera_motion, refined),
        *tables.ground_tables(initial, camera_motion, refined),
        *tables.event_tables(refined),
        *trust_tables(refined.sync),
        observability_table(claimed, refined.sync),
        *leave_one_out_tables(claimed),
        *uncertainty_tables(claimed, refined.motion.videos, truth, every),
    ]


def all_scores_table(scores: ActionScores) -> Table:
    """The long table of every metric, for programs only."""
    per_video = [row for row in scores.rows if row.video != ALL_VIDEOS]
    return tables.long_table([*per_video, *scores.summary])


_ROUND_ERRORS = {"sync_error_pct": "sync error (%)", "pa_mpjpe_mm": "P-MPJPE (mm)"}


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


_VideoSheets = tuple[list[Image], list[tuple[Figure, str, str]]]  # figure, file, caption


def draw_contact_sheets(
    folder: Path, videos: Sequence[SheetVideo], refined: RefineSync, model: Model
) -> list[Picture]:
    """Contact sheets over the videos' frames, and body sheets of two of the videos.

    The first contact sheet shows all videos at the same moments. The videos are drawn at once.
    """
    sync = refined.sync
    of_bodies, ground = sheet_ids(refined, videos), upright_world(refined)
    reference = videos[sync.ids.index(sync.reference)].keypoints
    moments = spread(len(reference.frames))

    def drawn(item: tuple[SheetVideo, SyncMap, Camera]) -> _VideoSheets:
        video, sync_map, camera = item
        shown = video.keypoints.id in of_bodies
        of_moments = frames_of_moments(sync_map, moments)
        return _video_sheets(video, of_moments, model, (camera, ground) if shown else None)

    with quiet():
        items = list(zip(videos, sync.maps, refined.motion.cameras, strict=True))
        of_videos: list[_VideoSheets] = thread_map(drawn, items)
        sheets = [_written(folder, *sheet) for _, sheets_of in of_videos for sheet in sheets_of]
        figure = contact_sheet(
            [cells_of for cells_of, _ in of_videos],
            [video.keypoints.id for video in videos],
            [f"{sync.reference} frame {reference.frames[t]}" for t in moments],
        )
        caption = "Matched frames with the recovered skeleton: orange the left, blue the right."
        if len(videos) == 1:
            caption = "Moments of the video, with the recovered skeleton."
        first = _written(folder, figure, "moments.webp", caption)
    return [first, *sheets]


def _video_sheets(
    video: SheetVideo,
    moments: Sequence[int | None],
    model: Model,
    of_body: tuple[Camera, GroundAlignment] | None,
) -> _VideoSheets:
    """The pictures at the moments of the action, and the sheets of one video.

    of_body: the video's camera and the ground, where its body gets a sheet.
    """
    name = video.keypoints.id
    frames = [int(t) for t in spread(len(video.keypoints.frames))]
    cells, cuts = read_cells(
        video.keypoints, video.file, sorted({*frames, *(t for t in moments if t is not None)})
    )
    figure = video_sheet(video, model, frames, cells, cuts)
    caption = f"{name}: detections, monocular and final body, over the frame and from the side."
    sheets = [(figure, f"overlay_{name}.webp", caption)]
    if of_body is not None:
        pictures = cells
        if video.file is None:
            pictures = detected_cells(video.keypoints, video.layout_names, frames, cells, cuts)
        figure = body_sheet(video, *of_body, model, frames, pictures)
        sheets.append((figure, f"body_{name}.webp", CAPTION.format(video=name)))
    return moment_cells(video, moments, cells, cuts), sheets


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
        for metric, title in _ROUND_ERRORS.items()
        if all(metric in error for error in errors)
    }
    costs = [r.cost for r in refined.rounds]
    changes = [r.sync_change_frames for r in refined.rounds]
    return rounds_figure(costs, changes, scored, refined.best)
