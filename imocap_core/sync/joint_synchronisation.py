"""Joint synchronisation of videos that all show the action: from poses to warps (section 3.1).

Distances of all pairs of frames -> soft maps -> reference -> cycle consistency -> maps to the
reference, averaged over several axes -> common time axis.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from imocap_core.params import SyncParams
from imocap_core.sync.affinity import (
    Affinities,
    DistanceMatrix,
    affinities,
    affinity_matrix,
    distance_matrix,
)
from imocap_core.sync.anchors import anchored_distances
from imocap_core.sync.axes import AxisChoice, ReferenceAxis, refined_over_axes
from imocap_core.sync.confidence import (
    SLACK_S,
    Repetition,
    Route,
    calibrated_confidence,
    next_repetition,
    repeats,
)
from imocap_core.sync.cycle import CycleReport, relax
from imocap_core.sync.evidence import SyncEvidence
from imocap_core.sync.maps import BlockMaps
from imocap_core.sync.reference import (
    chosen_reference,
    compared_pairs,
    hard_anchor_maps,
    hubs_of,
    through_hard_anchors,
)
from imocap_core.sync.screening.screening import Screening, not_screened
from imocap_core.sync.time_axis import (
    CycleResidual,
    PairMaps,
    WeightedMap,
    common_phase,
    cycle_residuals,
    inside,
    left_out_disagreement,
    pace_spread,
    shown_motion,
)
from imocap_core.sync.warp.dtw import dtw_warps
from imocap_core.sync.warp.soft_maps import Clocks

# The refined map to the reference against one map between two videos, which carries the noise of
# two single estimates.
REFINED_WEIGHT = 8.0
COMPARED_FRAMES = 1000  # of one video with itself


@dataclass(frozen=True)
class SyncResult:
    """Position of every frame of every video in the reference video, with confidences.

    Attributes:
        reference: index of the reference video.
        reference_frame: per video, fractional index into the reference; NaN unmatched.
        confidence: per video, in [0, 1].
        phase: per video, seconds of the reference on the common time axis.
        phase_confidence: per video, in [0, 1], that another video shows the same moment.
        affinity: Eq. 1, for pictures.
        relaxed: after cycle consistency (Eq. 2), row-stochastic per block.
        centrality: of each video, by which the reference was chosen, among others, unless given.
        matched_square: squared distance typical of matching frames.
        cycle: outcome of the cycle-consistency method.
        cycle_residuals: of the pairwise maps, for every three videos.
        left_out_frames: distance of each video's map to the reference from the maps through the
            others.
        left_out_share: of the frames that both match.
        repetitions: per video, of its map to the reference the one shifted by a repetition that
            fits best; None where the motion does not repeat.
        status: one sentence; screening: mirrored and excluded videos.

    An excluded video is unmatched throughout: NaN, confidence 0, no phase, no affinity or map.
    """

    reference: int
    reference_frame: list[Float[np.ndarray, "_T"]]
    confidence: list[Float[np.ndarray, "_T"]]
    phase: list[Float[np.ndarray, "_T"]]
    phase_confidence: list[Float[np.ndarray, "_T"]]
    affinity: Affinities
    relaxed: BlockMaps
    centrality: Float[np.ndarray, " M"]
    matched_square: float
    cycle: CycleReport
    cycle_residuals: list[CycleResidual]
    left_out_frames: Float[np.ndarray, " M"]
    left_out_share: Float[np.ndarray, " M"]
    repetitions: list[Repetition | None]
    status: str
    screening: Screening


def synchronise_jointly(
    videos: SyncEvidence, params: SyncParams, rng: np.random.Generator, eligible: Sequence[bool]
) -> SyncResult:
    """Synchronise every video with the others.

    Args:
        videos: that all show the action, upright and with their rates.
        eligible: the videos to choose the reference from, if any of them is.
    """
    assert videos.rates is not None
    fps, rates, hints = videos.fps, videos.rates, videos.hints
    clocks = Clocks(fps, rates)
    clock = clocks.action_fps
    lengths, forbidden = videos.lengths, hints.forbidden_frames(videos.lengths)
    distances = distance_matrix(
        videos.poses,
        videos.confidence,
        clock,
        params,
        heights=videos.heights,
        whole=bool(hints.anchors),
    )
    distances = anchored_distances(distances, hints, clock, params.evidence_per_s)
    affinity = affinities(distances)
    hubs = hubs_of(distances, eligible, videos.reference)
    compared = compared_pairs(distances, clocks, params, hubs)
    matched, pairs, centralities = compared.matched, compared.pairs, compared.centralities
    of_hubs = np.where(np.isin(np.arange(len(lengths)), hubs), centralities, -1.0)
    chosen = videos.reference
    if chosen is None:
        spread = pace_spread(pairs, lengths, clocks)
        shown = shown_motion(pairs, distances.moving, clocks)
        chosen = chosen_reference(of_hubs, spread, shown, eligible)

    evidence = compared.soft_maps
    if params.warp == "dtw":
        evidence = BlockMaps.of(affinity_matrix(distances), distances.blocks)
    distances = distances.with_squares_of(chosen)
    relaxed, report = relax(params.method, evidence, rounds=params.rounds, rng=rng)
    if params.warp == "posterior":
        del evidence, compared  # their memory is needed
        choice = AxisChoice(clocks, hints, pairs, chosen, of_hubs)
        frames, masses, axis = refined_over_axes(
            choice, distances, relaxed, matched, params, videos.reprojection
        )
        repetitions = _repetitions(frames, distances, chosen, clock)
        certainty = _confidences(frames, masses, axis, distances, pairs, repetitions)
    else:
        frames, certainty = dtw_warps(relaxed, compared.soft_maps, chosen, fps, params)
        repetitions = _repetitions(frames, distances, chosen, clock)
    frames[chosen], certainty[chosen] = np.arange(float(lengths[chosen])), np.ones(lengths[chosen])
    frames, certainty = _without_forbidden(frames, certainty, forbidden, chosen)
    frames, certainty = through_hard_anchors(frames, certainty, hints, chosen)

    pairs = _pairs_without_forbidden(pairs, forbidden)
    maps = _maps_to_solve(pairs, frames, certainty, lengths, chosen)
    maps += hard_anchor_maps(hints.anchors, lengths)
    phase = common_phase([c * rates[chosen] for c in clock], lengths, chosen, maps)
    left_out, share = left_out_disagreement(pairs, lengths, chosen)
    return SyncResult(
        reference=chosen,
        reference_frame=frames,
        confidence=certainty,
        phase=[np.where(f, np.nan, p) for f, p in zip(forbidden, phase, strict=True)],
        phase_confidence=_phase_confidence(pairs, lengths),
        affinity=affinity,
        relaxed=relaxed,
        centrality=centralities,
        matched_square=distances.matched_square,
        cycle=report,
        cycle_residuals=cycle_residuals(pairs, lengths, fps),
        left_out_frames=left_out,
        left_out_share=share,
        repetitions=repetitions,
        status=_status(frames, certainty, chosen, report),
        screening=not_screened(len(lengths)),
    )


def _status(
    frames: Sequence[np.ndarray],
    certainty: Sequence[np.ndarray],
    reference: int,
    cycle: CycleReport,
) -> str:
    """One sentence: share of matched frames, mean confidence, cycle consistency."""
    others = [v for v in range(len(frames)) if v != reference]
    if not others:
        return "one video: nothing to synchronise"
    share = np.mean(np.concatenate([np.isfinite(frames[v]) for v in others]))
    certain = np.mean(np.concatenate([certainty[v] for v in others]))
    return (
        f"{100 * share:.0f} % of the frames matched, mean confidence {certain:.2f}; {cycle.status}"
    )


def _repetitions(
    frames: Sequence[np.ndarray], distances: DistanceMatrix, reference: int, fps: Sequence[float]
) -> list[Repetition | None]:
    """Of every video, where it or the reference shows two cycles; fps: in the action's time."""
    out: list[Repetition | None] = []
    for v, position in enumerate(frames):
        n, matched = distances.stride(v, reference), np.isfinite(position) & (v != reference)
        square, there = distances.block(v, reference), np.nan_to_num(position)[::n] / n
        repetition = next_repetition(square, there, matched[::n], fps[reference] / n)
        if repetition is not None:
            period_s = abs(repetition.shift_frames) * n / fps[reference]
            if not any(_shows_cycles(u, period_s, distances, fps[u]) for u in (reference, v)):
                repetition = None
        out.append(repetition and replace(repetition, shift_frames=n * repetition.shift_frames))
    return out


