"""Joint synchronisation of videos that all show the action: from poses to warps (section 3.1).

Distances of all pairs of frames -> soft maps -> reference -> cycle consistency -> maps to the
reference, averaged over several axes -> common time axis.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float32

from imocap_core.params import SyncParams
from imocap_core.sync.anchors import Hints, anchored_distances
from imocap_core.sync.axis_refinement import AxisChoice, refined_over_axes
from imocap_core.sync.confidence import Route, calibrated_confidence
from imocap_core.sync.cycle.methods import relax
from imocap_core.sync.cycle.report import CycleReport
from imocap_core.sync.map_consistency import (
    CycleResidual,
    PairMaps,
    cycle_residuals,
    left_out_disagreement,
    pair_maps,
)
from imocap_core.sync.pairwise.affinity import gaussian_affinity, reciprocal_affinity
from imocap_core.sync.pairwise.distance_matrix import DistanceMatrix, distance_matrix
from imocap_core.sync.phase import WeightedMap, common_phase, inside
from imocap_core.sync.reference import central_and_covering, centrality, coverage
from imocap_core.sync.reference_anchors import hard_anchor_maps, through_hard_anchors
from imocap_core.sync.refinement import ReferenceAxis
from imocap_core.sync.repeated_motion import Repetition, next_repetition
from imocap_core.sync.warp.clocks import Clocks
from imocap_core.sync.warp.dtw_paths import dtw_warps
from imocap_core.sync.warp.reprojection import ReprojectionEvidence
from imocap_core.sync.warp.soft_maps import pairwise_soft_maps

AFFINITIES = {"reciprocal": reciprocal_affinity, "gaussian": gaussian_affinity}
WARPS = ("posterior", "dtw")
# The refined map to the reference against one map between two videos, which carries the noise of
# two single estimates.
REFINED_WEIGHT = 8.0


@dataclass(frozen=True)
class JointResult:
    """Position of every frame of every video in the reference video, with confidences.

    Attributes:
        reference: index of the reference video.
        reference_frame: per video, fractional index into the reference; NaN unmatched.
        confidence: per video, in [0, 1].
        phase: per video, seconds of the reference on the common time axis.
        affinity: Eq. 1, all frames of all videos.
        relaxed: after cycle consistency (Eq. 2), row-stochastic per block.
        centrality: of each video; by it and by coverage the reference was chosen, unless given.
        matched_square: squared distance typical of matching frames.
        cycle: outcome of the cycle-consistency method.
        cycle_residuals: of the pairwise maps, for every three videos.
        left_out_frames: distance of each video's map to the reference from the maps through the
            others.
        left_out_share: of the frames that both match.
        repetitions: per video, of its map to the reference the one shifted by a repetition that
            fits best; None where the motion does not repeat.
    """

    reference: int
    reference_frame: list[Float[np.ndarray, "_T"]]
    confidence: list[Float[np.ndarray, "_T"]]
    phase: list[Float[np.ndarray, "_T"]]
    affinity: Float32[np.ndarray, "N_a N_a"]
    relaxed: Float32[np.ndarray, "N_a N_a"]
    centrality: Float[np.ndarray, " M"]
    matched_square: float
    cycle: CycleReport
    cycle_residuals: list[CycleResidual]
    left_out_frames: Float[np.ndarray, " M"]
    left_out_share: Float[np.ndarray, " M"]
    repetitions: list[Repetition | None]


def synchronise_jointly(
    poses: Sequence[Float[np.ndarray, "_T J 3"]],
    *,
    fps: Sequence[float],
    rates: Float[np.ndarray, " M"],
    params: SyncParams,
    rng: np.random.Generator,
    confidence: Sequence[Float[np.ndarray, "_T J"]] | None,
    joint_weights: Float[np.ndarray, " J"] | None,
    reference: int | None,
    eligible: Sequence[bool],
    hints: Hints,
    reprojection: ReprojectionEvidence | None = None,
) -> JointResult:
    """Synchronise every video with the others; arguments as of `synchronise`.

    Args:
        rates: seconds of the action per second of each video (`playback_rates`).
        eligible: the videos to choose the reference from, if any of them is.
    """
    _check(params)
    clocks = Clocks(fps, rates)
    clock = clocks.action_fps
    lengths, forbidden = [len(x) for x in poses], hints.forbidden_frames([len(x) for x in poses])
    distances = distance_matrix(poses, confidence, joint_weights, clock, params)
    distances = anchored_distances(distances, hints, clock, params.evidence_per_s)
    blocks = distances.blocks
    affinity = _affinity(distances, params)
    soft_maps, matched = pairwise_soft_maps(distances, clocks, params)
    centralities = centrality(distances, soft_maps, matched)
    chosen = reference
    if chosen is None:
        chosen = central_and_covering(centralities, coverage(matched, blocks), eligible)

    evidence = soft_maps if params.warp == "posterior" else affinity
    relaxed, report = relax(params.method, evidence, blocks, rounds=params.rounds, rng=rng)
    pairs = pair_maps(soft_maps, matched, blocks, clock, params.confidence_reach_s)
    if params.warp == "posterior":
        choice = AxisChoice(clocks, hints, pairs, chosen, centralities)
        frames, masses, axis = refined_over_axes(
            choice, distances, relaxed, matched, params, reprojection
        )
        repetitions = _repetitions(frames, distances, chosen, clock[chosen])
        certainty = _confidences(frames, masses, axis, distances, pairs, repetitions)
    else:
        frames, certainty = dtw_warps(relaxed, soft_maps, blocks, chosen, fps, params)
        repetitions = _repetitions(frames, distances, chosen, clock[chosen])
    frames[chosen] = np.arange(float(lengths[chosen]))
    certainty[chosen] = np.ones(lengths[chosen])
    frames, certainty = _without_forbidden(frames, certainty, forbidden, chosen)
    frames, certainty = through_hard_anchors(frames, certainty, hints, chosen)

    pairs = _pairs_without_forbidden(pairs, forbidden)
    maps = _maps_to_solve(pairs, frames, certainty, lengths, chosen)
    maps += hard_anchor_maps(hints.anchors, lengths)
    per_second = [c * rates[chosen] for c in clock]  # frames per second of the reference
    phase = common_phase(per_second, lengths, chosen, maps)
    left_out, share = left_out_disagreement(pairs, lengths, chosen)
    return JointResult(
        reference=chosen,
        reference_frame=frames,
        confidence=certainty,
        phase=[np.where(f, np.nan, p) for f, p in zip(forbidden, phase, strict=True)],
        affinity=affinity.astype(np.float32),
        relaxed=relaxed.astype(np.float32),
        centrality=centralities,
        matched_square=distances.matched_square,
        cycle=report,
        cycle_residuals=cycle_residuals(pairs, lengths, fps),
        left_out_frames=left_out,
        left_out_share=share,
        repetitions=repetitions,
    )


def _repetitions(
    frames: Sequence[np.ndarray], distances: DistanceMatrix, reference: int, fps: float
) -> list[Repetition | None]:
    """Of every video; fps: of the reference, in the action's time."""
    out: list[Repetition | None] = []
    for v, position in enumerate(frames):
        matched = np.isfinite(position) & (v != reference)
        square = distances.block(v, reference)
        out.append(next_repetition(square, np.nan_to_num(position), matched, fps))
    return out


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


def _affinity(distances: DistanceMatrix, params: SyncParams) -> np.ndarray:
    """Eq. 1: affinities (N_a, N_a) of all pairs of frames; within a video the identity."""
    scale = np.sqrt(distances.matched_square)
    affinity = AFFINITIES[params.affinity](np.sqrt(distances.squares), scale)
    distances.blocks.set_diagonal_to_identity(affinity)
    return affinity


def _check(params: SyncParams) -> None:
    if params.warp not in WARPS:
        raise ValueError(f"warp: expected posterior or dtw, got {params.warp!r}")
    if params.affinity not in AFFINITIES:
        raise ValueError(f"affinity: expected reciprocal or gaussian, got {params.affinity!r}")


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
