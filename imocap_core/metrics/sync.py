"""Synchronisation errors by the phase of the true motion, and the cycle residual.

Two frames of two videos correspond when their phases are equal. A position in the reference video
is given in its source frame numbers, fractional between frames.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise, permutations

import numpy as np
from jaxtyping import Bool, Float, Int, Real

EQUAL_PHASE = 1e-6
"""Share of the whole phase range below which two phases count as equal."""


@dataclass(frozen=True)
class SyncErrors:
    """Errors of each frame of one non-reference video; NaN where either side has no counterpart.

    Attributes:
        frames: |matched - true| position in the reference video, in its source frames.
        phase: |phase of the matched reference position - phase of the frame| / phase_end.
        matched: the method gives the frame a counterpart.
        has_truth: the truth has one inside the reference clip.
        same_frame: ... and it falls on a frame of the reference: a ground-truth column.
    """

    frames: Float[np.ndarray, " T"]
    phase: Float[np.ndarray, " T"]
    matched: Bool[np.ndarray, " T"]
    has_truth: Bool[np.ndarray, " T"]
    same_frame: Bool[np.ndarray, " T"]


def sync_errors(
    matched_reference_frame: Real[np.ndarray, " T"],
    phase: Real[np.ndarray, " T"],
    reference_frames: Real[np.ndarray, " T_ref"],
    reference_phase: Real[np.ndarray, " T_ref"],
    phase_end: float,
) -> SyncErrors:
    """Compare a video's map into the reference with the phases of both.

    Args:
        matched_reference_frame: source frame of the reference, fractional; NaN unmatched.
        phase: true phase of the video's frames.
        reference_frames, reference_phase: the reference's used frames and their phases.
        phase_end: what phases are divided by (the last source frame, when phase counts frames).

    Raises:
        ValueError: shapes, a phase of the reference that falls, or phase_end not positive.
    """
    matched_frame = np.asarray(matched_reference_frame, dtype=np.float64)
    phases = np.asarray(phase, dtype=np.float64)
    frames, ref = _reference(reference_frames, reference_phase)
    if matched_frame.shape != phases.shape or phases.ndim != 1:
        raise ValueError(
            f"the map and the phase must both be (T,): {matched_frame.shape}, {phases.shape}"
        )
    if not phase_end > 0:
        raise ValueError(f"phase_end must be positive, got {phase_end}")
    true_frame = true_reference_frame(phases, frames, ref)
    nearest = np.abs(phases[:, None] - ref[None, :]).min(axis=1)
    matched_phase = np.interp(matched_frame, frames, ref)  # NaN stays NaN
    has_truth = np.isfinite(true_frame)
    return SyncErrors(
        frames=np.abs(matched_frame - true_frame),
        phase=np.where(has_truth, np.abs(matched_phase - phases), np.nan) / phase_end,
        matched=np.isfinite(matched_frame),
        has_truth=has_truth,
        same_frame=has_truth & (nearest <= EQUAL_PHASE * phase_end),
    )


def true_reference_frame(
    phase: Real[np.ndarray, " T"],
    reference_frames: Real[np.ndarray, " T_ref"],
    reference_phase: Real[np.ndarray, " T_ref"],
) -> Float[np.ndarray, " T"]:
    """Position of each phase in the reference, in source frames; NaN outside its clip."""
    frames, ref = _reference(reference_frames, reference_phase)
    return np.interp(np.asarray(phase, dtype=np.float64), ref, frames, left=np.nan, right=np.nan)


def sync_error_pct(errors: SyncErrors) -> float:
    """Per cent of the whole phase, over all frames with a counterpart: the paper text's error."""
    return 100.0 * _mean(errors.phase)


def sync_error_released_pct(errors: SyncErrors) -> float:
    """The same over ground-truth columns, whose counterpart is a frame: the released code's error.

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
    """Median error in frames: robust to a few frames that are far off."""
    valid = errors.frames[np.isfinite(errors.frames)]
    return float(np.median(valid)) if len(valid) else float("nan")


def offset_frames(
    matched_reference_frame: Real[np.ndarray, " T"], frames: Real[np.ndarray, " T"]
) -> float:
    """Recovered constant offset: median over frames of (reference frame - the video's frame).

    Meaningful for cameras that filmed one event at one rate. NaN when nothing is matched.
    """
    offset = np.asarray(matched_reference_frame, dtype=np.float64) - np.asarray(frames)
    offset = offset[np.isfinite(offset)]
    return float(np.median(offset)) if len(offset) else float("nan")


def is_offset(reference_frame: Real[np.ndarray, " T"], frames: Real[np.ndarray, " T"]) -> bool:
    """Whether a map is one constant offset: every frame's within half a frame of the median."""
    offset = np.asarray(reference_frame, dtype=np.float64) - np.asarray(frames)
    offset = offset[np.isfinite(offset)]
    return bool(len(offset) and np.abs(offset - np.median(offset)).max() <= 0.5)


def matched_share(errors: SyncErrors) -> float:
    """Share of the frames with a true counterpart that the method matches (recall)."""
    return _share(errors.matched, errors.has_truth)


def false_match_share(errors: SyncErrors) -> float:
    """Share of the frames without a true counterpart that the method matches nevertheless."""
    return _share(errors.matched, ~errors.has_truth)


def cycle_residual_frames(nearest: Mapping[tuple[int, int], Int[np.ndarray, "_T"]]) -> float:
    """Cycle residual: distance of a frame's image from the frame itself after a cycle of videos.

    Needs no truth. Each frame is mapped to the most similar frame of a second video, of a third,
    and back (with two videos: there and back).

    Args:
        nearest: [i, j]: the most similar frame of video j for each frame of video i, of all i != j.

    Returns:
        Median over frames and cycles of |end - start|, in frames; NaN for a single video.
    """
    videos = sorted({i for i, _ in nearest})
    round_trips = permutations(videos, 3) if len(videos) > 2 else permutations(videos, 2)
    moved = []
    for first, second, *third in round_trips:
        frame = nearest[first, second]
        for here, there in pairwise((second, *third, first)):
            frame = nearest[here, there][frame]
        moved.append(np.abs(frame - np.arange(len(frame))))
    return float(np.median(np.concatenate(moved))) if moved else float("nan")


def _reference(frames: np.ndarray, phase: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The reference's frames and phases without NaN; ValueError unless the phase rises."""
    numbers, phases = np.asarray(frames, dtype=np.float64), np.asarray(phase, dtype=np.float64)
    if numbers.shape != phases.shape or numbers.ndim != 1:
        raise ValueError(
            f"the reference's frames and phase must both be (T_ref,): {numbers.shape}, "
            f"{phases.shape}"
        )
    valid = np.isfinite(phases)
    numbers, phases = numbers[valid], phases[valid]
    # a repeated frame (equal phases) is allowed
    falls = (np.diff(phases) < 0).any() or (np.diff(numbers) <= 0).any()
    if len(phases) < 2 or falls or phases[-1] <= phases[0]:
        raise ValueError("the reference needs two frames or more, and a phase that rises with them")
    return numbers, phases


def _mean(values: np.ndarray) -> float:
    valid = values[np.isfinite(values)]
    return float(valid.mean()) if len(valid) else float("nan")


def _share(chosen: np.ndarray, among: np.ndarray) -> float:
    return float(chosen[among].mean()) if among.any() else float("nan")
