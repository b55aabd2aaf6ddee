"""Tables as the page shows them: fewer columns and rows than the files for programs have."""

from __future__ import annotations

from imocap_core.artifacts.schemas import Table
from imocap_core.artifacts.schemas.evaluate import Cell
from imocap_core.evaluate.results import AFTER_LOOP, MONOCULAR, SINGLE_PASS
from imocap_core.metrics.scoring import ALL_VIDEOS
from imocap_core.report.column_titles import column_title

HEADLINE = (
    "result",
    "mpjpe_mm",
    "mpjpe_24_mm",
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
"""Columns of the summary that the page shows; its CSV file has all."""


def headline(table: Table) -> Table:
    """The columns of the summary that the page shows; other tables as they are."""
    if table.name != "summary":
        return table
    shown = [table.columns.index(name) for name in HEADLINE if name in table.columns]
    return _with_columns(table, shown)


def without_empty_columns(table: Table) -> Table:
    """Without columns in which no row has a value."""
    shown = [k for k in range(len(table.columns)) if any(row[k] is not None for row in table.rows)]
    return _with_columns(table, shown)


def _with_columns(table: Table, shown: list[int]) -> Table:
    return table.model_copy(
        update={
            "columns": [table.columns[k] for k in shown],
            "rows": [[row[k] for k in shown] for row in table.rows],
        }
    )


def grouped_reasons(table: Table) -> Table:
    """Metrics that are not scored, one row a reason; other tables as they are."""
    if table.name != "unscored":
        return table
    metrics: dict[str, list[str]] = {}
    for metric, reason in table.rows:
        metrics.setdefault(str(reason), []).append(column_title(str(metric)))
    rows = [[reason, "; ".join(names)] for reason, names in metrics.items()]
    return table.model_copy(update={"columns": ["reason", "metrics"], "rows": rows})


def of_single_video(table: Table) -> Table:
    """Without what compares the single video with itself: rows of the stages before the last and
    means over all videos, its role as the reference, its share of matches."""
    repeated = {MONOCULAR, SINGLE_PASS}
    if any(ALL_VIDEOS not in row for row in table.rows):
        repeated.add(ALL_VIDEOS)
    columns = [k for k, name in enumerate(table.columns) if name != "matched_share"]
    rows = [
        [_of_single(row[k]) for k in columns]
        for row in table.rows
        if not any(cell in repeated for cell in row if isinstance(cell, str))
    ]
    return table.model_copy(update={"columns": [table.columns[k] for k in columns], "rows": rows})


def _of_single(cell: Cell) -> Cell:
    if not isinstance(cell, str):
        return cell
    return "result" if cell == AFTER_LOOP else cell.removesuffix(" (reference)")
