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
from imocap_core.camera.gravity import BodyMotion, Extrinsics, sole_depths_mm, to_world
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.diagnostics.detection_findings import remarks
from imocap_core.evaluate.action_scores import METRICS, ActionScores
from imocap_core.evaluate.scoreboard import CAMERA_METRICS
from imocap_core.metrics.scoring import ALL_VIDEOS, BODY_METRICS, SYNC_METRICS, ScoreRow
from imocap_core.report.table_files import METRICS_OF, Row, table_of


def metric_tables(rows: Sequence[ScoreRow], summary: Sequence[ScoreRow]) -> list[Table]:
    """Summary, pose, joint sets, synchronisation, cameras, and metrics that are not scored."""
    rows_and_summary = [*(r for r in rows if r.video != ALL_VIDEOS), *summary]
    joint_sets = [r.metric for r in summary if "mpjpe" in r.metric and "hand" not in r.metric]
    headline = (*METRICS_OF["summary"], *BODY_METRICS)
    why: dict[str, str] = {}
    for row in summary:
        if row.value is None:
            why.setdefault(row.metric, row.note)
    tables = [
        _wide_table("summary", summary, headline, per_video=False),
        _wide_table("pose", rows_and_summary, METRICS_OF["pose"]),
        _wide_table("joint_sets", summary, tuple(dict.fromkeys(joint_sets)), per_video=False),
        _wide_table("whole_body", summary, BODY_METRICS, per_video=False),
        _wide_table("sync", rows_and_summary, SYNC_METRICS),
        _wide_table("cameras", rows_and_summary, CAMERA_METRICS),
        table_of("unscored", [{"metric": m, "reason": reason} for m, reason in why.items()]),
    ]
    return [table for table in tables if table.rows]


def round_table(refined: RefineSync, errors: Sequence[Mapping[str, float]]) -> Table:
    """The rounds of the loop; errors: per round, metric -> mean over the videos."""
    metrics = [m for m in METRICS_OF["rounds"] if any(m in error for error in errors)]
    rows: list[Row] = [
        {
            "round": i,
            "result": i == refined.best,
            "cost": r.cost,
            "moved_frames": r.sync_change_frames,
            **{metric: error.get(metric) for metric in metrics},
        }
        for i, (r, error) in enumerate(zip(refined.rounds, errors, strict=True))
    ]
    return table_of("rounds", rows, f"The alternation {refined.status}.")


def video_table(keypoints: Keypoints, camera_motion: CameraMotion, refined: RefineSync) -> Table:
    """Properties of each video: frames, people, camera, matches."""
    sync, solved = refined.sync, refined.motion.cameras
    every = zip(keypoints.videos, camera_motion.videos, solved, sync.maps, strict=True)
    bent = any(camera.lens is not None for camera in camera_motion.videos)
    rows: list[Row] = []
    for video, camera, result, sync_map in every:
        k1 = None if camera.lens is None else float(camera.lens.coefficients[0])
        rows.append(
            {
                "video": video.id + (" (reference)" if video.id == sync.reference else ""),
                "frames": len(video.frames),
                "fps": video.fps,
                "size": f"{video.size[0]}x{video.size[1]}",
                "people": video.tracks_found,
                "presence_share": video.presence,
                "camera": camera.motion,
                "camera_px": camera.residual_px,
                "focal_px": float(camera.K[0, 0]),
                "focal": camera.focal_source,
                **({"lens_k1": k1} if bent else {}),
                "solved_focal_px": float(result.K[0, 0]),
                "matched_share": float(np.isfinite(sync_map.reference_frame).mean()),
            }
        )
    note = " ".join(f"{v.id}: {remark}." for v in keypoints.videos for remark in remarks(v))
    return table_of("videos", rows, note)


def long_table(rows: Sequence[ScoreRow]) -> Table:
    """Every metric of every video in a separate row, for other programs."""
    columns = ("result", "video", "metric", "value", "note")
    return table_of("metrics", [{name: getattr(row, name) for name in columns} for row in rows])


