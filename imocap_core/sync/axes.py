"""Maps to the reference, refined against what the other videos agree on, on several time axes.

Round after round, each video is warped onto the template made of the others' poses, and finally,
where cameras are given, onto the projections of the others' motion.

Refined maps lead to one video, the axis, and carry that video's own errors: with another axis all
positions are others, although the videos are the same. Each axis also places every two other videos
in relation to each other. The mean over the axes of where a frame of one video lies in another errs
less than any of them, and depends little on which video is the reference.

In the loop one axis is enough, the reference's: each video's own keypoints tell its time there. On
another video's time its wrong poses would speak too.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from imocap_core.params import SyncParams
from imocap_core.robust import geman_mcclure_weight
from imocap_core.sync.affinity import DistanceMatrix
from imocap_core.sync.anchors import Hints
from imocap_core.sync.comparable_poses import mean_of_known, spread_over, squared_differences
from imocap_core.sync.maps import Band, BandedMap, BlockMaps, blocks_of_frames, search_bands
from imocap_core.sync.reference import AnchorPenalty, anchor_penalty, anchors_to_reference
from imocap_core.sync.time_axis import PairMaps, inside
from imocap_core.sync.warp.leave_one_out_template import squared_distances_to_others
from imocap_core.sync.warp.reprojection_evidence import ReprojectionEvidence
from imocap_core.sync.warp.soft_maps import (
    Clocks,
    at_fine_positions,
    soft_map,
    typical_matched_square,
)
from imocap_core.sync.warp.template import NearbySquares, isotonic, mass_within, median_positions
from imocap_core.workers import thread_map

SHARP_ROUNDS = 2  # the last refinements, against a template that errs less than two estimates
_SETTLED_FRAMES = 0.05  # the other refinements end when maps move less
_ORIENTATION_S = 1.0  # that the orientation error of a monocular estimate persists
SHARPNESS = 3.0  # factor of their evidence
REPROJECTION_ROUNDS = 2  # in the second, outliers are those at the moments of the first
SEARCH_S = 2.0  # beyond what a map does not rule out, a refinement looks this far
LEAST_UNIT_M2 = 1e-6  # of squared differences of heights
DISTINCT = 1e-9  # frames, between two that would lie at one place
KEYPOINTS_PER_S = 60.0  # a detector's errors persist far less than those of poses


@dataclass(frozen=True)
class ReferenceAxis:
    """The axis that maps lead to: the reference video, and every video's clock.

    Attributes:
        reach_frames: frames of the reference within which a match counts as right.
        change: per video, squared change of the pose around each frame.
        penalty: of the user's anchors; None without anchors.
    """

    reference: int
    clocks: Clocks
    reach_frames: float
    change: Sequence[Float[np.ndarray, "_T"]]
    penalty: AnchorPenalty | None = None

    def soft_map(
        self, v: int, squares: NearbySquares, matched_square: float, params: SyncParams
    ) -> tuple[BandedMap, np.ndarray]:
        """`soft_map` (T_v, S) of video v to the reference, with the user's anchors."""
        if self.penalty is not None:
            squares = self.penalty(v, squares, matched_square, params.evidence_per_s)
        posterior, matched = soft_map(
            squares,
            matched_square,
            self.change[v],
            self.clocks.pair(v, self.reference),
            params,
            per_frame=params.positions_per_frame,
            smooth_rate_share=0.0,
        )
        return posterior.trimmed(), matched

    def nearby(self, maps: Sequence[BandedMap], params: SyncParams) -> list[Band]:
        """The positions near those of a video's maps; all, where the user gave anchors."""
        if self.penalty is not None:
            N, S = maps[0].shape
            return [(rows, slice(0, S)) for rows in blocks_of_frames(N)]
        frames = SEARCH_S * self.clocks.action_fps[self.reference]
        return search_bands(maps, round(frames * params.positions_per_frame))


def refined_warps(
    distances: DistanceMatrix,
    relaxed: BlockMaps,
    matched: Float[np.ndarray, "N_a M"],
    axis: ReferenceAxis,
    params: SyncParams,
    reprojection: ReprojectionEvidence | None = None,
) -> tuple[list[Float[np.ndarray, "_T"]], list[Float[np.ndarray, "_T"]]]:
    """Positions of each video's frames in the reference, NaN unmatched, and confidences.

    From the relaxed maps, refined `consensus_rounds` times against the other videos' poses, and by
    `reprojection`, where that is more accurate than comparing poses. Reprojection tells the
    reference's time too: its frames then lie elsewhere on the axis of its own poses, and all
    positions are told in its frames.
    """
    M, blocks, per_frame = len(distances.poses), distances.blocks, params.positions_per_frame
    maps = [at_fine_positions(relaxed.pair(v, axis.reference), per_frame) for v in range(M)]
    in_reference = [matched[blocks.rows(v), axis.reference] for v in range(M)]
    certainty = _refine_by_poses(maps, in_reference, distances, axis, params)
    if reprojection is not None:
        _refine_by_reprojection(maps, certainty, reprojection, distances, axis, params)
    on_axis = [median_positions(m, per_frame) for m in maps]
    reference_frames = increasing(on_axis[axis.reference])
    positions, confidence = [], []
    for v in range(M):
        mass = mass_within(certainty[v], on_axis[v], axis.reach_frames, per_frame)
        position = np.interp(on_axis[v], reference_frames, np.arange(len(reference_frames)))
        position = isotonic(np.where(in_reference[v] >= 0.5, position, np.nan), mass)
        positions.append(position)
        trusted = np.minimum(mass * in_reference[v], 1.0)
        confidence.append(np.where(np.isfinite(position), trusted, 0.0))
    return positions, confidence


