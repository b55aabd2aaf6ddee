"""Warps as the mean over all monotone paths, refined against what the other videos agree on."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from imocap_core.params import SyncParams
from imocap_core.sync.pairwise.distance_matrix import Comparison
from imocap_core.sync.reference_anchors import Bend
from imocap_core.sync.warp.leave_one_out import squared_distances_to_others
from imocap_core.sync.warp.monotone import interpolated_squares, monotone_posterior
from imocap_core.sync.warp.positions import in_order, mass_within, median_positions
from imocap_core.sync.warp.reprojection import ReprojectionEvidence
from imocap_core.sync.warp.smooth_rate import rates_between, regular_posterior
from imocap_core.workers import at_once

Array = NDArray[np.float64]

SHARP_ROUNDS = 2  # the last refinements, against a template that errs less than two estimates
SHARPNESS = 3.0  # of their evidence
PICTURE_ROUNDS = 4
PICTURES_PER_S = 60.0  # a detector's errors persist far less than those of poses
SKIPPED_SHARE = 0.3  # a frame of the other video left over at an end, of what a matching pair costs


def _posterior(
    squares: Array,
    near: float,
    fps: float,
    fps_to: float,
    per_frame: int,
    settings: SyncParams,
    regularity: float,
) -> tuple[Array, Array]:
    """Soft map of one video into another from squared distances (n, S), and P(matched).

    The mean over all monotone warps, and, with weight `regularity`, over those of slowly changing
    rate: where frames were left out the first is right, where a performance went on the second.
    """
    looks = min(settings.evidence_per_s / fps, 4.0)
    known = np.isfinite(squares)
    mean = np.divide(
        np.where(known, squares, 0.0).sum(axis=1),
        known.sum(axis=1),
        out=np.zeros(len(squares)),
        where=known.any(axis=1),
    )
    cost = looks / near * np.where(known, squares, mean[:, None])
    unmatched = looks * (1.0 + 2.0 * settings.unmatched_level)
    usual = fps_to / fps * per_frame
    step = settings.max_rate * usual
    max_step = int(np.ceil(step)) if np.isfinite(step) else None
    maps, matched = monotone_posterior(cost, unmatched=unmatched, max_step=max_step)
    if regularity == 0:
        return maps, matched
    rates = rates_between(
        usual=usual,
        spread=settings.rate_spread,
        persistence_s=settings.rate_persistence_s,
        max_rate=settings.max_rate,
        fps=fps,
    )
    skipped = SKIPPED_SHARE * looks / usual
    even, even_matched, _ = regular_posterior(cost, rates, unmatched=unmatched, skipped=skipped)
    return (
        (1 - regularity) * maps + regularity * even,
        (1 - regularity) * matched + regularity * even_matched,
    )


def directed_maps(c: Comparison, fps: Sequence[float], settings: SyncParams) -> tuple[Array, Array]:
    """Soft maps between all videos at whole frames (N_a, N_a), own blocks the identity, and
    P(matched) (N_a, M)."""
    maps, matched = np.zeros_like(c.squares), np.ones((c.blocks.total, len(c.poses)))
    for i, rows in enumerate(map(c.blocks.rows, range(len(c.poses)))):
        for j in range(len(c.poses)):
            if i != j:
                block = np.asarray(c.blocks.block(c.squares, i, j))
                near = _typical(block, c)
                c.blocks.block(maps, i, j)[...], matched[rows, j] = _posterior(
                    block, near, fps[i], fps[j], 1, settings, settings.regularity
                )
    c.blocks.set_diagonal_to_identity(maps)
    return maps, matched


def _typical(squares: Array, c: Comparison) -> float:
    """The squared distance that matching frames of this pair typically have."""
    known = np.isfinite(squares).any(axis=1)
    near = float(np.median(np.nanmin(squares[known], axis=1))) if known.any() else c.near
    return max(near, c.floor, 1e-6 * c.near)


def _spread(maps: Array, per_frame: int) -> Array:
    """A row-stochastic map at whole frames (n, m) at per_frame positions a frame, linear between
    frames."""
    fine = interpolated_squares(maps, np.zeros(maps.shape[1] - 1), per_frame)
    return fine / np.maximum(fine.sum(axis=1, keepdims=True), 1e-300)


def posterior_warps(
    c: Comparison,
    relaxed: NDArray[np.floating],
    matched: Array,
    reference: int,
    fps: Sequence[float],
    settings: SyncParams,
    bend: Bend | None = None,
    pictures: ReprojectionEvidence | None = None,
) -> tuple[list[Array], list[Array]]:
    """Warps from the relaxed maps, refined `consensus_rounds` times against the other videos.

    `bend`: what the user's anchors do to squared distances. `pictures`: with them the last
    refinements hold detections against the others' motion, where these tell more than poses.
    """
    M, per_frame = len(c.poses), settings.positions_per_frame
    soft = [
        _spread(np.asarray(c.blocks.block(relaxed, v, reference), dtype=float), per_frame)
        for v in range(M)
    ]
    seen = [matched[c.blocks.rows(v), reference] for v in range(M)]
    usual = _refined_by_poses(soft, seen, c, reference, fps, settings, bend)
    if pictures is not None:
        for v in _seen_in_pictures(soft, pictures, reference, fps, settings, bend):
            usual[v] = soft[v]
    reach = settings.confidence_reach_s * fps[reference]
    frames, trust = [], []
    for v in range(M):
        position = median_positions(soft[v], per_frame)
        certain = mass_within(usual[v], position, reach, per_frame)
        position = in_order(np.where(seen[v] >= 0.5, position, np.nan), certain)
        frames.append(position)
        trust.append(np.where(np.isfinite(position), np.minimum(certain * seen[v], 1.0), 0.0))
    return frames, trust


def _refined_by_poses(
    soft: list[Array],
    seen: list[Array],
    c: Comparison,
    reference: int,
    fps: Sequence[float],
    settings: SyncParams,
    bend: Bend | None,
) -> list[Array]:
    """Refine the maps (T_v, S) and P(matched) (T_v,) by the poses of the other videos, in place.

    The last rounds believe the template more: it errs less than the two estimates for which the
    evidence is set. How sure a frame's place is stays a matter of the usual evidence: those maps
    are the answer.
    """
    per_frame = settings.positions_per_frame
    sharp = replace(settings, evidence_per_s=SHARPNESS * settings.evidence_per_s)
    usual = list(soft)
    plan = [settings] * settings.consensus_rounds
    plan += [sharp] * (SHARP_ROUNDS if plan else 0)
    # the first refinement aligns frame by frame; only then are orientations known well enough
    steady = [settings.orientation_window_s * f for f in fps]

    def told(v: int, squares: Array, by: SyncParams) -> tuple[Array, Array]:
        near = _typical(squares, c)
        bent = squares if bend is None else bend(v, squares, near, by.evidence_per_s)
        return _posterior(bent, near, fps[v], fps[reference], per_frame, by, 0.0)

    for round_, believed in enumerate(plan):
        counted = [
            None if v == reference else s * matched[:, None]
            for v, (s, matched) in enumerate(zip(soft, seen, strict=True))
        ]
        for v, squares in enumerate(
            squared_distances_to_others(
                c.poses, c.weights, counted, reference, per_frame, steady if round_ else None
            )
        ):
            if squares is None:
                continue
            usual[v], seen[v] = told(v, squares, settings)
            soft[v] = usual[v] if believed is settings else told(v, squares, believed)[0]
    return usual


def _seen_in_pictures(
    soft: list[Array],
    pictures: ReprojectionEvidence,
    reference: int,
    fps: Sequence[float],
    settings: SyncParams,
    bend: Bend | None,
) -> set[int]:
    """Refine the maps (T_v, S) by the pictures, in place; which frames are matched stays.

    The videos whose pictures told anything are the answer.
    """
    sharp = replace(settings, unmatched_level=np.inf, evidence_per_s=PICTURES_PER_S)
    per_frame = settings.positions_per_frame

    def refined(v: int, before: Sequence[Array]) -> Array | None:
        squares = pictures.squares(v, before, reference, per_frame)
        if squares is None:
            return None
        if bend is not None:
            squares = bend(v, squares, 1.0, PICTURES_PER_S)
        return _posterior(squares, 1.0, fps[v], fps[reference], per_frame, sharp, 0.0)[0]

    told: set[int] = set()
    others = [v for v in range(len(soft)) if v != reference]
    for _ in range(PICTURE_ROUNDS):
        found = at_once(partial(refined, before=tuple(soft)), others)
        for v, own in zip(others, found, strict=True):
            if own is not None:
                soft[v] = own
                told.add(v)
    return told