def _wide_table(
    name: str, rows: Iterable[ScoreRow], metrics: Sequence[str], *, per_video: bool = True
) -> Table:
    """One row per result and video, one column per metric; empty columns are omitted."""
    cells: dict[tuple[str, str], Row] = {}
    for row in rows:
        if row.metric in metrics:
            cells.setdefault((row.video, row.result), {})[row.metric] = row.value
    shown = [m for m in metrics if any(line.get(m) is not None for line in cells.values())]
    lines = sorted(cells, key=lambda key: key[0] == ALL_VIDEOS)  # stable: videos keep their order
    return table_of(
        name,
        [
            {
                **({"video": video} if per_video else {}),
                "result": result,
                **{m: cells[video, result].get(m) for m in shown},
            }
            for video, result in lines
            if any(cells[video, result].get(m) is not None for m in shown)
        ],
    )


def joint_tables(scores: ActionScores) -> list[Table]:
    """One row a joint, one column a result; tables without values are omitted."""
    tables = []
    for name, errors, unit in (
        ("joints", scores.joint_errors_mm, "mm"),
        ("joint_rotations", scores.joint_errors_deg, "deg"),
    ):
        joints = [joint for joint in SMPL_JOINTS if any(joint in of for of in errors.values())]
        rows: list[Row] = [
            {"joint": joint}
            | {f"{r.replace(' ', '_')}_{unit}": of.get(joint) for r, of in errors.items()}
            for joint in joints
        ]
        tables += [table_of(name, rows)] if rows else []
    return tables


def hand_tables(rows: Sequence[ScoreRow]) -> list[Table]:
    """One table, or none without hands."""
    of_hands = [row for row in rows if row.metric in METRICS]
    return [_wide_table("hands", of_hands, METRICS)] if of_hands else []


def event_tables(refined: RefineSync) -> list[Table]:
    """One table, or none where the videos do not show one event."""
    if refined.event is None:
        return []
    focal_px = {camera.id: float(camera.K[0, 0]) for camera in refined.motion.cameras}
    rows: list[Row] = [
        {
            "video": camera.id,
            "solved_focal_px": focal_px[camera.id],
            "focal_sd_pct": 100 * camera.focal_sd,
            "distortion": camera.distortion,
            "rotation_sd_deg": camera.rotation_sd_deg,
            "offset_frames": camera.offset_frames,
            "offset_sd_ms": 1000 * camera.offset_sd_s,
            "rate": camera.rate,
            "median_px": camera.median_px,
        }
        for camera in refined.event.cameras
    ]
    return [table_of("event", rows)]


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
    rows: list[Row] = []
    for video, camera, turned, plane in every:
        roll, down = held_deg(ground.up, camera, turned)
        body = to_world(
            BodyMotion(video.theta, video.trans, video.joints), Extrinsics(camera.R, camera.t)
        )
        cosine = np.nan if plane is None else float(np.clip(plane.up @ camera.R @ ground.up, -1, 1))
        rows.append(
            {
                "video": video.id,
                "pitch_down_deg": down,
                "roll_deg": roll,
                "camera_height_m": float(ground.height_m(-camera.R.T @ camera.t)),
                "sole_depth_mm": float(np.quantile(sole_depths_mm(body.joints, ground), _DEEP)),
                "up_alone_deg": None if plane is None else float(np.degrees(np.arccos(cosine))),
                "up_alone_sd_deg": None if plane is None else plane.tilt_sd_deg,
            }
        )
    note = (
        f"Up has a standard deviation of {ground.tilt_sd_deg:.1f} degrees, the ground's height one "
        f"of {ground.height_sd_mm:.0f} mm."
    )
    return [table_of("ground", rows, note)]


def second_look_tables(again: Redetect) -> list[Table]:
    """One table, or none where no picture was looked at again."""
    rows: list[Row] = [
        {
            "video": video.id,
            "pictures_again": len(video.looked_at),
            "contradicted": video.contradicted,
            "moved_joints": int((video.confidence > 0).sum()),
        }
        for video in again.videos
    ]
    return [table_of("second_look", rows)] if rows else []
