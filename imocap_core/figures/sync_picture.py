"""One picture of a synchronisation: affinities, warps, pace and confidence."""

from __future__ import annotations

from math import ceil

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure
from scipy.ndimage import gaussian_filter1d
from scipy.special import erfinv

from imocap_core.artifacts.schemas import Keypoints, Sync, SyncMap, VideoKeypoints
from imocap_core.figures.style import ACCENT, QUIET, color_of, grid, headline, new_figure
from imocap_core.figures.sync_figures import draw_affinity, map_of
from imocap_core.figures.sync_summary import seconds_at, sync_rows, title_of
from imocap_core.problem.sync_maps import affinity_between

WIDTH_IN = 12.4  # 1612 pixels
COLUMNS = 4
MATRIX_IN = 2.9
CURVES_IN = 4.6
PACE_SMOOTH_S = 0.25
PACE_SHOWN = 4.0  # from a quarter to four times
WIDEST_BAND_S = 0.5


def sync_picture(keypoints: Keypoints, sync: Sync, *, reach_s: float) -> Figure:
    """Affinity of each video to the reference with the matched path; below, the warps of all.

    Args:
        reach_s: confidence is the probability that the match is within this many seconds.
    """
    others = [i for i in sync.ids if i != sync.reference]
    rows = ceil(len(others) / COLUMNS)
    figure = new_figure(WIDTH_IN, 0.75 + MATRIX_IN * rows + CURVES_IN)
    above, below = figure.subfigures(
        2, 1, squeeze=False, height_ratios=[0.75 + MATRIX_IN * rows, CURVES_IN]
    )[:, 0]
    videos = {v.id: v for v in keypoints.videos}
    _matrices(above, sync, videos, others)
    left, right = below.subfigures(1, 2, squeeze=False, width_ratios=[1.0, 1.15])[0]
    warps = left.subplots()
    pace, sure = right.subplots(2, 1, sharex=True, height_ratios=[1.6, 1.0])
    _warps(warps, keypoints, sync, reach_s)
    _paces(pace, keypoints, sync)
    _confidences(sure, videos, sync)
    headline(
        figure,
        f"{len(sync.ids)} videos on the time axis of {sync.reference}",
        "above: pose affinity (dark = similar), red: the match; below: match, pace, confidence",
    )
    return figure


def _matrices(
    place: Figure | SubFigure, sync: Sync, videos: dict[str, VideoKeypoints], others: list[str]
) -> None:
    rows = ceil(len(others) / COLUMNS)
    axes = place.subplots(rows, min(COLUMNS, len(others)), squeeze=False)
    reference = videos[sync.reference]
    for number, ax in enumerate(axes.flat):
        if number >= len(others):
            ax.set_visible(False)
            continue
        video = videos[others[number]]
        block = affinity_between(sync, video.id, reference.id)[0].T
        frames, frames_there = (v.frames[0] + np.arange(len(v.frames)) for v in (video, reference))
        across, up = ((f[0] - 0.5, f[-1] + 0.5) for f in (frames, frames_there))
        draw_affinity(ax, block, (*across, *up))
        matched = map_of(sync, video.id).reference_frame
        there = seconds_at(matched, frames_there)
        ax.plot(frames, there, color="white", lw=3.2, alpha=0.85)
        ax.plot(frames, there, color=ACCENT, lw=1.5)
        ax.set_title(
            title_of(sync, video.id), color=color_of(sync.ids, video.id), fontweight="bold"
        )
        ax.set_xlabel(f"frame of {video.id}")
        if number % COLUMNS == 0:
            ax.set_ylabel(f"frame of {reference.id}")
        ax.spines[:].set_visible(False)


