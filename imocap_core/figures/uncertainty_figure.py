"""Claimed standard deviation of each joint, overall and over time."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure

from imocap_core.artifacts.schemas import Keypoints, SyncSummary, Table, Uncertainty
from imocap_core.conventions import EVAL_12, EVAL_INDICES
from imocap_core.figures.style import ACCENT, grid, headline, new_figure
from imocap_core.figures.sync_summary import common_moments, positions_on_axis, retimed

CERTAIN_TO_UNCERTAIN = LinearSegmentedColormap.from_list(
    "uncertain", ["#f4f6f8", "#f0d3b8", "#d98b4a", "#a3432c", "#5a1f1a"]
)


def uncertainty_figure(
    claimed: Uncertainty, keypoints: Keypoints, sync: SyncSummary, by_joint: Table | None
) -> Figure:
    """Bars: the claimed standard deviation of each joint and, where known, the true error. Map: the
    claimed standard deviation of each joint over the common time axis, mean over the videos.

    by_joint: the report's table `uncertainty_joints`, which has the errors.
    """
    sigma_mm = np.concatenate([v.sigma_mm[:, EVAL_INDICES] for v in claimed.videos])
    rms_mm = np.sqrt(np.nanmean(sigma_mm**2, axis=0))
    order = np.argsort(rms_mm)
    errors_mm = _errors(by_joint)
    figure = new_figure(11.0, 3.9)
    bars, over = figure.subplots(1, 2, width_ratios=[1.0, 1.35])
    names = [EVAL_12[j].replace("_", " ") for j in order]
    lines = np.arange(len(order))
    bars.barh(lines, rms_mm[order], 0.62, color="#85a9cc", label="claimed standard deviation")
    true_mm = np.array([errors_mm.get(EVAL_12[j], np.nan) for j in order])
    if np.isfinite(true_mm).any():
        bars.plot(true_mm, lines, "D", color=ACCENT, ms=4.5, label="true error")
    bars.set_yticks(lines, names)
    bars.set_ylim(-0.5, len(order) - 0.5)
    bars.tick_params(axis="y", length=0)
    bars.set_xlabel("root mean square (mm)")
    bars.legend(loc="lower right")
    grid(bars, "x")
    moments_s, by_moment = over_time(claimed, keypoints, sync)
    shown = by_moment[:, order].T
    image = over.imshow(
        shown,
        cmap=CERTAIN_TO_UNCERTAIN,
        vmin=0,
        vmax=float(np.nanquantile(shown, 0.98)),
        aspect="auto",
        origin="lower",
        extent=(moments_s[0], moments_s[-1], -0.5, len(order) - 0.5),
        interpolation="nearest",
    )
    over.set_yticks([])
    over.set_xlabel(f"time in {sync.reference} (s)")
    over.spines[:].set_visible(False)
    figure.colorbar(image, ax=over, label="mm", pad=0.01, shrink=0.9)
    headline(
        figure,
        "Uncertainty of each joint",
        "relative to the hips' middle; left: all frames; right: over time, mean over the videos",
    )
    return figure


def over_time(
    claimed: Uncertainty, keypoints: Keypoints, sync: SyncSummary
) -> tuple[Float[np.ndarray, " M"], Float[np.ndarray, "M 12"]]:
    """Seconds on the common axis, and claimed standard deviations in mm, root mean square over the
    videos that show that moment; NaN where none does."""
    fps = next(v.fps for v in keypoints.videos if v.id == sync.reference)
    moments = common_moments(keypoints, sync)
    total, count = np.zeros((len(moments), len(EVAL_INDICES))), np.zeros((len(moments), 1))
    for video in claimed.videos:
        index, matched = retimed(positions_on_axis(sync, video.id, fps), moments, fps)
        sigma = video.sigma_mm[index][:, EVAL_INDICES]
        shown = matched[:, None] & np.isfinite(sigma)
        total += np.where(shown, sigma**2, 0.0)
        count += shown.all(axis=1, keepdims=True)
    mean = np.divide(total, count, out=np.full_like(total, np.nan), where=count > 0)
    return moments / fps, np.sqrt(mean)


def _errors(by_joint: Table | None) -> Mapping[str, float]:
    """Joint -> error in mm, where known."""
    if by_joint is None:
        return {}
    joint, error = (by_joint.columns.index(c) for c in ("joint", "error_mm"))
    return {
        str(row[joint]): value for row in by_joint.rows if isinstance(value := row[error], float)
    }