def _refine_by_poses(
    maps: list[BandedMap],
    matched: list[np.ndarray],
    distances: DistanceMatrix,
    axis: ReferenceAxis,
    params: SyncParams,
) -> list[BandedMap]:
    """Refine the maps (T_v, S) and P(matched) (T_v,) by the poses of the other videos, in place.

    They end where the maps settle. The last rounds weigh the evidence more: the template errs less
    than the two estimates for which the evidence is set. The certainty of a position is that of the
    usual evidence: those maps are returned.
    """
    sharp = replace(params, evidence_per_s=SHARPNESS * params.evidence_per_s)
    first, usual = list(maps), list(maps)

    def refine(evidence: SyncParams, windows: list[float] | None) -> None:
        weighted = [
            None if v == axis.reference else m.scaled(p)
            for v, (m, p) in enumerate(zip(maps, matched, strict=True))
        ]
        squares_of_videos = squared_distances_to_others(
            distances.poses,
            distances.weights,
            weighted,
            # what a later map rules out may come back: bands do not become narrower
            [axis.nearby(of_video, params) for of_video in zip(maps, usual, first, strict=True)],
            axis.reference,
            params.positions_per_frame,
            windows,
            distances.vertical,
        )
        for v, squares in squares_of_videos:
            typical = typical_matched_square(squares.least, distances)
            usual[v], matched[v] = axis.soft_map(v, squares, typical, params)
            maps[v] = (
                usual[v] if evidence is params else axis.soft_map(v, squares, typical, evidence)[0]
            )

    def positions() -> Float[np.ndarray, " N_a"]:
        return np.concatenate([median_positions(m, params.positions_per_frame) for m in maps])

    # the first refinement aligns frame by frame; only then are orientations accurate enough
    windows = [_ORIENTATION_S * f for f in axis.clocks.action_fps]
    for round_ in range(params.consensus_rounds):
        before = positions()
        refine(params, windows if round_ else None)
        if round_ and np.abs(positions() - before).mean() < _SETTLED_FRAMES:
            break
    for _ in range(SHARP_ROUNDS if params.consensus_rounds else 0):
        refine(sharp, windows)
    return usual


def _refine_by_reprojection(
    maps: list[BandedMap],
    certainty: list[BandedMap],
    reprojection: ReprojectionEvidence,
    distances: DistanceMatrix,
    axis: ReferenceAxis,
    params: SyncParams,
) -> None:
    """Refine the maps (T_v, S) by the keypoints, in place; which frames are matched is unchanged.

    Every frame's keypoints, the reference's too, are compared with the other videos' motion, each
    of them where its poses lie on the axis (the maps as they come in). A video's poses and
    keypoints need not show one moment: poses that were estimated with a wrong match show that
    match's moment. Placed by the poses, the others' motion is one motion, whichever of them had
    wrong matches.

    Heights count beside them: the motion is one that the videos share, so a jump that the poses
    placed right may be less clear in it.

    The certainty of these positions is that of weaker evidence, because the errors of the motion
    that keypoints are compared with persist longer than theirs. The reference's stays: positions
    are told in its frames.
    """
    per_frame = params.positions_per_frame
    sharp = replace(params, unmatched_level=np.inf, evidence_per_s=KEYPOINTS_PER_S)
    usual = replace(sharp, evidence_per_s=KEYPOINTS_PER_S / SHARPNESS)
    of_poses = tuple(maps)

    def refine(v: int) -> None:
        template = reprojection.template(v, of_poses, axis.reference, per_frame)
        lifted = _squared_heights(v, of_poses, distances, axis.reference, per_frame)
        squares = None
        for _ in range(REPROJECTION_ROUNDS):
            nearby = axis.nearby([maps[v]], params)
            now = reprojection.squares(v, template, maps[v], nearby, per_frame)
            if now is None:
                break
            squares = now.plus(lifted)
            maps[v] = axis.soft_map(v, squares, 1.0, sharp)[0]
        if squares is not None and v != axis.reference:
            certainty[v] = axis.soft_map(v, squares, 1.0, usual)[0]

    # the user's anchors lie on the reference's frames: with them these are the axis
    thread_map(refine, [v for v in range(len(maps)) if v != axis.reference or axis.penalty is None])