def _warps(ax: Axes, keypoints: Keypoints, sync: Sync, reach_s: float) -> None:
    """Time in the reference over time in the video, with a band of one standard deviation."""
    videos = {v.id: v for v in keypoints.videos}
    reference = videos[sync.reference]
    for row in sync_rows(keypoints, sync):
        if row.video == sync.reference:
            continue
        sync_map = map_of(sync, row.video)
        color = color_of(sync.ids, row.video)
        here = _seconds(videos[row.video])
        there = _seconds_there(sync_map, reference)
        band = uncertainty_s(sync_map.confidence, reach_s)
        label = title_of(sync, row.video)
        if row.matched > 0:
            label += f": {row.matched:.0%} matched, rate {row.rate:.2f}"
        ax.fill_between(here, there - band, there + band, color=color, alpha=0.25, lw=0)
        ax.plot(here, there, color=color, lw=1.6, label=label)
    ends = _seconds(reference)[[0, -1]]
    ax.plot(
        ends, ends, color=QUIET, lw=1.0, ls=(0, (3, 3)), label=f"{sync.reference}: the reference"
    )
    ax.set_xlabel("time since the video's first used frame (s)")
    ax.set_ylabel(f"time in {sync.reference} (s)")
    ax.set_title("Matched moment of the reference")
    ax.legend(loc="best", handlelength=1.4)
    grid(ax)


def _paces(ax: Axes, keypoints: Keypoints, sync: Sync) -> None:
    videos = {v.id: v for v in keypoints.videos}
    reference = videos[sync.reference]
    shown = []
    for video in keypoints.videos:
        if video.id == sync.reference:
            continue
        there = _seconds_there(map_of(sync, video.id), reference)
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
    ax.set_title(f"Pace relative to {sync.reference} (above 1x: faster)")
    grid(ax)


def _pace_limits(paces: list[Float[np.ndarray, " _"]]) -> tuple[float, float]:
    """A range that contains nearly all of the curves, and 1."""
    every = np.concatenate([np.ones(1), *paces])
    low, high = np.nanquantile(every, [0.02, 0.98])
    return max(0.9 * min(low, 0.8), 1 / PACE_SHOWN), min(1.1 * max(high, 1.25), PACE_SHOWN)


def _confidences(ax: Axes, videos: dict[str, VideoKeypoints], sync: Sync) -> None:
    reference = videos[sync.reference]
    for sync_map in sync.maps:
        if sync_map.id != sync.reference:
            there = _seconds_there(sync_map, reference)
            ax.plot(there, sync_map.confidence, color=color_of(sync.ids, sync_map.id), lw=1.3)
    ax.set_ylim(-0.03, 1.05)
    ax.set_xlim(*_seconds(reference)[[0, -1]])
    ax.set_ylabel("confidence")
    ax.set_xlabel(f"time in {sync.reference} (s)")
    grid(ax)


def pace_of(
    there_s: Float[np.ndarray, " T"], here_s: Float[np.ndarray, " T"], smooth_frames: float
) -> Float[np.ndarray, " T"]:
    """Seconds of the reference per second of the video, smoothed; NaN where unmatched."""
    matched = np.isfinite(there_s)
    pace = np.full(len(there_s), np.nan)
    for run in np.split(np.arange(len(matched)), np.flatnonzero(np.diff(matched)) + 1):
        if matched[run[0]] and len(run) > 2:
            slope = np.gradient(there_s[run], here_s[run])
            pace[run] = gaussian_filter1d(slope, smooth_frames, mode="nearest")
    return pace


def uncertainty_s(confidence: Float[np.ndarray, " T"], reach_s: float) -> Float[np.ndarray, " T"]:
    """Standard deviation of a normal error that is within reach_s with this probability, in
    seconds, at most WIDEST_BAND_S."""
    sure = np.clip(np.nan_to_num(confidence), 1e-3, 1 - 1e-6)
    return np.minimum(reach_s / (np.sqrt(2) * erfinv(sure)), WIDEST_BAND_S)


def _seconds(video: VideoKeypoints) -> Float[np.ndarray, " T"]:
    """Time of each used frame since the first of them."""
    return np.asarray(np.arange(len(video.frames)) / video.fps)


def _seconds_there(sync_map: SyncMap, reference: VideoKeypoints) -> Float[np.ndarray, " T"]:
    """Time in the reference of each frame of a video, since the reference's first used frame."""
    return seconds_at(sync_map.reference_frame, _seconds(reference))
