"""One picture of a synchronisation: how alike, which frame where, how fast, how sure."""

from __future__ import annotations

from math import ceil

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d
from scipy.special import erfinv

from imocap_core.artifacts.schemas import Keypoints, Sync, SyncMap, VideoKeypoints
from imocap_core.figures.style import ACCENT, QUIET, color_of, grid, headline, new_figure
from imocap_core.figures.sync_figures import draw_affinity
from imocap_core.figures.sync_summary import seconds_at, sync_rows, title_of

Array = NDArray[np.float64]

WIDTH_IN = 12.4  # 1612 pixels
COLUMNS = 4
MATRIX_IN = 2.9
CURVES_IN = 4.6
PACE_SMOOTH_S = 0.25
PACE_SHOWN = 4.0  # from a quarter to four times
WIDEST_BAND_S = 0.5


def sync_picture(keypoints: Keypoints, sync: Sync, *, reach_s: float) -> Figure:
    """Affinity of each video to the reference with the path found; below, the warps of all.

    Args:
        reach_s: confidence is the probability of a match within this many seconds.
    """
    others = [i for i in sync.ids if i != sync.reference]
    rows = ceil(len(others) / COLUMNS)
    figure = new_figure(WIDTH_IN, 0.75 + MATRIX_IN * rows + CURVES_IN)
    above, below = figure.subfigures(
        2, 1, squeeze=False, height_ratios=[0.75 + MATRIX_IN * rows, CURVES_IN]
    )[:, 0]
    seen = {v.id: v for v in keypoints.videos}
    _matrices(above, sync, seen, others)
    left, right = below.subfigures(1, 2, squeeze=False, width_ratios=[1.0, 1.15])[0]
    warps = left.subplots()
    pace, sure = right.subplots(2, 1, sharex=True, height_ratios=[1.6, 1.0])
    _warps(warps, keypoints, sync, reach_s)
    _paces(pace, keypoints, sync)
    _confidences(sure, seen, sync)
    headline(
        figure,
        f"{len(sync.ids)} videos on the time axis of {sync.reference}",
        "above: pose affinity (dark = alike), red: the match found; below: which moment, how fast, "
        "how sure",
    )
    return figure


def _matrices(
    place: Figure | SubFigure, sync: Sync, seen: dict[str, VideoKeypoints], others: list[str]
) -> None:
    rows = ceil(len(others) / COLUMNS)
    axes = place.subplots(rows, min(COLUMNS, len(others)), squeeze=False)
    starts = dict(zip(sync.ids, np.cumsum([0, *sync.lengths]), strict=False))
    reference = seen[sync.reference]
    for number, ax in enumerate(axes.flat):
        if number >= len(others):
            ax.set_visible(False)
            continue
        video = seen[others[number]]
        a, b = starts[video.id], starts[reference.id]
        block = sync.affinity[a : a + len(video.frames), b : b + len(reference.frames)].T
        across, up = ((v.frames[0] - 0.5, v.frames[-1] + 0.5) for v in (video, reference))
        draw_affinity(ax, block, (*across, *up))
        found = _map(sync, video.id)
        there = seconds_at(found.reference_frame, reference.frames, 1.0)
        ax.plot(video.frames, there, color="white", lw=3.2, alpha=0.85)
        ax.plot(video.frames, there, color=ACCENT, lw=1.5)
        ax.set_title(
            title_of(sync, video.id), color=color_of(sync.ids, video.id), fontweight="bold"
        )
        ax.set_xlabel(f"frame of {video.id}")
        if number % COLUMNS == 0:
            ax.set_ylabel(f"frame of {reference.id}")
        ax.spines[:].set_visible(False)


def _warps(ax: Axes, keypoints: Keypoints, sync: Sync, reach_s: float) -> None:
    """Time in the reference over time in the video; the band holds two thirds of what is likely."""
    seen = {v.id: v for v in keypoints.videos}
    reference = seen[sync.reference]
    for row in sync_rows(keypoints, sync):
        if row.video == sync.reference:
            continue
        video, found = seen[row.video], _map(sync, row.video)
        color = color_of(sync.ids, row.video)
        own = _seconds(video)
        there = _seconds_there(found, reference)
        band = uncertainty_s(found.confidence, reach_s)
        said = title_of(sync, row.video)
        if row.matched > 0:
            said += f": {row.matched:.0%} matched, rate {row.rate:.2f}"
        ax.fill_between(own, there - band, there + band, color=color, alpha=0.25, lw=0)
        ax.plot(own, there, color=color, lw=1.6, label=said)
    ends = _seconds(reference)[[0, -1]]
    ax.plot(
        ends, ends, color=QUIET, lw=1.0, ls=(0, (3, 3)), label=f"{sync.reference}: the reference"
    )
    ax.set_xlabel("time since the video's first used frame (s)")
    ax.set_ylabel(f"time in {sync.reference} (s)")
    ax.set_title("Which moment of the reference does each frame show?")
    ax.legend(loc="best", handlelength=1.4)
    grid(ax)


