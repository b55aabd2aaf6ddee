"""Scores and artifacts to the report's tables."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from imocap_core.artifacts.schemas import (
    CameraMotion,
    Keypoints,
    RefineSync,
    Table,
)
from imocap_core.artifacts.schemas.evaluate import Cell
from imocap_core.evaluate.camera_scores import CAMERA_METRICS
from imocap_core.metrics.body_scoring import BODY_METRICS
from imocap_core.metrics.scoring import ALL_VIDEOS, SYNC_METRICS, ScoreRow
from imocap_core.verdict.detections import remarks

SUMMARY = (
    "mpjpe_mm",
    "mpjpe_scaled_mm",
    "pa_mpjpe_mm",
    "acceleration_error_m_s2",
    "root_path_error_mm",
    "camera_rotation_error_deg",
    "sync_error_pct",
    "sync_error_frames",
    "matched_share",
    "cycle_residual_frames",
    "reprojection_px",
    "mpjpe_24_mm",
    "sync_error_ms",
    *BODY_METRICS,
)
POSE = (
    "mpjpe_mm",
    "mpjpe_scaled_mm",
    "pa_mpjpe_mm",
    "acceleration_error_m_s2",
    "root_path_error_mm",
    "root_path_aligned_error_mm",
    "foot_sliding_mm_s",
    "planted_foot_speed_mm_s",
    "reprojection_px",
    "reprojection_pct",
)
ROUND = (
    "mpjpe_mm",
    "mpjpe_scaled_mm",
    "pa_mpjpe_mm",
    "camera_rotation_error_deg",
    "sync_error_pct",
    "sync_error_frames",
    "matched_share",
)


def metric_tables(rows: Sequence[ScoreRow], summary: Sequence[ScoreRow]) -> list[Table]:
    """Summary, pose, joint sets, synchronisation, cameras, and metrics that are not scored."""
    rows_and_summary = [*(r for r in rows if r.video != ALL_VIDEOS), *summary]
    joint_sets = [r.metric for r in summary if "mpjpe" in r.metric and "hand" not in r.metric]
    tables = [
        wide_table("summary", "Mean over the videos", summary, SUMMARY, per_video=False),
        wide_table("pose", "Pose, path and image, by video (12 joints)", rows_and_summary, POSE),
        wide_table(
            "joint_sets",
            "Pose on 12, 14, 17 and 24 joints, mean over the videos",
            summary,
            tuple(dict.fromkeys(joint_sets)),
            per_video=False,
        ),
        wide_table(
            "whole_body",
            "Whole body and world metrics, mean over the videos",
            summary,
            BODY_METRICS,
            per_video=False,
        ),
        wide_table("sync", "Synchronisation, by video", rows_and_summary, SYNC_METRICS),
        wide_table("cameras", "Cameras, by video", rows_and_summary, CAMERA_METRICS),
        unscored_table(summary),
    ]
    return [table for table in tables if table.rows]


def unscored_table(summary: Sequence[ScoreRow]) -> Table:
    """Metrics that could not be scored for any video, and the reasons."""
    why: dict[str, str] = {}
    for row in summary:
        if row.value is None:
            why.setdefault(row.metric, row.note)
    return Table(
        name="unscored",
        title="Not scored, and why",
        columns=["metric", "reason"],
        rows=[[metric, reason] for metric, reason in why.items()],
    )


def round_table(refined: RefineSync, errors: Sequence[Mapping[str, float]]) -> Table:
    """The rounds of the loop; errors: per round, metric -> mean over the videos."""
    metrics = [m for m in ROUND if any(m in error for error in errors)]
    rows: list[list[Cell]] = [
        [i, i == refined.best, r.cost, r.sync_change_frames, *(error.get(m) for m in metrics)]
        for i, (r, error) in enumerate(zip(refined.rounds, errors, strict=True))
    ]
    return Table(
        name="rounds",
        title="The loop, round by round (0: the single pass)",
        columns=["round", "result", "cost", "moved_frames", *metrics],
        rows=rows,
        note=f"The alternation {refined.status}.",
    )


def video_table(keypoints: Keypoints, camera_motion: CameraMotion, refined: RefineSync) -> Table:
    """Properties of each video: frames, people, camera, matches."""
    sync, solved = refined.sync, refined.motion.cameras
    every = zip(keypoints.videos, camera_motion.videos, solved, sync.maps, strict=True)
    rows: list[list[Cell]] = []
    for video, camera, result, sync_map in every:
        matched = float(np.isfinite(sync_map.reference_frame).mean())
        rows.append(
            [
                video.id + (" (reference)" if video.id == sync.reference else ""),
                len(video.frames),
                video.fps,
                f"{video.size[0]}x{video.size[1]}",
                video.tracks_found,
                video.presence,
                camera.motion,
                camera.residual_px,
                float(camera.K[0, 0]),
                camera.focal_source,
                None if camera.lens is None else float(camera.lens.coefficients[0]),
                float(result.K[0, 0]),
                matched,
            ]
        )
    columns = ["video", "frames", "fps", "size", "people", "presence_share", "camera", "camera_px"]
    columns += ["focal_px", "focal", "lens_k1", "solved_focal_px", "matched_share"]
    if all(camera.lens is None for camera in camera_motion.videos):
        rows = [[*row[:10], *row[11:]] for row in rows]
        columns.remove("lens_k1")
    note = " ".join(f"{v.id}: {remark}." for v in keypoints.videos for remark in remarks(v))
    return Table(name="videos", title="The videos", columns=columns, rows=rows, note=note)


def long_table(rows: Sequence[ScoreRow]) -> Table:
    """Every metric of every video in a separate row, for other programs."""
    return Table(
        name="metrics",
        title="Every metric",
        columns=["result", "video", "metric", "value", "note"],
        rows=[[r.result, r.video, r.metric, r.value, r.note] for r in rows],
    )


def wide_table(
    name: str,
    title: str,
    rows: Iterable[ScoreRow],
    metrics: Sequence[str],
    *,
    per_video: bool = True,
) -> Table:
    """One row per result and video, one column per metric; empty columns are omitted."""
    cells: dict[tuple[str, str], dict[str, Cell]] = {}
    for row in rows:
        if row.metric in metrics:
            cells.setdefault((row.video, row.result), {})[row.metric] = row.value
    shown = [m for m in metrics if any(line.get(m) is not None for line in cells.values())]
    lines = sorted(cells, key=lambda key: key[0] == ALL_VIDEOS)  # stable: videos keep their order
    first = ["video", "result"] if per_video else ["result"]
    table: list[list[Cell]] = [
        [*(key if per_video else key[1:]), *(cells[key].get(m) for m in shown)]
        for key in lines
        if any(cells[key].get(m) is not None for m in shown)
    ]
    return Table(name=name, title=title, columns=[*first, *shown], rows=table)