def _squared_heights(
    v: int, maps: Sequence[BandedMap], distances: DistanceMatrix, reference: int, per_frame: int
) -> Callable[[slice, slice], Float[np.ndarray, "_t _s"]]:
    """Squared differences of video v's heights to the others' mean, in units of those of matches
    (`maps`): a function of frames and positions."""
    per_video = distances.vertical[v]
    others = mean_of_known(
        [
            spread_over(h, None if u == reference else m, per_frame)
            for u, (h, m) in enumerate(zip(distances.vertical, maps, strict=True))
            if u != v
        ]
    )
    matched = np.rint(median_positions(maps[v], per_frame) * per_frame).astype(np.int64)
    has_height = np.nan_to_num((per_video - others[matched]) ** 2)
    unit = max(float(np.median(has_height)), distances.least_square, LEAST_UNIT_M2)
    return lambda t, s: squared_differences(per_video[t], others[s]) / unit


def increasing(positions: Float[np.ndarray, " N"]) -> Float[np.ndarray, " N"]:
    """The nearest warp that never stands still, so that it has an inverse."""
    forward = isotonic(positions, np.ones(len(positions)))
    still = np.diff(forward, prepend=-np.inf) <= 0
    return forward + DISTINCT * np.cumsum(still)


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
    middle = np.bincount(place, frames) / np.bincount(place)
    return np.interp(targets, values, middle, left=np.nan, right=np.nan)


def _mean(rows: Float[np.ndarray, "A T"], reach_frames: float) -> Float[np.ndarray, " T"]:
    """Robust mean about the first row where that is finite, made non-decreasing; else NaN."""
    weight = np.nan_to_num(geman_mcclure_weight(np.abs(rows - rows[0]), reach_frames))
    total = weight.sum(axis=0)
    mean = (weight * np.nan_to_num(rows)).sum(axis=0) / np.maximum(total, 1e-12)
    return isotonic(np.where(np.isfinite(rows[0]), mean, np.nan), total)


MEMORY_BYTES = 1 << 28  # of the maps of all axes that are refined at once
COPIES = 4  # of all maps, while they are refined

# On training clips anything from 0.2 s on gives the same error; steps and dribbles last longer.
REACH_S = 0.3


@dataclass(frozen=True)
class AxisChoice:
    """The videos whose time may serve as axis: the reference, then others by centrality."""

    clocks: Clocks
    hints: Hints
    pairs: PairMaps
    reference: int
    centralities: Float[np.ndarray, " M"]

    def axis(self, v: int, distances: DistanceMatrix, params: SyncParams) -> ReferenceAxis:
        """The axis of one video, with the user's anchors on it."""
        points = anchors_to_reference(self.hints, self.pairs, len(self.centralities), v)
        fps = self.clocks.action_fps
        penalty = anchor_penalty(points, fps, v, params.positions_per_frame)
        reach_frames = params.confidence_reach_s * self.clocks.fps[v]
        return ReferenceAxis(v, self.clocks, reach_frames, distances.change, penalty)


def refined_over_axes(
    choice: AxisChoice,
    distances: DistanceMatrix,
    relaxed: BlockMaps,
    matched: Float[np.ndarray, "N_a M"],
    params: SyncParams,
    reprojection: ReprojectionEvidence | None,
) -> tuple[list[Float[np.ndarray, "_T"]], list[Float[np.ndarray, "_T"]], ReferenceAxis]:
    """Positions of all videos' frames in the reference, averaged over axes (`averaged_over_axes`);
    the mass of their soft maps to the reference alone, and its axis."""
    videos = axes_of(choice.reference, choice.centralities)
    if reprojection is not None:
        videos = [choice.reference]
    axes = [choice.axis(v, distances, params) for v in videos]
    refined = thread_map(
        lambda axis: refined_warps(distances, relaxed, matched, axis, params, reprojection),
        axes,
        _axes_at_once(relaxed, choice.reference, params),
    )
    maps = {v: positions for v, (positions, _) in zip(videos, refined, strict=True)}
    lengths = [len(x) for x in distances.poses]
    reach_frames = REACH_S * choice.clocks.fps[choice.reference]
    averaged = averaged_over_axes(maps, choice.reference, lengths, reach_frames)
    return averaged, refined[0][1], axes[0]


def _axes_at_once(relaxed: BlockMaps, reference: int, params: SyncParams) -> int:
    """As many axes as fit into the memory for them, one at least."""
    videos = range(len(relaxed.blocks.lengths))
    entries = sum(x.size for v in videos for x in relaxed.pair(v, reference).values)
    of_axis = COPIES * np.dtype(float).itemsize * params.positions_per_frame * entries
    return max(1, MEMORY_BYTES // max(1, of_axis))
