"""Maps to the reference averaged over several time axes.

Refined maps lead to one video, the axis, and carry that video's own errors: with another axis all
positions are others, although the videos are the same. Each axis also places every two other videos
in relation to each other. The mean over the axes of where a frame of one video lies in another errs
less than any of them, and depends little on which video is the reference.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float, Int

from imocap_core.robust import geman_mcclure_weight
from imocap_core.sync.phase import inside
from imocap_core.sync.warp.positions import isotonic

MOST_AXES = 4  # each costs as much as the first


def axes_of(
    reference: int, centralities: Float[np.ndarray, " M"], most: int = MOST_AXES
) -> list[int]:
    """The reference, then the most central other videos: indices of the axes to average over."""
    others = [int(v) for v in np.argsort(-centralities, kind="stable") if v != reference]
    return [reference, *others[: most - 1]]


def averaged_over_axes(
    maps_to_axes: Mapping[int, Sequence[Float[np.ndarray, "_T"]]],
    reference: int,
    lengths: Sequence[int],
    reach_frames: float,
) -> list[Float[np.ndarray, "_T"]]:
    """Per video the mean position in the reference over all axes; non-decreasing.

    A frame that its map to the reference leaves unmatched stays so; an axis on which it or its
    counterpart is not matched, or lies at an end, does not count.

    Args:
        maps_to_axes: per axis, the reference among them, positions of all videos' frames in it,
            NaN unmatched.
        lengths: frames of the videos.
        reach_frames: of the reference; a position farther than this from that of the map to the
            reference counts less and less: it may be of another repetition.
    """
    direct = maps_to_axes[reference]
    averaged = []
    for v, position in enumerate(direct):
        if v == reference:
            averaged.append(np.arange(float(lengths[v])))
            continue
        rows = [position]
        for axis, maps in maps_to_axes.items():
            if axis != reference:
                on_axis = np.arange(float(lengths[v])) if v == axis else maps[v]
                usable = v == axis or inside(on_axis, lengths[axis])
                through = inverted(maps[reference], on_axis)
                rows.append(np.where(usable, through, np.nan))
        averaged.append(_mean(np.stack(rows), reach_frames))
    return averaged


def inverted(
    positions: Float[np.ndarray, " T"], targets: Float[np.ndarray, " N"]
) -> Float[np.ndarray, " N"]:
    """Frames, fractional, that a non-decreasing map takes to the targets; NaN outside its range.

    Of several frames at one position, their mean.
    """
    frames = np.flatnonzero(np.isfinite(positions))
    if not len(frames):
        return np.full(len(targets), np.nan)
    values, place = np.unique(np.maximum.accumulate(positions[frames]), return_inverse=True)
    middle = _means_of_groups(frames.astype(float), place, len(values))
    return np.interp(targets, values, middle, left=np.nan, right=np.nan)


def _means_of_groups(
    values: Float[np.ndarray, " N"], group: Int[np.ndarray, " N"], count: int
) -> Float[np.ndarray, " G"]:
    return np.bincount(group, values, count) / np.bincount(group, minlength=count)


def _mean(rows: Float[np.ndarray, "A T"], reach_frames: float) -> Float[np.ndarray, " T"]:
    """Robust mean about the first row where that is finite, made non-decreasing; else NaN."""
    weight = np.nan_to_num(geman_mcclure_weight(np.abs(rows - rows[0]), reach_frames))
    total = weight.sum(axis=0)
    mean = (weight * np.nan_to_num(rows)).sum(axis=0) / np.maximum(total, 1e-12)
    return isotonic(np.where(np.isfinite(rows[0]), mean, np.nan), total)
