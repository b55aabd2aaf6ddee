"""The synchronisation proper, of videos that all show the action: from poses to warps."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imocap_core.params import SyncParams
from imocap_core.sync.anchors import Hints, bent_comparison
from imocap_core.sync.cycle.methods import relax, relax_auto
from imocap_core.sync.cycle.report import CycleReport
from imocap_core.sync.map_consistency import (
    PairMaps,
    Triple,
    cycle_residuals,
    left_out_disagreement,
    pair_maps,
)
from imocap_core.sync.pairwise.affinity import gaussian_affinity, reciprocal_affinity
from imocap_core.sync.pairwise.distance_matrix import centrality_of, compare
from imocap_core.sync.phase import Link, common_phase, inside
from imocap_core.sync.reference_anchors import (
    bend_of,
    firm_links,
    through_hard_anchors,
    ties_to_reference,
)
from imocap_core.sync.warp.dtw_paths import dtw_warps
from imocap_core.sync.warp.posterior import directed_maps, posterior_warps
from imocap_core.sync.warp.reprojection import ReprojectionEvidence

Array = NDArray[np.float64]

# The refined map to the reference against one map between two videos, which carries the noise of
# two single estimates.
REFINED_WEIGHT = 8.0


@dataclass(frozen=True)
class Joint:
    """What the videos say together; fields as in `SyncResult`."""

    reference: int
    reference_frame: list[Array]
    confidence: list[Array]
    phase: list[Array]
    affinity: NDArray[np.float32]
    relaxed: NDArray[np.float32]
    centrality: Array
    matched_square: float
    cycle: CycleReport
    triples: list[Triple]
    left_out_frames: Array
    left_out_share: Array


def synchronise_jointly(
    poses: Sequence[Array],
    *,
    fps: Sequence[float],
    settings: SyncParams,
    rng: np.random.Generator,
    confidence: Sequence[Array] | None,
    joint_weights: Array | None,
    reference: int | None,
    eligible: Sequence[bool],
    hints: Hints,
    pictures: ReprojectionEvidence | None = None,
) -> Joint:
    """Every video against the others; arguments as of `synchronise`.

    `eligible`: the videos to choose the reference from, when one of them is any.
    """
    lengths = [len(x) for x in poses]
    if settings.warp not in ("posterior", "dtw"):
        raise ValueError(f"warp: expected posterior or dtw, got {settings.warp!r}")
    to_affinity = {"reciprocal": reciprocal_affinity, "gaussian": gaussian_affinity}
    if settings.affinity not in to_affinity:
        raise ValueError(f"affinity: expected reciprocal or gaussian, got {settings.affinity!r}")
    c = compare(poses, confidence, joint_weights, fps, settings)
    c = bent_comparison(c, hints, fps, settings.evidence_per_s)
    affinity = to_affinity[settings.affinity](np.sqrt(c.squares), np.sqrt(c.near))
    c.blocks.set_diagonal_to_identity(affinity)

    maps, matched = directed_maps(c, fps, settings)
    centrality = centrality_of(c, maps, matched)
    able = np.where(eligible, centrality, -1.0) if any(eligible) else centrality
    chosen = int(np.argmax(able)) if reference is None else reference
    evidence = maps if settings.warp == "posterior" else affinity
    if settings.method == "auto":
        relaxed, report = relax_auto(evidence, c.blocks, rounds=settings.rounds, rng=rng)
    else:
        relaxed, report = relax(
            settings.method, evidence, c.blocks, rounds=settings.rounds, rng=rng
        )
    pairs = pair_maps(maps, matched, c.blocks, fps, settings.confidence_reach_s)
    if settings.warp == "posterior":
        ties = ties_to_reference(hints, pairs, len(poses), chosen)
        bend = bend_of(ties, fps, chosen, settings.positions_per_frame)
        frames, trust = posterior_warps(c, relaxed, matched, chosen, fps, settings, bend, pictures)
    else:
        frames, trust = dtw_warps(c, relaxed, maps, chosen, fps, settings)
    frames[chosen], trust[chosen] = np.arange(float(lengths[chosen])), np.ones(lengths[chosen])
    forbidden = hints.forbids(lengths)
    frames, trust = _obeyed(frames, trust, forbidden, chosen)
    frames, trust = through_hard_anchors(frames, trust, hints, chosen)
    pairs = _pairs_obeyed(pairs, forbidden)
    phase = _phase(pairs, frames, trust, fps, lengths, chosen, hints)
    left_out, share = left_out_disagreement(pairs, lengths, chosen)
    return Joint(
        reference=chosen,
        reference_frame=frames,
        confidence=trust,
        phase=[np.where(f, np.nan, p) for f, p in zip(forbidden, phase, strict=True)],
        affinity=affinity.astype(np.float32),
        relaxed=relaxed.astype(np.float32),
        centrality=centrality,
        matched_square=c.near,
        cycle=report,
        triples=cycle_residuals(pairs, lengths, fps),
        left_out_frames=left_out,
        left_out_share=share,
    )


def _phase(
    pairs: PairMaps,
    frames: Sequence[Array],
    trust: Sequence[Array],
    fps: Sequence[float],
    lengths: Sequence[int],
    reference: int,
    hints: Hints,
) -> list[Array]:
    """The common time axis from all pairwise maps and the refined maps to the reference."""
    links = [
        Link(i, j, at, pairs.confidence[i, j] * inside(at, lengths[j]))
        for (i, j), at in pairs.positions.items()
    ]
    links += [
        Link(
            v,
            reference,
            frames[v],
            REFINED_WEIGHT * trust[v] * inside(frames[v], lengths[reference]),
        )
        for v in range(len(lengths))
        if v != reference
    ]
    return common_phase(fps, lengths, reference, links + firm_links(hints.anchors, lengths))


def _obeyed(
    frames: list[Array], trust: list[Array], forbidden: list[NDArray[np.bool_]], reference: int
) -> tuple[list[Array], list[Array]]:
    """Forbidden frames match nothing, and nothing matches forbidden frames of the reference, which
    keep their own number with confidence 0."""
    out, sure = list(frames), list(trust)
    for v, at in enumerate(frames):
        sure[v] = np.where(forbidden[v] | _into(at, forbidden[reference]), 0.0, trust[v])
        if v != reference:
            out[v] = np.where(forbidden[v] | _into(at, forbidden[reference]), np.nan, at)
    return out, sure


def _pairs_obeyed(pairs: PairMaps, forbidden: list[NDArray[np.bool_]]) -> PairMaps:
    positions, confidence = {}, {}
    for (i, j), at in pairs.positions.items():
        no = forbidden[i] | _into(at, forbidden[j])
        positions[i, j] = np.where(no, np.nan, at)
        confidence[i, j] = np.where(no, 0.0, pairs.confidence[i, j])
    return PairMaps(positions, confidence)


def _into(positions: Array, forbidden: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Which positions (T,) fall on forbidden frames."""
    nearest = np.clip(np.rint(np.nan_to_num(positions)).astype(int), 0, len(forbidden) - 1)
    return np.asarray(np.isfinite(positions) & forbidden[nearest])
