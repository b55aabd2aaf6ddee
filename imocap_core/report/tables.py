"""Scores and artifacts to the report's tables."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from imocap_core.adapters.ground import ground_of, held_deg
from imocap_core.artifacts.schemas import (
    CameraMotion,
    GroundPlane,
    InitialSmpl,
    Keypoints,
    Redetect,
    RefineSync,
    Table,
)
from imocap_core.artifacts.schemas.motion_schemas import Cell
from imocap_core.camera.gravity import BodyMotion, Extrinsics, sole_depths_mm, to_world
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.diagnostics.detection_findings import remarks
from imocap_core.evaluate.action_scores import METRICS, ActionScores
from imocap_core.evaluate.scoreboard import CAMERA_METRICS
from imocap_core.metrics.scoring import ALL_VIDEOS, BODY_METRICS, SYNC_METRICS, ScoreRow
from imocap_core.report.table_files import METRICS_OF


def metric_tables(rows: Sequence[ScoreRow], summary: Sequence[ScoreRow]) -> list[Table]:
    """Summary, pose, joint sets, synchronisation, cameras, and metrics that are not scored."""
    rows_and_summary = [*(r for r in rows if r.video != ALL_VIDEOS), *summary]
    joint_sets = [r.metric for r in summary if "mpjpe" in r.metric and "hand" not in r.metric]
    headline = (*METRICS_OF["summary"], *BODY_METRICS)
    pose = METRICS_OF["pose"]
    tables = [
        wide_table("summary", "Mean over the videos", summary, headline, per_video=False),
        wide_table("pose", "Pose, path and image, by video (12 joints)", rows_and_summary, pose),
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
    metrics = [m for m in METRICS_OF["rounds"] if any(m in error for error in errors)]
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


def joint_tables(scores: ActionScores) -> list[Table]:
    """One row a joint, one column a result; tables without values are omitted."""
    tables = []
    for name, title, errors, unit in (
        (
            "joints",
            "Error of each joint after alignment on the twelve joints (joint_error_aligned_12_mm)",
            scores.joint_errors_mm,
            "mm",
        ),
        (
            "joint_rotations",
            "Error of the rotation of each joint relative to its parent",
            scores.joint_errors_deg,
            "deg",
        ),
    ):
        columns = ["joint", *(f"{result.replace(' ', '_')}_{unit}" for result in errors)]
        joints = [joint for joint in SMPL_JOINTS if any(joint in of for of in errors.values())]
        rows: list[list[Cell]] = [[j, *(of.get(j) for of in errors.values())] for j in joints]
        if rows:
            tables.append(Table(name=name, title=title, columns=columns, rows=rows))
    return tables


def hand_tables(rows: Sequence[ScoreRow]) -> list[Table]:
    """One table, or none without hands."""
    of_hands = [row for row in rows if row.metric in METRICS]
    return [wide_table("hands", "Hands, by video", of_hands, METRICS)] if of_hands else []


def event_tables(refined: RefineSync) -> list[Table]:
    """One table, or none where the videos do not show one event."""
    if refined.event is None:
        return []
    focal_px = {camera.id: float(camera.K[0, 0]) for camera in refined.motion.cameras}
    return [
        Table(
            name="event",
            title="Cameras calibrated from the event",
            columns=["video", "solved_focal_px", "focal_sd_pct", "distortion", "rotation_sd_deg",
                     "offset_frames", "offset_sd_ms", "rate", "median_px"],
            rows=[
                [
                    camera.id,
                    focal_px[camera.id],
                    100 * camera.focal_sd,
                    camera.distortion,
                    camera.rotation_sd_deg,
                    camera.offset_frames,
                    1000 * camera.offset_sd_s,
                    camera.rate,
                    camera.median_px,
                ]
                for camera in refined.event.cameras
            ],
            note="Rotations are about the reference camera's. The offset is this video's frame, "
            "among its used ones, at the reference's first; the rate its frames a frame of the "
            "reference; the error the median reprojection error of the keypoints, without the "
            "detector's constant errors.",
        )
    ]  # fmt: skip


_DEEP = 0.95  # quantile of the frames


def ground_tables(
    initial: InitialSmpl, camera_motion: CameraMotion, refined: RefineSync
) -> list[Table]:
    """One table, or none where the result has no ground."""
    motion = refined.motion
    if motion.ground is None:
        return []
    ground = ground_of(motion.ground)
    alone: list[GroundPlane | None] = [*initial.grounds] or [None] * len(motion.videos)
    every = zip(motion.videos, motion.cameras, camera_motion.videos, alone, strict=True)
    rows: list[list[Cell]] = []
    for video, camera, turned, plane in every:
        roll, down = held_deg(ground.up, camera, turned)
        body = to_world(
            BodyMotion(video.theta, video.trans, video.joints), Extrinsics(camera.R, camera.t)
        )
        cosine = np.nan if plane is None else float(np.clip(plane.up @ camera.R @ ground.up, -1, 1))
        rows.append(
            [
                video.id,
                down,
                roll,
                float(ground.height_m(-camera.R.T @ camera.t)),
                float(np.quantile(sole_depths_mm(body.joints, ground), _DEEP)),
                None if plane is None else float(np.degrees(np.arccos(cosine))),
                None if plane is None else plane.tilt_sd_deg,
            ]
        )
    return [
        Table(
            name="ground",
            title="The ground and the cameras above it",
            columns=["video", "pitch_down_deg", "roll_deg", "camera_height_m", "sole_depth_mm",
                     "up_alone_deg", "up_alone_sd_deg"],
            rows=rows,
            note=f"Up has a standard deviation of {ground.tilt_sd_deg:.1f} degrees, the ground's "
            f"height one of {ground.height_sd_mm:.0f} mm.",
        )
    ]  # fmt: skip


def second_look_tables(again: Redetect) -> list[Table]:
    """One table, or none where no picture was looked at again."""
    rows: list[list[Cell]] = [
        [video.id, len(video.looked_at), video.contradicted, int((video.confidence > 0).sum())]
        for video in again.videos
    ]
    if not rows:
        return []
    return [
        Table(
            name="second_look",
            title="Pictures that were looked at again",
            columns=["video", "pictures_again", "contradicted", "moved_joints"],
            rows=rows,
            note="Limb joints that the detector doubted and the other videos have elsewhere. One "
            "moves where the picture shows a joint near the expected place; the others stay, as "
            "performances may differ.",
        )
    ]
