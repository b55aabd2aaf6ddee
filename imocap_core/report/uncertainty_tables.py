"""Claimed standard deviations against true errors, as tables of the report."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from imocap_core.artifacts.schemas import Table, Uncertainty, VideoMotion
from imocap_core.artifacts.schemas.evaluate import Cell
from imocap_core.conventions import EVAL_12, EVAL_INDICES, SMPL_JOINTS
from imocap_core.evaluate.calibration import METRICS, NORMALISED_CAMERA_ERROR, joint_errors_mm
from imocap_core.io.truth import Truth
from imocap_core.metrics.calibration import normalised_errors
from imocap_core.metrics.scoring import ALL_VIDEOS, ScoreRow


def uncertainty_tables(
    claimed: Uncertainty,
    motions: Sequence[VideoMotion],
    truth: Truth | None,
    rows: Sequence[ScoreRow],
) -> list[Table]:
    """Tables with one row per video, per joint, and per further viewpoint."""
    tables = [_by_video(claimed, rows), _by_joint(claimed, motions, truth)]
    if claimed.viewpoints:
        cells: list[list[Cell]] = [[v.azimuth_deg, v.reduction] for v in claimed.viewpoints]
        tables.append(
            Table(
                name="viewpoints",
                title="One more camera: reduction of the common motion's variance",
                columns=["azimuth_deg", "reduction_share"],
                rows=cells,
            )
        )
    return tables


def leave_one_out_tables(claimed: Uncertainty) -> list[Table]:
    """How well each video is predicted without it; no table of a single video."""
    if not claimed.leave_one_out:
        return []
    cells: list[list[Cell]] = [
        [
            v.id,
            _finite(100 * v.error_share),
            _finite(v.near_share),
            _finite(100 * v.monocular_error_share),
            v.frames,
        ]
        for v in claimed.leave_one_out
    ]
    return [
        Table(
            name="leave_one_out",
            title="Each video predicted by the others (needs no truth)",
            columns=[
                "video",
                "error_pct_height",
                "share_10",
                "monocular_error_pct_height",
                "frames",
            ],
            rows=cells,
        )
    ]


def _by_video(claimed: Uncertainty, rows: Sequence[ScoreRow]) -> Table:
    value = {(r.video, r.metric): r.value for r in rows}
    cells: list[list[Cell]] = [
        [
            v.id,
            v.azimuth_deg if np.isfinite(v.azimuth_deg) else None,
            *(_rms(x[:, EVAL_INDICES]) for x in (v.sigma_mm, v.depth_mm, v.across_mm)),
            *(value.get((v.id, metric)) for metric in METRICS),
            _finite(v.camera_rotation_deg),
            value.get((v.id, NORMALISED_CAMERA_ERROR)),
        ]
        for v in claimed.videos
    ]
    means = [value.get((ALL_VIDEOS, metric)) for metric in METRICS]
    means += [None, value.get((ALL_VIDEOS, NORMALISED_CAMERA_ERROR))]
    cells.append([ALL_VIDEOS, None, *(_mean(cells, k) for k in (2, 3, 4)), *means])
    return Table(
        name="uncertainty",
        title="Claimed standard deviations (root mean square over 12 joints) and normalised errors",
        columns=[
            *("video", "azimuth_deg", "sigma_mm", "depth_mm", "across_mm", *METRICS),
            *("camera_rotation_deg", NORMALISED_CAMERA_ERROR),
        ],
        rows=cells,
        note=claimed.status,
    )


def _by_joint(claimed: Uncertainty, motions: Sequence[VideoMotion], truth: Truth | None) -> Table:
    """All 24 joints where the truth of every video has them, else the twelve."""
    all_known = all(joint_errors_mm(m, truth, SMPL_JOINTS) is not None for m in motions)
    joints = SMPL_JOINTS if all_known else EVAL_12
    index = [SMPL_JOINTS.index(name) for name in joints]
    sigma, error = [], []
    for video, motion in zip(claimed.videos, motions, strict=True):
        errors = joint_errors_mm(motion, truth, joints)
        sigma.append(video.sigma_mm[:, index])
        vectors = errors if errors is not None else np.full((*sigma[-1].shape, 3), np.nan)
        error.append(np.linalg.norm(vectors, axis=-1))
    claims, true = np.concatenate(sigma), np.concatenate(error)
    ratio = normalised_errors(true, claims)
    rows: list[list[Cell]] = [
        [name, _rms(claims[:, j]), _rms(true[:, j]), _finite(ratio[j])]
        for j, name in enumerate(joints)
    ]
    return Table(
        name="uncertainty_joints",
        title="Claimed standard deviation and error (root mean squares), by joint",
        columns=["joint", "sigma_mm", "error_mm", "normalised_error"],
        rows=rows,
    )


def _rms(x: Float[np.ndarray, "..."]) -> float | None:
    finite = x[np.isfinite(x)]
    return float(np.sqrt(np.mean(finite**2))) if len(finite) else None


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _mean(cells: Sequence[Sequence[Cell]], column: int) -> float | None:
    numbers = [cell for row in cells if isinstance(cell := row[column], float)]
    return float(np.mean(numbers)) if numbers else None
