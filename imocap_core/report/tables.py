"""Rows of numbers to tables that people read, and tables to Markdown, CSV, JSON and HTML."""

from __future__ import annotations

import csv
import html
import io
import json
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from imocap_core.artifacts.schemas import (
    CameraMotion,
    Keypoints,
    RefineSync,
    Table,
    VideoKeypoints,
)
from imocap_core.metrics.scoring import ALL_VIDEOS, SYNC_METRICS, ScoreRow

Cell = str | bool | int | float | None

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
DECIMALS = {"mm": 1, "px": 1, "pct": 2, "deg": 2, "frames": 2, "ms": 1, "s2": 2, "share": 2, "s": 1}
DECIMALS |= {"seconds": 1, "frame": 1, "fps": 2}


def metric_tables(rows: Sequence[ScoreRow], summary: Sequence[ScoreRow]) -> list[Table]:
    """The report's tables: summary, pose, joint sets, sync, cameras, and what was not scored."""
    rows_and_summary = [*(r for r in rows if r.video != ALL_VIDEOS), *summary]
    joint_sets = [r.metric for r in summary if "mpjpe" in r.metric and "hand" not in r.metric]
    made = [
        wide_table("summary", "In short: mean over the videos", summary, SUMMARY, per_video=False),
        wide_table("pose", "Pose, path and image, by video (12 joints)", rows_and_summary, POSE),
        wide_table(
            "joint_sets",
            "Pose on 12, 14 and 17 joints, mean over the videos",
            summary,
            tuple(dict.fromkeys(joint_sets)),
            per_video=False,
        ),
        wide_table("sync", "Synchronisation, by video", rows_and_summary, SYNC_METRICS),
        wide_table(
            "cameras", "Cameras, by video", rows_and_summary, ("camera_rotation_error_deg",)
        ),
        unscored_table(summary),
    ]
    return [table for table in made if table.rows]


def unscored_table(summary: Sequence[ScoreRow]) -> Table:
    """What could not be scored for any video, and why."""
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
    """The loop, round by round; errors: per round, metric -> mean over the videos."""
    metrics = [m for m in ROUND if any(m in error for error in errors)]
    rows: list[list[Cell]] = [
        [i, i == refined.best, r.cost, r.sync_change_frames, *(error.get(m) for m in metrics)]
        for i, (r, error) in enumerate(zip(refined.rounds, errors, strict=True))
    ]
    return Table(
        name="rounds",
        title="The loop, round by round (0: the single pass)",
        columns=["round", "kept", "cost", "moved_frames", *metrics],
        rows=rows,
    )


def video_table(keypoints: Keypoints, camera_motion: CameraMotion, refined: RefineSync) -> Table:
    """What is known of each video: frames, people, camera, matches."""
    sync, solved = refined.sync, refined.motion.cameras
    every = zip(keypoints.videos, camera_motion.videos, solved, sync.maps, strict=True)
    rows: list[list[Cell]] = []
    for seen, camera, result, found in every:
        matched = float(np.isfinite(found.reference_frame).mean())
        rows.append(
            [
                seen.id + (" (reference)" if seen.id == sync.reference else ""),
                len(seen.frames),
                seen.fps,
                f"{seen.size[0]}x{seen.size[1]}",
                seen.tracks_found,
                seen.presence,
                camera.motion,
                camera.residual_px,
                float(camera.K[0, 0]),
                camera.focal_source,
                float(result.K[0, 0]),
                matched,
            ]
        )
    columns = ["video", "frames", "fps", "size", "people", "presence_share", "camera", "camera_px"]
    columns += ["focal_px", "focal", "solved_focal_px", "matched_share"]
    note = " ".join(f"{seen.id}: {said}." for seen in keypoints.videos for said in remarks(seen))
    return Table(name="videos", title="The videos", columns=columns, rows=rows, note=note)


def remarks(seen: VideoKeypoints) -> list[str]:
    """What a video's note says beyond who was followed: cuts, a performer chosen otherwise."""
    parts = seen.note.split("; ")
    return [part for part in parts if part.startswith(("a new shot", "track ", "left and right"))]


