"""Synchronisation errors, by the phase of the true motion.

Two frames of two videos correspond when their phases are equal. A position in the reference video
is given in its source frame numbers, fractional between frames.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise, permutations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

EQUAL_PHASE = 1e-6
"""Share of the whole phase range below which two phases count as equal."""


@dataclass(frozen=True)
class SyncErrors:
    """Per frame of one non-reference video (T,); NaN where either side has no counterpart."""

    frames: Array  # |matched - true| position in the reference video, source frames of it
    phase: Array  # |phase of the matched reference position - own phase| / phase_end
    matched: NDArray[np.bool_]  # the method names a counterpart
    has_truth: NDArray[np.bool_]  # the truth has one inside the reference clip
    same_frame: NDArray[np.bool_]  # ... and it falls on a frame: a ground-truth column


def sync_errors(
    matched_reference_frame: ArrayLike,
    phase: ArrayLike,
    reference_frames: ArrayLike,
    reference_phase: ArrayLike,
    phase_end: float,
) -> SyncErrors:
    """Compare a video's map into the reference with the phases of both.

    Args:
        matched_reference_frame: (T,) source frame of the reference, fractional; NaN unmatched.
        phase: (T,) true phase of the video's own frames.
        reference_frames, reference_phase: (T_ref,) the reference's used frames and their phases.
        phase_end: what phases are divided by (the last source frame, when phase counts frames).

    Raises:
        ValueError: shapes, a phase of the reference that falls, or phase_end not positive.
    """
    matched_at = np.asarray(matched_reference_frame, dtype=np.float64)
    own = np.asarray(phase, dtype=np.float64)
    frames, ref = _reference(reference_frames, reference_phase)
    if matched_at.shape != own.shape or own.ndim != 1:
        raise ValueError(
            f"the map and the phase must both be (T,): {matched_at.shape}, {own.shape}"
        )
    if not phase_end > 0:
        raise ValueError(f"phase_end must be positive, got {phase_end}")
    true_at = true_reference_frame(own, frames, ref)
    nearest = np.abs(own[:, None] - ref[None, :]).min(axis=1)
    matched_phase = np.interp(matched_at, frames, ref)  # NaN stays NaN
    has_truth = np.isfinite(true_at)
    return SyncErrors(
        frames=np.abs(matched_at - true_at),
        phase=np.where(has_truth, np.abs(matched_phase - own), np.nan) / phase_end,
        matched=np.isfinite(matched_at),
        has_truth=has_truth,
        same_frame=has_truth & (nearest <= EQUAL_PHASE * phase_end),
    )


def true_reference_frame(
    phase: ArrayLike, reference_frames: ArrayLike, reference_phase: ArrayLike
) -> Array:
    """Where each phase (T,) lies in the reference, in source frames; NaN outside its clip."""
    frames, ref = _reference(reference_frames, reference_phase)
    own = np.asarray(phase, dtype=np.float64)
    return np.interp(own, ref, frames, left=np.nan, right=np.nan)


def sync_error_pct(errors: SyncErrors) -> float:
    """Per cent of the whole phase, over all frames with a counterpart: the paper text's error."""
    return 100.0 * _mean(errors.phase)


def sync_error_released_pct(errors: SyncErrors) -> float:
    """The same over ground-truth columns alone, whose counterpart is a frame: the released code.

    NaN when no frame of the video shares a phase with a frame of the reference.
    """
    return 100.0 * _mean(errors.phase[errors.same_frame])


def sync_error_frames(errors: SyncErrors) -> float:
    """Mean error in frames of the reference video."""
    return _mean(errors.frames)


def sync_error_ms(errors: SyncErrors, reference_fps: float) -> float:
    """Mean error in milliseconds of the reference video's time."""
    return 1000.0 * sync_error_frames(errors) / reference_fps