def _paces(ax: Axes, keypoints: Keypoints, sync: Sync) -> None:
    seen = {v.id: v for v in keypoints.videos}
    reference = seen[sync.reference]
    shown = []
    for video in keypoints.videos:
        if video.id == sync.reference:
            continue
        there = _seconds_there(_map(sync, video.id), reference)
        pace = pace_of(there, _seconds(video), PACE_SMOOTH_S * video.fps)
        ax.plot(there, pace, color=color_of(sync.ids, video.id), lw=1.5)
        shown.append(pace)
    ax.axhline(1.0, color=QUIET, lw=1.0, ls=(0, (3, 3)))
    ax.set_yscale("log")
    low, high = _pace_limits(shown)
    ax.set_ylim(low, high)
    ticks = [t for t in (0.25, 0.5, 0.7, 1.0, 1.4, 2.0, 4.0) if low <= t <= high]
    ax.set_yticks(ticks, [f"{t:g}x" for t in ticks])
    ax.set_yticks([], minor=True)
    ax.set_ylabel("pace")
    ax.set_title(f"How fast is the action done, compared with {sync.reference}? (above 1x: faster)")
    grid(ax)


def _pace_limits(paces: list[Array]) -> tuple[float, float]:
    """What holds nearly all of the curves, and 1 in any case."""
    every = np.concatenate([np.ones(1), *paces])
    low, high = np.nanquantile(every, [0.02, 0.98])
    return max(0.9 * min(low, 0.8), 1 / PACE_SHOWN), min(1.1 * max(high, 1.25), PACE_SHOWN)


def _confidences(ax: Axes, seen: dict[str, VideoKeypoints], sync: Sync) -> None:
    reference = seen[sync.reference]
    for found in sync.maps:
        if found.id != sync.reference:
            there = _seconds_there(found, reference)
            ax.plot(there, found.confidence, color=color_of(sync.ids, found.id), lw=1.3)
    ax.set_ylim(-0.03, 1.05)
    ax.set_xlim(*_seconds(reference)[[0, -1]])
    ax.set_ylabel("confidence")
    ax.set_xlabel(f"time in {sync.reference} (s)")
    grid(ax)


def pace_of(there_s: Array, own_s: Array, smooth_frames: float) -> Array:
    """Seconds of the reference per second of the video (T,), smoothed; NaN where unmatched."""
    known = np.isfinite(there_s)
    pace = np.full(len(there_s), np.nan)
    for run in np.split(np.arange(len(known)), np.flatnonzero(np.diff(known)) + 1):
        if known[run[0]] and len(run) > 2:
            slope = np.gradient(there_s[run], own_s[run])
            pace[run] = gaussian_filter1d(slope, smooth_frames, mode="nearest")
    return pace


def uncertainty_s(confidence: Array, reach_s: float) -> Array:
    """Standard deviation of a normal error that lies within reach_s with this probability, in
    seconds, at most WIDEST_BAND_S."""
    sure = np.clip(np.nan_to_num(confidence), 1e-3, 1 - 1e-6)
    return np.minimum(reach_s / (np.sqrt(2) * erfinv(sure)), WIDEST_BAND_S)


def _seconds(video: VideoKeypoints) -> Array:
    """Time of each used frame (T,) since the first of them."""
    since: Array = (video.frames - video.frames[0]) / video.fps
    return since


def _seconds_there(found: SyncMap, reference: VideoKeypoints) -> Array:
    """Time in the reference of each frame of a video (T,), since its first used frame."""
    return seconds_at(found.reference_frame, reference.frames - reference.frames[0], reference.fps)


def _map(sync: Sync, video: str) -> SyncMap:
    return next(m for m in sync.maps if m.id == video)