def long_table(rows: Sequence[ScoreRow]) -> Table:
    """Every number of every video, one a row: what other programs should read."""
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
    """One line for each result and video, one column a metric; empty columns are left out."""
    cells: dict[tuple[str, str], dict[str, Cell]] = {}
    for row in rows:
        if row.metric in metrics:
            cells.setdefault((row.video, row.result), {})[row.metric] = row.value
    shown = [m for m in metrics if any(line.get(m) is not None for line in cells.values())]
    lines = sorted(cells, key=lambda key: key[0] == ALL_VIDEOS)  # stable: videos keep their order
    heads = ["video", "result"] if per_video else ["result"]
    table: list[list[Cell]] = [
        [*(key if per_video else key[1:]), *(cells[key].get(m) for m in shown)]
        for key in lines
        if any(cells[key].get(m) is not None for m in shown)
    ]
    return Table(name=name, title=title, columns=[*heads, *shown], rows=table)


def shown(column: str, value: Cell) -> str:
    """A cell as people read it: rounded by the unit that ends the column's name."""
    if value is None:
        return "–"
    if isinstance(value, bool):
        return "yes" if value else ""
    if isinstance(value, float):
        return f"{value:.{DECIMALS.get(column.rsplit('_', 1)[-1], 3)}f}"
    return str(value)


def markdown(table: Table) -> str:
    """A GitHub table with its title; numbers to the right."""
    numeric = _numeric(table)
    lines = [
        f"### {table.title}",
        "",
        "| " + " | ".join(f"`{c}`" if "_" in c else c for c in table.columns) + " |",
        "|" + "|".join(" ---: " if n else " --- " for n in numeric) + "|",
    ]
    for row in table.rows:
        texts = [shown(c, v).replace("|", "\\|") for c, v in zip(table.columns, row, strict=True)]
        lines.append("| " + " | ".join(texts) + " |")
    return "\n".join([*lines, "", *([table.note, ""] if table.note else [])])


def html_table(table: Table, words: Mapping[str, str] | None = None) -> str:
    """The same as HTML; a column that `words` explain leads to its place (#name) in the page."""
    numeric = _numeric(table)
    head = "".join(
        f"<th{_right(n)}>{_head(c, words or {})}</th>"
        for c, n in zip(table.columns, numeric, strict=True)
    )
    body = []
    for row in table.rows:
        cells = zip(table.columns, row, numeric, strict=True)
        total = ' class="total"' if ALL_VIDEOS in row else ""
        inside = "".join(f"<td{_right(n)}>{html.escape(shown(c, v))}</td>" for c, v, n in cells)
        body.append(f"<tr{total}>{inside}</tr>")
    note = f"<p>{html.escape(table.note)}</p>" if table.note else ""
    return (
        f"<h3>{html.escape(table.title)}</h3>\n"
        f"<table><thead><tr>{head}</tr></thead>\n<tbody>{''.join(body)}</tbody></table>{note}\n"
    )


def csv_text(table: Table) -> str:
    """Comma-separated, full precision; an empty cell was not scored."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(table.columns)
    writer.writerows([["" if v is None else v for v in row] for row in table.rows])
    return out.getvalue()


def json_text(tables: Sequence[Table]) -> str:
    """All tables, each as a list of records; null was not scored."""
    content = {t.name: [dict(zip(t.columns, row, strict=True)) for row in t.rows] for t in tables}
    return json.dumps(content, indent=1, ensure_ascii=False) + "\n"


def _numeric(table: Table) -> list[bool]:
    """Which columns hold numbers."""
    columns = zip(*table.rows, strict=True) if table.rows else [()] * len(table.columns)
    return [
        any(isinstance(v, int | float) and not isinstance(v, bool) for v in column)
        for column in columns
    ]


def _head(column: str, words: Mapping[str, str]) -> str:
    name = html.escape(column).replace("_", "_<wbr>")
    if column not in words:
        return name
    return f'<a href="#{column}" title="{html.escape(words[column])}">{name}</a>'


def _right(numeric: bool) -> str:
    return ' class="n"' if numeric else ""
