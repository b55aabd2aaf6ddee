"""Figures of synchronisation: affinities with the matched paths, warps, rounds of the loop."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import LinearSegmentedColormap, to_rgb
from matplotlib.figure import Figure

from imocap_core.artifacts.schemas import Sync, SyncMap, SyncSummary
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
from imocap_core.problem.sync_maps import affinity_between, maps_of

Positions = Float[np.ndarray, " T"]  # fractional index into the reference's used frames

AFFINITY = LinearSegmentedColormap.from_list(
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
            ax, T = axes[row, column], sync.lengths[number[video]]
            if row == 0:
                block, _ = affinity_between(sync, video, sync.reference)
            else:
                block = maps.block(number[video], to)
            draw_affinity(ax, block.T, (-0.5, T - 0.5, -0.5, sync.lengths[to] - 0.5))
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
        f"dark = similar; {legend}",
    )
    return figure


def draw_affinity(
    ax: Axes,
    block: Float[np.ndarray, "rows columns"],
    extent: tuple[float, float, float, float] | None = None,
) -> None:
    """A block of affinities, dark = similar, the brightest 2 % and the darkest 0.2 % clipped."""
    low, high = np.quantile(block, [0.02, 0.998])
    ax.imshow(
        block,
        cmap=AFFINITY,
        vmin=low,
        vmax=max(high, low + 1e-6),
        origin="lower",
        interpolation="nearest",
        aspect="auto",
        extent=extent,
    )
    for spine in ax.spines.values():
        spine.set_visible(False)
    ax.tick_params(length=2)


def _path(ax: Axes, sync: SyncSummary, video: str, true: Positions | None) -> None:
    matched = map_of(sync, video).reference_frame
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
            _error(panels[1], before, after, video, true_positions[video])
        confidence = map_of(after, video).confidence
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
    sync_map = map_of(sync, video)
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


def map_of(sync: SyncSummary, video: str) -> SyncMap:
    """A video's map into the reference."""
    return next(m for m in sync.maps if m.id == video)


def _error(ax: Axes, before: SyncSummary, after: SyncSummary, video: str, true: Positions) -> None:
    color = color_of(after.ids, video)
    for sync, width, alpha in ((before, 0.8, 0.45), (after, 1.3, 1.0)):
        if sync.reference == after.reference:
            matched = map_of(sync, video).reference_frame
            ax.plot(matched - true, color=color, lw=width, alpha=alpha)


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
