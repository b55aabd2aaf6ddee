"""Synchronisation of videos by the 3D poses seen in them (section 3.1), from poses to warps."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imocap_core.sync.affinity import gaussian_affinity, procrustes_distances, reciprocal_affinity
from imocap_core.sync.blocks import Blocks
from imocap_core.sync.consensus import squared_distances_to_others
from imocap_core.sync.cycle import relax, relax_auto
from imocap_core.sync.dtw import dtw, positions_of_rows
from imocap_core.sync.monotone import interpolated_squares, monotone_posterior
from imocap_core.sync.poses import body_scales, check_poses, joint_weights_of, stack
from imocap_core.sync.report import CycleReport
from imocap_core.sync.warping import in_order, mass_within, median_positions

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Settings:
    """Every choice of the synchronisation; the values and their reasons are in pipeline.yaml and
    docs."""

    affinity: str  # reciprocal (the paper's) | gaussian
    method: str  # cycle consistency: softmap | als | svt | none | auto
    rounds: int  # compositions of softmap
    warp: str  # posterior (mean over all monotone warps) | dtw (the paper's)
    consensus_rounds: int  # refinements against the other videos' template; 0 = none
    orientation_window_s: float  # an estimate's orientation error changes over about this long
    evidence_per_s: float  # independent looks at the pose per second of video; less = smoother
    unmatched_level: float  # unmatched beyond this share of the way from matching to unrelated
    positions_per_frame: int  # positions tried between two reference frames
    max_rate: float  # most seconds of reference per second of video; inf = any
    confidence_reach_s: float  # confidence = P(match within this many seconds of the reference)
    normalise_scale: bool  # divide each video by its body size
    least_difference_m: float  # pose distance below which performances are not told apart


@dataclass(frozen=True)
class SyncResult:
    """Where every frame of every video lies in the reference video."""

    reference: int
    reference_frame: list[
        Array
    ]  # per video (T_v,) fractional index into the reference; NaN unmatched
    confidence: list[Array]  # per video (T_v,) in [0, 1]
    affinity: NDArray[np.float32]  # (N_a, N_a)
    relaxed: NDArray[np.float32]  # (N_a, N_a), row-stochastic per block
    centrality: Array  # (M,), the reference has the largest unless it was given
    matched_square: float  # squared distance typical of matching frames
    cycle: CycleReport
    status: str


@dataclass(frozen=True)
class _Comparison:
    """All pairs compared: squared distances, and what a matching and an unrelated pair typically
    have."""

    poses: list[Array]
    weights: list[Array]
    blocks: Blocks
    squares: Array
    near: float
    far: float
    floor: float  # squared distance below which performances are not told apart


def _compare(
    poses: Sequence[Array],
    confidence: Sequence[Array] | None,
    joint_weights: Array | None,
    settings: Settings,
) -> _Comparison:
    weights = joint_weights_of(poses, confidence, joint_weights)
    scales = body_scales(poses) if settings.normalise_scale else np.ones(len(poses))
    floor = settings.least_difference_m**2
    everything, blocks = stack(poses, scales)
    stacked = np.concatenate(weights)
    squares = np.full((blocks.total, blocks.total), np.nan)
    for v in range(len(poses) - 1):
        rows = blocks.rows(v)
        rest = slice(rows.stop, None)
        squares[rows, rest] = (
            procrustes_distances(everything[rows], everything[rest], stacked[rows], stacked[rest])
            ** 2
        )
        squares[rest, rows] = squares[rows, rest].T
    near, far = [], []
    for i, j in blocks.pairs():
        block = np.asarray(blocks.block(squares, i, j))
        known = block[np.isfinite(block).any(axis=1)]
        if known.size:
            near.append(np.median(np.nanmin(known, axis=1)))
            far.append(np.nanmedian(known))
    # identical clips have distance 0: keep the unit positive
    typical_far = float(np.mean(far)) if far else 1.0
    typical_near = max(float(np.mean(near)), floor, 1e-6 * typical_far, 1e-12) if near else 1.0
    split = [everything[blocks.rows(v)] for v in range(len(poses))]
    return _Comparison(split, weights, blocks, squares, typical_near, typical_far, floor)


def _neighbour_squares(poses: Array, weights: Array) -> Array:
    """Squared Procrustes distance of each frame to the next, (T - 1,); 0 where unknown."""
    return np.array(
        [
            np.nan_to_num(
                procrustes_distances(
                    poses[t : t + 1],
                    poses[t + 1 : t + 2],
                    weights[t : t + 1],
                    weights[t + 1 : t + 2],
                )
            )[0, 0]
            ** 2
            for t in range(len(poses) - 1)
        ]
    )


def _posterior(
    squares: Array,
    near: float,
    far: float,
    fps: float,
    fps_to: float,
    per_frame: int,
    settings: Settings,
) -> tuple[Array, Array]:
    """Soft map of one video into another from squared distances (n, S), and P(matched)."""
    looks = min(settings.evidence_per_s / fps, 4.0)
    known = np.isfinite(squares)
    mean = np.divide(
        np.where(known, squares, 0.0).sum(axis=1),
        known.sum(axis=1),
        out=np.zeros(len(squares)),
        where=known.any(axis=1),
    )
    cost = looks / near * np.where(known, squares, mean[:, None])
    level = settings.unmatched_level
    if np.isfinite(level):
        # twice the usual square is beyond noise however different unrelated poses are
        level = near + min(level * max(far - near, 0.0), near)
    step = settings.max_rate * fps_to / fps * per_frame
    max_step = int(np.ceil(step)) if np.isfinite(step) else None
    return monotone_posterior(cost, unmatched=looks / near * level, max_step=max_step)


def _directed_maps(c: _Comparison, fps: Sequence[float], settings: Settings) -> tuple[Array, Array]:
    """Soft maps between all videos at whole frames (N_a, N_a), own blocks the identity, and
    P(matched) (N_a, M)."""
    maps, matched = np.zeros_like(c.squares), np.ones((c.blocks.total, len(c.poses)))
    for i, rows in enumerate(map(c.blocks.rows, range(len(c.poses)))):
        for j in range(len(c.poses)):
            if i != j:
                block = np.asarray(c.blocks.block(c.squares, i, j))
                c.blocks.block(maps, i, j)[...], matched[rows, j] = _posterior(
                    block, c.near, c.far, fps[i], fps[j], 1, settings
                )
    c.blocks.set_diagonal_to_identity(maps)
    return maps, matched


def centrality_of(c: _Comparison, maps: Array, matched: Array) -> Array:
    """How well each video stands for the others (M,) in [0, 1]: the mean over the other videos'
    frames of P(it has a counterpart here) x how close that counterpart is."""
    M = len(c.poses)
    out = np.ones(M)
    for v in range(M):
        shares = []
        for u in range(M):
            if u == v:
                continue
            square = np.nan_to_num(np.asarray(c.blocks.block(c.squares, u, v)), nan=c.far)
            expected = (np.asarray(c.blocks.block(maps, u, v)) * square).sum(axis=1)
            shares.append(np.mean(matched[c.blocks.rows(u), v] * np.exp(-0.5 * expected / c.near)))
        out[v] = np.mean(shares) if shares else 1.0
    return out


def synchronise(
    poses: Sequence[Array],
    *,
    fps: Sequence[float],
    settings: Settings,
    rng: np.random.Generator,
    confidence: Sequence[Array] | None = None,
    joint_weights: Array | None = None,
    reference: int | None = None,
) -> SyncResult:
    """Find for every frame of every video its counterpart in the reference video.

    `poses`: per video (T_v, J, 3), one unit for all, any axes and origin (each pose is aligned
    rigidly), NaN = missing; `fps` per video; `confidence` per video (T_v, J) in [0, 1];
    `joint_weights` (J,); `reference`: the index of the reference video, chosen by centrality when
    None. Raises ValueError for shapes that don't fit.
    """
    check_poses(poses, confidence, fps)
    if reference is not None and not 0 <= reference < len(poses):
        raise ValueError(f"reference: expected 0 to {len(poses) - 1}, got {reference}")
    c = _compare(poses, confidence, joint_weights, settings)
    to_affinity = {"reciprocal": reciprocal_affinity, "gaussian": gaussian_affinity}
    if settings.affinity not in to_affinity:
        raise ValueError(f"affinity: expected reciprocal or gaussian, got {settings.affinity!r}")
    affinity = to_affinity[settings.affinity](np.sqrt(c.squares), np.sqrt(c.near))
    c.blocks.set_diagonal_to_identity(affinity)

    maps, matched = _directed_maps(c, fps, settings)
    centrality = centrality_of(c, maps, matched)
    chosen = int(np.argmax(centrality)) if reference is None else reference
    evidence = maps if settings.warp == "posterior" else affinity
    if settings.method == "auto":
        relaxed, report = relax_auto(evidence, c.blocks, rounds=settings.rounds, rng=rng)
    else:
        relaxed, report = relax(
            settings.method, evidence, c.blocks, rounds=settings.rounds, rng=rng
        )
    if settings.warp == "posterior":
        frames, trust = _posterior_warps(c, relaxed, matched, chosen, fps, settings)
    elif settings.warp == "dtw":
        frames, trust = _dtw_warps(c, relaxed, maps, chosen, fps, settings)
    else:
        raise ValueError(f"warp: expected posterior or dtw, got {settings.warp!r}")
    frames[chosen], trust[chosen] = (
        np.arange(float(len(poses[chosen]))),
        np.ones(len(poses[chosen])),
    )
    return SyncResult(
        chosen,
        frames,
        trust,
        affinity.astype(np.float32),
        relaxed.astype(np.float32),
        centrality,
        c.near,
        report,
        _status(frames, trust, chosen, report),
    )


def _spread(maps: Array, per_frame: int) -> Array:
    """A row-stochastic map at whole frames (n, m) at per_frame positions a frame, linear between
    frames."""
    fine = interpolated_squares(maps, np.zeros(maps.shape[1] - 1), per_frame)
    return fine / np.maximum(fine.sum(axis=1, keepdims=True), 1e-300)


def _fine_squares(
    c: _Comparison,
    maps: list[Array | None],
    reference: int,
    per_frame: int,
    windows: Sequence[float] | None,
) -> list[Array | None]:
    """Squared distances (T_v, S) to positions of the reference: to the template of all others, or,
    of two videos, to the reference itself."""
    if len(c.poses) > 2:
        return squared_distances_to_others(c.poses, c.weights, maps, reference, per_frame, windows)
    between = _neighbour_squares(c.poses[reference], c.weights[reference])
    return [
        None
        if v == reference
        else interpolated_squares(
            np.asarray(c.blocks.block(c.squares, v, reference)), between, per_frame
        )
        for v in range(len(c.poses))
    ]


def _posterior_warps(
    c: _Comparison,
    relaxed: NDArray[np.floating],
    matched: Array,
    reference: int,
    fps: Sequence[float],
    settings: Settings,
) -> tuple[list[Array], list[Array]]:
    """Warps from the relaxed maps, refined `consensus_rounds` times against the other videos."""
    M, per_frame = len(c.poses), settings.positions_per_frame
    soft = [
        _spread(np.asarray(c.blocks.block(relaxed, v, reference), dtype=float), per_frame)
        for v in range(M)
    ]
    seen = [matched[c.blocks.rows(v), reference] for v in range(M)]
    # the first refinement aligns frame by frame; only then are orientations known well enough
    steady = [settings.orientation_window_s * f for f in fps]
    for round_ in range(settings.consensus_rounds):
        counted = [None if v == reference else soft[v] * seen[v][:, None] for v in range(M)]
        for v, squares in enumerate(
            _fine_squares(c, counted, reference, per_frame, steady if round_ else None)
        ):
            if squares is None:
                continue
            known = np.isfinite(squares).any(axis=1)
            near = float(np.median(np.nanmin(squares[known], axis=1))) if known.any() else c.near
            near = max(near, c.floor, 1e-6 * c.near)
            soft[v], seen[v] = _posterior(
                squares, near, c.far, fps[v], fps[reference], per_frame, settings
            )
    reach = settings.confidence_reach_s * fps[reference]
    frames, trust = [], []
    for v in range(M):
        position = median_positions(soft[v], per_frame)
        certain = mass_within(soft[v], position, reach, per_frame)
        position = in_order(np.where(seen[v] >= 0.5, position, np.nan), certain)
        frames.append(position)
        trust.append(np.where(np.isfinite(position), np.minimum(certain * seen[v], 1.0), 0.0))
    return frames, trust


def _dtw_warps(
    c: _Comparison,
    relaxed: NDArray[np.floating],
    maps: Array,
    reference: int,
    fps: Sequence[float],
    settings: Settings,
) -> tuple[list[Array], list[Array]]:
    """The paper's last step: DTW on each relaxed block; the confidence is that of the soft maps."""
    reach = settings.confidence_reach_s * fps[reference]
    skip = _skip_of(c, relaxed, reference, settings)
    frames, trust = [], []
    for v in range(len(c.poses)):
        block = np.asarray(c.blocks.block(relaxed, v, reference), dtype=float)
        path, _ = dtw(-block, skip=skip)
        position = positions_of_rows(path, len(block))
        soft = np.asarray(c.blocks.block(maps, v, reference))
        certain = mass_within(soft, np.nan_to_num(position), reach)
        frames.append(position)
        trust.append(np.where(np.isfinite(position), certain, 0.0))
    return frames, trust


def _skip_of(
    c: _Comparison, relaxed: NDArray[np.floating], reference: int, settings: Settings
) -> float:
    """What an unmatched frame pays in DTW on minus the affinity: `unmatched_level` between best
    and typical entries."""
    if not np.isfinite(settings.unmatched_level):
        return np.inf
    others = [v for v in range(len(c.poses)) if v != reference]
    blocks = [np.asarray(c.blocks.block(relaxed, v, reference)) for v in others]
    best = float(np.mean([np.median(b.max(axis=1)) for b in blocks])) if blocks else 1.0
    usual = float(np.mean([np.median(b) for b in blocks])) if blocks else 0.0
    return -(best + settings.unmatched_level * (usual - best))


def _status(frames: list[Array], trust: list[Array], reference: int, report: CycleReport) -> str:
    """One sentence on what was found."""
    others = [v for v in range(len(frames)) if v != reference]
    if not others:
        return "one video: nothing to synchronise"
    share = np.mean(np.concatenate([np.isfinite(frames[v]) for v in others]))
    certain = np.mean(np.concatenate([trust[v] for v in others]))
    return (
        f"{100 * share:.0f} % of the frames matched, mean confidence {certain:.2f}; {report.status}"
    )
