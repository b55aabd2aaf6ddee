"""Figures of synchronisation: affinities, warps, pace, confidence, rounds of the loop."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import ceil

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import LinearSegmentedColormap, to_rgb
from matplotlib.figure import Figure, SubFigure
from scipy.special import erfinv

from imocap_core.adapters.sync_maps import affinity_between, maps_of
from imocap_core.artifacts.schemas import Keypoints, Sync, SyncSummary
from imocap_core.figures.style import (
    ACCENT,
    INK,
    QUIET,
    TRUTH,
    color_of,
    grid,
    headline,
    new_figure,
)
from imocap_core.figures.sync_summary import seconds_at, sync_rows, title_of

Positions = Float[np.ndarray, " T"]  # fractional index into the reference's used frames

_AFFINITY = LinearSegmentedColormap.from_list(
    "affinity", ["#ffffff", "#d5e1ec", "#7fa3c4", "#28588a", "#122b45"]
)


def affinity_figure(
    sync: Sync, true_positions: Mapping[str, Float[np.ndarray, " _"]]
) -> Figure | None:
    """Affinity of each video to the reference, before and after cycle consistency, with the path.

    Args:
        true_positions: video id -> (T,) index into the reference's used frames, NaN without
            counterpart; empty when the truth is unknown.

    Returns:
        None when there is no second video.
    """
    others = [i for i in sync.ids if i != sync.reference]
    if not others:
        return None
    figure = new_figure(0.9 + 2.35 * len(others), 5.6)
    axes = figure.subplots(2, len(others), squeeze=False, sharex="col", sharey=True)
    maps, number = maps_of(sync), {name: v for v, name in enumerate(sync.ids)}
    to = number[sync.reference]
    for row, name in enumerate(("affinity", f"relaxed ({sync.method})")):
        for column, video in enumerate(others):
            ax = axes[row, column]
            if row == 0:
                block, _ = affinity_between(sync, video, sync.reference)
            else:
                block = maps.block(number[video], to)
            draw_affinity(ax, block.T)
            if row == 0:
                _path(ax, sync, video, true_positions.get(video))
                ax.set_title(video, color=color_of(sync.ids, video), fontweight="bold")
            else:
                ax.set_xlabel("frame of the video")
            if column == 0:
                ax.set_ylabel(f"{name}\nframe of {sync.reference}")
    legend = "red: the matched path" + ("; dotted: truth" if true_positions else "")
    headline(
        figure,
        f"Similarity of the poses of each video and of {sync.reference}",
        f"blue = similar; {legend}",
    )
    return figure


def draw_affinity(ax: Axes, block: Float[np.ndarray, "rows columns"]) -> None:
    """A block of affinities, blue = similar, the brightest 2 % and the darkest 0.2 % clipped."""
    low, high = np.quantile(block, [0.02, 0.998])
    ax.imshow(
        block,
        cmap=_AFFINITY,
        vmin=low,
        vmax=max(high, low + 1e-6),
        origin="lower",
        interpolation="nearest",
        aspect="auto",
    )
    for spine in ax.spines.values():
        spine.set_visible(False)
    ax.tick_params(length=2)


def _path(ax: Axes, sync: SyncSummary, video: str, true: Positions | None) -> None:
    matched = sync.map_of(video).reference_frame
    frames = np.arange(len(matched))
    ax.plot(frames, matched, color="white", lw=2.6, alpha=0.8, solid_capstyle="round")
    ax.plot(frames, matched, color=ACCENT, lw=1.3, solid_capstyle="round")
    if true is not None:
        ax.plot(frames, true, color=TRUTH, lw=1.1, ls=(0, (1, 2.2)))


def warp_figure(
    before: SyncSummary, after: SyncSummary, true_positions: Mapping[str, Float[np.ndarray, " _"]]
) -> Figure | None:
    """Each video's map into the reference, its confidence and, with truth, its error.

    Args:
        before, after: the first synchronisation and the one after the loop.
        true_positions: as for `affinity_figure`.
    """
    others = [i for i in after.ids if i != after.reference]
    if not others:
        return None
    heights = [3.0, 1.0, 0.8] if true_positions else [3.0, 0.8]
    figure = new_figure(8.6, 1.0 + sum(heights) * 1.15)
    panels = list(figure.subplots(len(heights), 1, sharex=True, height_ratios=heights))
    for video in others:
        _warp(panels[0], after, video, true_positions.get(video))
        if video in true_positions:
            color = color_of(after.ids, video)
            for sync, width, alpha in ((before, 0.8, 0.45), (after, 1.3, 1.0)):
                if sync.reference == after.reference:
                    off = sync.map_of(video).reference_frame - true_positions[video]
                    panels[1].plot(off, color=color, lw=width, alpha=alpha)
        confidence = after.map_of(video).confidence
        panels[-1].plot(confidence, color=color_of(after.ids, video), lw=1.1)
    panels[0].set_ylabel(f"frame of {after.reference}")
    panels[0].legend(loc="lower right", ncols=max(1, len(others) // 4))
    if true_positions:
        panels[1].set_ylabel("error\n(frames)")
        panels[1].axhline(0, color=QUIET, lw=0.7)
        panels[1].margins(y=0.12)
    panels[-1].set_ylabel("confidence")
    panels[-1].set_ylim(-0.03, 1.05)
    panels[-1].set_xlabel("frame of the video (used frames, from 0)")
    for ax in panels:
        grid(ax)
        ax.margins(x=0.01)
    dotted = "; dotted: truth; in the error, thin: before the loop" if true_positions else ""
    headline(
        figure,
        f"Position of each frame in {after.reference}",
        f"pale: low confidence; gap: unmatched frames{dotted}",
    )
    return figure


def _warp(ax: Axes, sync: SyncSummary, video: str, true: Positions | None) -> None:
    sync_map = sync.map_of(video)
    color = color_of(sync.ids, video)
    frames = np.arange(len(sync_map.reference_frame))
    points = np.column_stack([frames, sync_map.reference_frame])
    segments = np.stack([points[:-1], points[1:]], axis=1)
    matched = np.isfinite(segments).all(axis=(1, 2))
    ends = sync_map.confidence[:-1], sync_map.confidence[1:]
    confidence = np.nan_to_num(np.minimum(*ends))[matched]
    shades = np.column_stack(
        [np.tile(to_rgb(color), (len(confidence), 1)), 0.25 + 0.75 * confidence]
    )
    ax.add_collection(LineCollection(list(segments[matched]), colors=shades, lw=2.0))
    ax.plot([], [], color=color, label=video if matched.any() else f"{video} (unmatched)")
    if matched.any():
        ax.update_datalim(points[np.isfinite(points).all(axis=1)])
    ax.autoscale_view()
    if true is not None:
        ax.plot(np.arange(len(true)), true, color=INK, lw=0.9, ls=(0, (1, 2.2)))


def rounds_figure(
    costs: Sequence[float],
    changes: Sequence[float],
    errors: Mapping[str, Sequence[float]],
    best: int,
) -> Figure:
    """The alternation, round by round; round 0 is the single pass.

    Args:
        costs: the cost by which rounds are compared. changes: mean change of the correspondences,
            in frames.
        errors: title -> error of each round, when the truth is known. best: the selected round.
    """
    panels = {"cost of the round": costs, "change of sync (frames)": changes, **errors}
    figure = new_figure(0.6 + 2.1 * len(panels), 2.7)
    rounds = np.arange(len(costs))
    colors = ["#28588a" if i == best else "#c3d1df" for i in rounds]
    for ax, (title, values) in zip(figure.subplots(1, len(panels)), panels.items(), strict=True):
        ax.bar(rounds, values, color=colors, width=0.6)
        ax.set_title(title)
        ax.set_xticks(rounds)
        ax.set_xlabel("round")
        ax.margins(y=0.12)
        grid(ax, "y")
    headline(figure, "Convergence of the loop", "dark: the selected round; 0: the single pass")
    return figure


_WIDTH_IN = 12.4  # 1612 pixels
_COLUMNS = 4
_MATRIX_IN = 2.9
_CURVES_IN = 4.6
_WIDEST_BAND_S = 0.5


def sync_picture(keypoints: Keypoints, sync: Sync, *, reach_s: float) -> Figure:
    """Affinity of each video to the reference with the matched path; below, the warps of all.

    Args:
        reach_s: confidence is the probability that the match is within this many seconds.
    """
    others = [i for i in sync.ids if i != sync.reference]
    rows = ceil(len(others) / _COLUMNS)
    figure = new_figure(_WIDTH_IN, 0.75 + _MATRIX_IN * rows + _CURVES_IN)
    heights = [0.75 + _MATRIX_IN * rows, _CURVES_IN]
    above, below = figure.subfigures(2, 1, squeeze=False, height_ratios=heights)[:, 0]
    _matrices(above, sync, others)
    _warps(below.subplots(), keypoints, sync, reach_s)
    headline(
        figure,
        f"{len(sync.ids)} videos on the time axis of {sync.reference}",
        "above: pose affinity (blue = similar), red: the match; below: the match and its error",
    )
    return figure


def _matrices(place: Figure | SubFigure, sync: Sync, others: list[str]) -> None:
    rows = ceil(len(others) / _COLUMNS)
    axes = place.subplots(rows, min(_COLUMNS, len(others)), squeeze=False)
    for ax, video in zip(axes.flat, others, strict=False):
        draw_affinity(ax, affinity_between(sync, video, sync.reference)[0].T)
        _path(ax, sync, video, None)
        title = title_of(sync, video)
        ax.set_title(title, color=color_of(sync.ids, video), fontweight="bold")
        ax.set_xlabel(f"frame of {video} (used frames, from 0)")
    for ax in axes[:, 0]:
        ax.set_ylabel(f"frame of {sync.reference}")
    for ax in axes.flat[len(others) :]:
        ax.set_visible(False)


def _warps(ax: Axes, keypoints: Keypoints, sync: Sync, reach_s: float) -> None:
    """Time in the reference over time in the video, with a band of one standard deviation."""
    videos = {v.id: v for v in keypoints.videos}
    reference_s = np.arange(len(videos[sync.reference].frames)) / videos[sync.reference].fps
    for row in sync_rows(keypoints, sync):
        if row.video == sync.reference:
            continue
        sync_map = sync.map_of(row.video)
        color = color_of(sync.ids, row.video)
        here = np.arange(len(videos[row.video].frames)) / videos[row.video].fps
        there = seconds_at(sync_map.reference_frame, reference_s)
        band = uncertainty_s(sync_map.confidence, reach_s)
        label = title_of(sync, row.video)
        if row.matched > 0:
            label += f": {row.matched:.0%} matched, rate {row.rate:.2f}"
        ax.fill_between(here, there - band, there + band, color=color, alpha=0.25, lw=0)
        ax.plot(here, there, color=color, lw=1.6, label=label)
    ends = reference_s[[0, -1]]
    ax.plot(
        ends, ends, color=QUIET, lw=1.0, ls=(0, (3, 3)), label=f"{sync.reference}: the reference"
    )
    ax.set_xlabel("time since the video's first used frame (s)")
    ax.set_ylabel(f"time in {sync.reference} (s)")
    ax.set_title("Matched moment of the reference")
    ax.legend(loc="best", handlelength=1.4)
    grid(ax)


def uncertainty_s(confidence: Float[np.ndarray, " T"], reach_s: float) -> Float[np.ndarray, " T"]:
    """Standard deviation of a normal error that is within reach_s with this probability, in
    seconds, at most _WIDEST_BAND_S."""
    sure = np.clip(np.nan_to_num(confidence), 1e-3, 1 - 1e-6)
    return np.minimum(reach_s / (np.sqrt(2) * erfinv(sure)), _WIDEST_BAND_S)
