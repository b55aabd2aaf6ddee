"""Claimed standard deviations against true errors, as rows and tables of the report."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from imocap_core.artifacts.schemas import Table, Uncertainty, VideoMotion
from imocap_core.conventions import EVAL_12, SMPL_JOINTS
from imocap_core.evaluate.scoreboard import true_motion
from imocap_core.io.truth import Truth
from imocap_core.metrics.calibration import normalised_error, normalised_errors
from imocap_core.metrics.joints import missing_joints, root_relative
from imocap_core.metrics.scoring import ALL_VIDEOS, ScoreRow

Array = NDArray[np.float64]
Cell = str | bool | int | float | None
METRICS = ("normalised_error", "normalised_depth_error", "normalised_across_error")
AT = [SMPL_JOINTS.index(name) for name in EVAL_12]


def normalised_rows(
    name: str, claimed: Uncertainty, motions: Sequence[VideoMotion], truth: Truth | None
) -> list[ScoreRow]:
    """Each video's normalised errors over 12 joints; why there is none where it can't be scored."""
    rows = []
    for video, motion in zip(claimed.videos, motions, strict=True):
        errors = _errors_mm(motion, truth)
        if errors is None:
            rows += [ScoreRow(name, video.id, metric, None, "no truth") for metric in METRICS]
            continue
        sight = _sight(motion)
        along = np.einsum("tjx,tx->tj", errors, sight)
        across = np.sqrt(np.maximum((errors**2).sum(-1) - along**2, 0.0))
        pairs = (
            (np.linalg.norm(errors, axis=-1), video.sigma_mm),
            (along, video.depth_mm),
            (across, video.across_mm),
        )
        for metric, (error, sigma) in zip(METRICS, pairs, strict=True):
            value = normalised_error(error, sigma[:, AT])
            known = bool(np.isfinite(value))
            rows.append(
                ScoreRow(
                    name, video.id, metric, value if known else None, "" if known else "no frame"
                )
            )
    return rows


def uncertainty_tables(
    claimed: Uncertainty,
    motions: Sequence[VideoMotion],
    truth: Truth | None,
    rows: Sequence[ScoreRow],
) -> list[Table]:
    """A row a video, a row a joint, a row a further viewpoint."""
    tables = [_by_video(claimed, rows), _by_joint(claimed, motions, truth)]
    if claimed.viewpoints:
        cells: list[list[Cell]] = [[v.azimuth_deg, v.reduction] for v in claimed.viewpoints]
        tables.append(
            Table(
                name="viewpoints",
                title="One more camera: share by which the common motion's variance would fall",
                columns=["azimuth_deg", "reduction_share"],
                rows=cells,
            )
        )
    return tables


def _by_video(claimed: Uncertainty, rows: Sequence[ScoreRow]) -> Table:
    value = {(r.video, r.metric): r.value for r in rows}
    cells: list[list[Cell]] = [
        [
            v.id,
            v.azimuth_deg if np.isfinite(v.azimuth_deg) else None,
            *(_rms(x[:, AT]) for x in (v.sigma_mm, v.depth_mm, v.across_mm)),
            *(value.get((v.id, metric)) for metric in METRICS),
        ]
        for v in claimed.videos
    ]
    means = [value.get((ALL_VIDEOS, metric)) for metric in METRICS]
    cells.append([ALL_VIDEOS, None, *(_mean(cells, k) for k in (2, 3, 4)), *means])
    return Table(
        name="uncertainty",
        title="Claimed standard deviations (root mean square over 12 joints) and normalised errors",
        columns=["video", "azimuth_deg", "sigma_mm", "depth_mm", "across_mm", *METRICS],
        rows=cells,
        note=claimed.status,
    )


def _by_joint(claimed: Uncertainty, motions: Sequence[VideoMotion], truth: Truth | None) -> Table:
    sigma, error = [], []
    for video, motion in zip(claimed.videos, motions, strict=True):
        errors = _errors_mm(motion, truth)
        sigma.append(video.sigma_mm[:, AT])
        known = errors if errors is not None else np.full((*sigma[-1].shape, 3), np.nan)
        error.append(np.linalg.norm(known, axis=-1))
    claims, found = np.concatenate(sigma), np.concatenate(error)
    ratio = normalised_errors(found, claims)
    rows: list[list[Cell]] = [
        [name, _rms(claims[:, j]), _rms(found[:, j]), _finite(ratio[j])]
        for j, name in enumerate(EVAL_12)
    ]
    return Table(
        name="uncertainty_joints",
        title="Claimed standard deviation and error (root mean squares), by joint",
        columns=["joint", "sigma_mm", "error_mm", "normalised_error"],
        rows=rows,
    )


def _errors_mm(motion: VideoMotion, truth: Truth | None) -> Array | None:
    """(T, 12, 3) about the middle of the hips, camera axes."""
    own = None if truth is None else truth.videos.get(motion.id)
    true = None if own is None else true_motion(own, motion.frames)
    if true is None or missing_joints(true.names, EVAL_12):
        return None
    found = root_relative(motion.joints, SMPL_JOINTS, EVAL_12)
    return 1000 * (found - root_relative(true.joints_m, true.names, EVAL_12))


def _sight(motion: VideoMotion) -> Array:
    """(T, 3) unit vectors from the camera to the root."""
    root = motion.joints[:, 0]
    sight: Array = root / np.linalg.norm(root, axis=-1, keepdims=True)
    return sight


def _rms(x: Array) -> float | None:
    known = x[np.isfinite(x)]
    return float(np.sqrt(np.mean(known**2))) if len(known) else None


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _mean(cells: Sequence[Sequence[Cell]], column: int) -> float | None:
    known = [cell for row in cells if isinstance(cell := row[column], float)]
    return float(np.mean(known)) if known else None