def _shows_cycles(v: int, period_s: float, distances: DistanceMatrix, fps: float) -> bool:
    """Whether a video shows two cycles of about that period, by every n-th frame of a long one."""
    every = slice(None, None, max(1, len(distances.poses[v]) // COMPARED_FRAMES))
    squares = distances.compared.squares(v, v, every, every)
    rate = fps / every.step
    return repeats(squares, period_s * rate, SLACK_S * rate)


def _confidences(
    frames: Sequence[np.ndarray],
    masses: Sequence[np.ndarray],
    axis: ReferenceAxis,
    distances: DistanceMatrix,
    pairs: PairMaps,
    repetitions: Sequence[Repetition | None],
) -> list[np.ndarray]:
    """Calibrated confidences of every video's matches; the reference's mass as it is."""
    clock, chosen = axis.clocks.action_fps, axis.reference

    def route(v: int) -> Route:
        ends = (clock[v], clock[chosen], axis.reach_frames)
        return Route(v, chosen, frames[v], masses[v], *ends, repetitions[v])

    return [
        mass if v == chosen else calibrated_confidence(route(v), distances, pairs)
        for v, mass in enumerate(masses)
    ]


def _phase_confidence(pairs: PairMaps, lengths: Sequence[int]) -> list[Float[np.ndarray, "_T"]]:
    """Per video, the highest confidence of its maps to the others, not at their ends: what is
    matched there may lie beyond them."""
    highest = [np.zeros(length) for length in lengths]
    for (i, j), position in pairs.positions.items():
        shown = np.isfinite(position) & inside(position, lengths[j])
        highest[i] = np.maximum(highest[i], np.where(shown, pairs.confidence[i, j], 0.0))
    return highest


def _maps_to_solve(
    pairs: PairMaps,
    frames: Sequence[np.ndarray],
    certainty: Sequence[np.ndarray],
    lengths: Sequence[int],
    reference: int,
) -> list[WeightedMap]:
    """The equations of the common time axis: all pairwise maps, and the refined maps to the
    reference."""
    maps = [
        WeightedMap(i, j, position, pairs.confidence[i, j] * inside(position, lengths[j]))
        for (i, j), position in pairs.positions.items()
    ]
    for v in range(len(lengths)):
        if v != reference:
            valid = inside(frames[v], lengths[reference])
            weights = REFINED_WEIGHT * certainty[v] * valid
            maps.append(WeightedMap(v, reference, frames[v], weights))
    return maps


def _without_forbidden(
    frames: list[np.ndarray],
    certainty: list[np.ndarray],
    forbidden: list[np.ndarray],
    reference: int,
) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Forbidden frames match nothing, and nothing matches forbidden frames of the reference, which
    keep their own number with confidence 0."""
    positions, confidence = list(frames), list(certainty)
    for v, position in enumerate(frames):
        unmatched = forbidden[v] | _into(position, forbidden[reference])
        confidence[v] = np.where(unmatched, 0.0, certainty[v])
        if v != reference:
            positions[v] = np.where(unmatched, np.nan, position)
    return positions, confidence


def _pairs_without_forbidden(pairs: PairMaps, forbidden: list[np.ndarray]) -> PairMaps:
    """The pairwise maps without those from or to forbidden frames."""
    positions, confidence = {}, {}
    for (i, j), position in pairs.positions.items():
        unmatched = forbidden[i] | _into(position, forbidden[j])
        positions[i, j] = np.where(unmatched, np.nan, position)
        confidence[i, j] = np.where(unmatched, 0.0, pairs.confidence[i, j])
    return PairMaps(positions, confidence)


def _into(
    positions: Float[np.ndarray, " T"], forbidden: Bool[np.ndarray, " S"]
) -> Bool[np.ndarray, " T"]:
    """Which positions fall on forbidden frames."""
    nearest = np.clip(np.rint(np.nan_to_num(positions)).astype(int), 0, len(forbidden) - 1)
    return np.asarray(np.isfinite(positions) & forbidden[nearest])
