"""Parallax of the background: does a camera leave its place, or does it only turn and zoom?

Three models of what two frames share are compared by Torr's geometric robust information criterion
(GRIC): a camera on one spot (`tripod`), a plane, and epipolar geometry with any depths. Parallax is
found where epipolar geometry wins, explains what the camera on one spot does not, and that is many
pixels of a good part of the background. A background that is flat, or far, cannot tell.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np
from jaxtyping import Float

from imocap_core.camera.background import FeatureTracks
from imocap_core.camera.projection import warp
from imocap_core.camera.tripod import (
    LEAST,
    PairPoints,
    TrackedPair,
    TripodCamera,
    TurningLens,
    fit_tripod,
    turning_lens,
)

ParallaxVerdict = Literal["none", "found", "flat", "untested"]

MOST_KEYS = 16
FEWEST_COMMON = 30  # tracks that a pair of key frames shares
MOST_POINTS = 60  # of a pair, in the fit
MOST_WIDE = 24  # pairs, besides those of consecutive key frames
NOISE_PX = 0.5  # of a track, one standard deviation
PARALLAX_PX = 1.0  # off the tripod: more is parallax where epipolar geometry explains it
EPIPOLAR_PX = 1.0
CLOSER = 0.35  # the other model's error over the tripod's, at most
PARALLAX_SHARE = 0.2  # of a pair's tracks
EXPLAINED_SHARE = 0.5  # of those off the tripod, that the other model explains
PAIR_SHARE = 0.3  # of the wide pairs
FEWEST_PAIRS = 2
FLAT_SHARE = 0.2  # of the pairs off the tripod: with fewer of depth the background is a plane


@dataclass(frozen=True)
class ParallaxTest:
    """What the background says about a camera's place.

    Attributes:
        verdict: ``found``: the camera moves; ``flat``: it does, before a background that is a
            plane; ``none``: a camera on one spot explains the background; ``untested``: too few
            features.
        pairs: of key frames compared; share: of them that no camera on one spot explains.
        off_px: median error of the tripod in the pairs that it explains worst.
        tripod: the camera on one spot that fits best, or None.
        lens: what a camera that stays on its spot tells about its lens; None where that is given or
            near a pinhole.
    """

    verdict: ParallaxVerdict
    pairs: int = 0
    share: float = 0.0
    off_px: float = 0.0
    tripod: TripodCamera | None = None
    lens: TurningLens | None = None

    @property
    def moves(self) -> bool:
        """Whether the camera leaves its place."""
        return self.verdict in ("found", "flat")

    @property
    def words(self) -> str:
        """The outcome as part of a note."""
        if self.verdict == "untested":
            return "whether it moves from its place could not be tested (too few features last)"
        if self.verdict == "none":
            return (
                f"no parallax between {self.pairs} pairs of frames (a slow walk before a far or "
                f"flat background would show none){self.lens.words if self.lens else ''}"
            )
        flat = ", which is nearly flat," if self.verdict == "flat" else ""
        return (
            f"in {self.share:.0%} of {self.pairs} pairs of frames the background{flat} shows "
            "parallax that no turning, zoom or lens explains"
        )


def parallax_test(
    tracks: FeatureTracks,
    frames: int,
    size: tuple[int, int],
    focal_px: float | None,
    *,
    straight: bool = False,
) -> ParallaxTest:
    """The test on a video's feature tracks, in pixels of the pictures of ``size`` that they were
    followed in: the thresholds are those of pictures about 640 pixels large.

    Args:
        focal_px: in these pixels, where it is given.
        straight: whether the tracks are known to have no distortion.
    """
    keys = _key_frames(tracks, frames)
    if len(keys) < 3:
        return ParallaxTest("untested")
    pairs = _pairs(tracks, keys)
    tripod = fit_tripod(
        [_thinned(pair) for pair in pairs], len(keys), size, focal_px, straight=straight
    )
    wide = [pair for pair in pairs if pair.b > pair.a + 1]
    if not wide:
        return ParallaxTest("untested", tripod=tripod)
    on_spot = [_off_spot(pair, tripod, size) for pair in wide]
    kinds = [_kind(pair, error) for pair, error in zip(wide, on_spot, strict=True)]
    moved = len(wide) - kinds.count("spot")
    off = sorted(float(np.median(error)) for error in on_spot)
    worst = float(np.mean(off[-max(1, len(off) // 4) :]))
    verdict: ParallaxVerdict = "none"
    if moved >= max(FEWEST_PAIRS, PAIR_SHARE * len(wide)):
        verdict = "flat" if kinds.count("depth") < FLAT_SHARE * moved else "found"
    lens = None
    if verdict == "none" and not straight and abs(tripod.distortion) >= LEAST:
        lens = turning_lens(tracks, lambda part: _chosen(part, pairs, keys), size, focal_px, tripod)
    return ParallaxTest(verdict, len(wide), moved / len(wide), worst, tripod, lens)


def _chosen(
    tracks: FeatureTracks, pairs: Sequence[TrackedPair], keys: Sequence[int]
) -> list[TrackedPair]:
    """The same pairs of key frames from other tracks."""
    again = []
    for pair in pairs:
        _, xy_a, xy_b = tracks.common(keys[pair.a], keys[pair.b])
        again.append(_thinned(TrackedPair(pair.a, pair.b, xy_a, xy_b)))
    return again


def _off_spot(
    pair: TrackedPair, tripod: TripodCamera, size: tuple[int, int]
) -> Float[np.ndarray, " P"]:
    """The tripod's errors in pixels of the coarser of two pictures: a zoom magnifies noise too."""
    error = _norm(tripod.errors_px(PairPoints.of([pair], size)))
    return error * min(1.0, float(np.exp(tripod.log_zoom[pair.b] - tripod.log_zoom[pair.a])))


