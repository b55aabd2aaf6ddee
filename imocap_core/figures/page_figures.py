"""Standard deviations of joints, joint angles."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure

from imocap_core.artifacts.schemas import Keypoints, SyncSummary, Table, Uncertainty
from imocap_core.biomechanics.joint_angles import MeanCurve
from imocap_core.conventions import EVAL_12, EVAL_INDICES
from imocap_core.figures.style import ACCENT, INK, QUIET, grid, headline, new_figure
from imocap_core.figures.sync_summary import common_moments, positions_on_axis, retimed
from imocap_core.technique import plain_angle, without_side

_CERTAIN_TO_UNCERTAIN = LinearSegmentedColormap.from_list(
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
        cmap=_CERTAIN_TO_UNCERTAIN,
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


_COLUMNS = 3
_WIDTH_IN = 9.6
_GAPS = {"hspace": 0.32, "wspace": 0.16}  # of a panel
_LEFT, _RIGHT, _MIDDLE = "#31689b", "#d0802f", "#4a5058"
_SIDES = (("left_", _LEFT), ("right_", _RIGHT))
_SUBTITLE = (
    "degrees against seconds of the reference; line: mean of the performances, band: one standard "
    "deviation. Definitions: docs/angles.md"
)


def angle_figure(
    action: str, phase_s: Float[np.ndarray, " N"], curves: Mapping[str, MeanCurve]
) -> Figure:
    """A panel for every angle, left and right sides in one; a row for every joint."""
    titles = list(dict.fromkeys(map(without_side, curves)))
    joints = list(dict.fromkeys(title.partition("_")[0] for title in titles))
    height = 0.9 + 1.45 * len(joints)
    figure = new_figure(_WIDTH_IN, height, arranged=False)  # panels of one size: nothing to arrange
    edges = {"left": 0.48 / _WIDTH_IN, "right": 1 - 0.12 / _WIDTH_IN}
    edges |= {"bottom": 0.42 / height, "top": 1 - 0.84 / height}
    axes = figure.subplots(
        len(joints), _COLUMNS, sharex=True, squeeze=False, gridspec_kw=edges | _GAPS
    )
    for row, joint in enumerate(joints):
        of_joint = [title for title in titles if title.partition("_")[0] == joint]
        for column, ax in enumerate(axes[row]):
            if column < len(of_joint):
                _panel(ax, of_joint[column], phase_s, curves)
            else:
                ax.set_visible(False)
    for ax in axes[-1]:
        ax.set_xlabel("s")
    handles, labels = axes[joints.index("hip"), 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="upper right", ncols=2)
    headline(figure, f"{action}: joint angles", _SUBTITLE)
    return figure


def _panel(
    ax: Axes, title: str, phase_s: Float[np.ndarray, " N"], curves: Mapping[str, MeanCurve]
) -> None:
    sides = [(p + title, p.rstrip("_"), c) for p, c in _SIDES if p + title in curves]
    for name, label, colour in sides or [(title, "", _MIDDLE)]:
        curve = curves[name]
        low, high = curve.mean_deg - curve.sd_deg, curve.mean_deg + curve.sd_deg
        ax.fill_between(phase_s, low, high, color=colour, alpha=0.2, linewidth=0)
        ax.plot(phase_s, curve.mean_deg, color=colour, label=label)
    ax.axhline(0, color=QUIET, lw=0.5, zorder=0)
    ax.grid(True, axis="y")
    ax.set_title(title.replace("_", " "))


def key_angle_figure(
    ids: Sequence[str],
    phase_s: Float[np.ndarray, " N"],
    curves: Mapping[str, Float[np.ndarray, "M N"]],
    colors: Sequence[str],
    moment_s: float,
) -> Figure:
    """A panel for each of a few angles, a line for every video, an upright line at one moment.

    curves: degrees by the angle's name, NaN where a video does not show the moment.
    """
    rows = -(-len(curves) // 2)
    figure = new_figure(_WIDTH_IN * 0.7, 0.8 + 1.5 * rows)
    axes = figure.subplots(rows, 2, sharex=True, squeeze=False)
    for ax, (name, each) in zip(axes.flat, curves.items(), strict=False):
        for video, color, values in zip(ids, colors, each, strict=True):
            ax.plot(phase_s, values, color=color, label=video)
        ax.axvline(moment_s, color=INK, lw=0.8)
        ax.grid(True, axis="y")
        ax.set_title(f"{plain_angle(name)} (degrees)")
    for ax in axes.flat[len(curves) :]:
        ax.set_visible(False)
    for ax in axes[-1]:
        ax.set_xlabel("seconds")
    if len(ids) > 1:
        handles, labels = axes[0, 0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=min(len(ids), 5))
    return figure