def sync_median_error_frames(errors: SyncErrors) -> float:
    """Median error in frames: unmoved by a few frames that went astray."""
    seen = errors.frames[np.isfinite(errors.frames)]
    return float(np.median(seen)) if len(seen) else float("nan")


def offset_frames(matched_reference_frame: ArrayLike, frames: ArrayLike) -> float:
    """Recovered constant offset: median over frames of (reference frame - own frame).

    Means something for cameras that filmed one event at one rate. NaN when nothing is matched.
    """
    offset = np.asarray(matched_reference_frame, dtype=np.float64) - np.asarray(frames)
    offset = offset[np.isfinite(offset)]
    return float(np.median(offset)) if len(offset) else float("nan")


def is_offset(reference_frame: ArrayLike, frames: ArrayLike, within_frames: float = 0.5) -> bool:
    """Whether a map is one constant offset: no frame departs from the median one by more."""
    offset = np.asarray(reference_frame, dtype=np.float64) - np.asarray(frames)
    offset = offset[np.isfinite(offset)]
    return bool(len(offset) and np.abs(offset - np.median(offset)).max() <= within_frames)


def matched_share(errors: SyncErrors) -> float:
    """Share of the frames with a true counterpart that the method matches (recall)."""
    return _share(errors.matched, errors.has_truth)


def false_match_share(errors: SyncErrors) -> float:
    """Share of the frames without a true counterpart that the method matches all the same."""
    return _share(errors.matched, ~errors.has_truth)


def cycle_residual_frames(relaxed: ArrayLike, lengths: Sequence[int]) -> float:
    """How far frames land from where they started, after going round the videos; needs no truth.

    Each frame goes to its most alike frame of a second video, on to a third, and back (with two
    videos: there and back), by the strongest entry of each row.

    Args:
        relaxed: (N, N) affinity over the frames of all videos together. lengths: frames of each.

    Returns:
        Median over frames and cycles of |end - start|, in frames; NaN for a single video.
    """
    matrix = np.asarray(relaxed)
    if matrix.shape != (sum(lengths),) * 2:
        raise ValueError(f"relaxed must be ({sum(lengths)},) * 2 for {lengths}: {matrix.shape}")
    ends = np.cumsum(lengths)
    rows = [slice(end - length, end) for end, length in zip(ends, lengths, strict=True)]
    videos = range(len(lengths))
    step = {(i, j): matrix[rows[i], rows[j]].argmax(axis=1) for i, j in permutations(videos, 2)}
    round_trips = permutations(videos, 3) if len(lengths) > 2 else permutations(videos, 2)
    moved = []
    for first, second, *third in round_trips:
        at = step[first, second]
        for here, there in pairwise((second, *third, first)):
            at = step[here, there][at]
        moved.append(np.abs(at - np.arange(lengths[first])))
    return float(np.median(np.concatenate(moved))) if moved else float("nan")


def _reference(frames: ArrayLike, phase: ArrayLike) -> tuple[Array, Array]:
    numbers, phases = np.asarray(frames, dtype=np.float64), np.asarray(phase, dtype=np.float64)
    if numbers.shape != phases.shape or numbers.ndim != 1:
        raise ValueError(
            f"the reference's frames and phase must both be (T_ref,): {numbers.shape}, "
            f"{phases.shape}"
        )
    seen = np.isfinite(phases)
    numbers, phases = numbers[seen], phases[seen]
    falls = (np.diff(phases) < 0).any() or (
        np.diff(numbers) <= 0
    ).any()  # a repeated frame may stay
    if len(phases) < 2 or falls or phases[-1] <= phases[0]:
        raise ValueError("the reference needs two frames or more, and a phase that rises with them")
    return numbers, phases


def _mean(values: Array) -> float:
    seen = values[np.isfinite(values)]
    return float(seen.mean()) if len(seen) else float("nan")


def _share(chosen: NDArray[np.bool_], among: NDArray[np.bool_]) -> float:
    return float(chosen[among].mean()) if among.any() else float("nan")