def _key_frames(tracks: FeatureTracks, frames: int) -> list[int]:
    """Key frames such that consecutive ones share enough tracks, from the first on; none where the
    chain breaks before the middle of the video."""
    wanted = np.unique(np.linspace(0, frames - 1, MOST_KEYS).round().astype(int))
    keys = [int(wanted[0])]
    for t in wanted[1:]:
        if len(tracks.common(keys[-1], int(t))[0]) < FEWEST_COMMON:
            break
        keys.append(int(t))
    return keys if keys[-1] >= frames // 2 else []


def _pairs(tracks: FeatureTracks, keys: Sequence[int]) -> list[TrackedPair]:
    """Consecutive key frames, and the widest pairs that share enough tracks."""
    chain, wide = [], []
    for a in range(len(keys)):
        for b in range(a + 1, len(keys)):
            _, xy_a, xy_b = tracks.common(keys[a], keys[b])
            pair = TrackedPair(a, b, xy_a, xy_b)
            if b == a + 1:
                chain.append(pair)
            elif len(xy_a) >= FEWEST_COMMON:
                wide.append(pair)
    wide.sort(key=lambda pair: pair.a - pair.b)
    return [*chain, *wide[:MOST_WIDE]]


def _thinned(pair: TrackedPair) -> TrackedPair:
    count = len(pair.xy_a)
    rows = np.unique(np.linspace(0, count - 1, min(count, MOST_POINTS)).round().astype(np.int64))
    return TrackedPair(pair.a, pair.b, pair.xy_a[rows], pair.xy_b[rows])


def _kind(pair: TrackedPair, on_spot: Float[np.ndarray, " P"]) -> Literal["spot", "plane", "depth"]:
    """The model of lowest GRIC; not ``spot`` only where the other explains what a tripod leaves.

    on_spot: the tripod's errors, pixels.
    """
    in_plane, epipolar = _plane_errors(pair), _epipolar_errors(pair)
    spot = gric(on_spot, dimension=2, unknowns=4)
    plane = gric(in_plane, dimension=2, unknowns=8)
    depth = gric(epipolar, dimension=3, unknowns=7)
    off = on_spot > PARALLAX_PX
    if off.mean() < PARALLAX_SHARE or spot <= min(plane, depth):
        return "spot"
    other = in_plane if plane <= depth else epipolar
    explained = off & (other < np.minimum(EPIPOLAR_PX, CLOSER * on_spot))
    if explained.sum() < max(EXPLAINED_SHARE * off.sum(), PARALLAX_SHARE * len(off)):
        return "spot"
    return "plane" if plane <= depth else "depth"


def gric(error_px: Float[np.ndarray, " P"], *, dimension: int, unknowns: int) -> float:
    """Geometric robust information criterion of a model of two views' points (Torr, 1998).

    Args:
        error_px: of each point; dimension: of the set of points that the model allows, of the four
            coordinates of a match; unknowns: of the model.
    """
    count = len(error_px)
    worst = 2.0 * (4 - dimension)
    robust = np.minimum((error_px / NOISE_PX) ** 2, worst)
    return float(robust.sum() + np.log(4.0) * dimension * count + np.log(4.0 * count) * unknowns)


def _plane_errors(pair: TrackedPair) -> Float[np.ndarray, " P"]:
    H, _ = cv2.findHomography(pair.xy_b, pair.xy_a, cv2.USAC_MAGSAC, 1.5, maxIters=500)
    return _norm(warp(H if H is not None else np.full((3, 3), np.nan), pair.xy_b) - pair.xy_a)


def _epipolar_errors(pair: TrackedPair) -> Float[np.ndarray, " P"]:
    """Sampson distances to the fundamental matrix of most inliers."""
    try:
        F, _ = cv2.findFundamentalMat(
            pair.xy_b, pair.xy_a, cv2.USAC_MAGSAC, EPIPOLAR_PX, 0.999, 1000
        )
    except cv2.error:  # a degenerate sample: raised by some releases
        F = None
    if F is None or F.shape != (3, 3):
        return np.full(len(pair.xy_a), 1e3)
    b, a = (np.column_stack([xy, np.ones(len(xy))]) for xy in (pair.xy_b, pair.xy_a))
    line_a, line_b = b @ F.T, a @ F
    slope = (line_a[:, :2] ** 2).sum(axis=1) + (line_b[:, :2] ** 2).sum(axis=1)
    return np.asarray(np.abs((a * line_a).sum(axis=1)) / np.sqrt(np.maximum(slope, 1e-12)))


def _norm(error: Float[np.ndarray, "P 2"]) -> Float[np.ndarray, " P"]:
    return np.nan_to_num(np.linalg.norm(error, axis=1), nan=1e3)
