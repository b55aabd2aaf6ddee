"""Radial distortion of a camera on one spot, estimated from how its background moves as it turns.

A rotation moves the picture of a pinhole camera by a homography of three parameters; what is left,
the same in every pair of frames, is the lens. It counts only where tracks that took no part in the
fit agree with it, in both halves of them, by far more than by chance.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np
from jaxtyping import Float

from imocap_core.camera.feature_tracks import FeatureTracks
from imocap_core.camera.lens import Lens, lens_of_corner
from imocap_core.camera.tripod import PairPoints, TrackedPair, TripodCamera
from imocap_core.camera.tripod_fit import distortion_sd, refit_tripod
from imocap_core.robust import geman_mcclure

LEAST = 0.015  # displacement of the picture's corner, as a share, that is worth correcting
WORTH_A_WORD = 0.04
CERTAIN_SIGMAS = 3.0
LEAST_GAIN = 0.1  # of the held-out tracks' cost
GAIN_SIGMAS = 3.0  # of the mean gain of a held-out track
HALVES_APART = 0.35  # of the distortion, at most
LOSS_PX = 1.0
MODEL_SD = 0.005  # of the distortion: noise of the tracks, and lenses of more than one coefficient
FEWEST_OF_A_PAIR = 8  # tracks of a half that two consecutive key frames share


@dataclass(frozen=True)
class TurningLens:
    """The estimate of a turning camera's lens.

    Attributes:
        distortion: `TripodCamera.distortion`; sd: its standard deviation, as if the tracks' errors
            were all of one kind: a camera that hardly turns tells nothing.
        gain: share of held-out tracks' cost that it removes; sigmas: this over its standard error.
        apart: difference between the distortions of two halves of the tracks.
    """

    source: ClassVar[Literal["rotation"]] = "rotation"

    distortion: float
    sd: float
    gain: float
    sigmas: float
    apart: float

    @property
    def words(self) -> str:
        """What is said of a lens that is clearly far from a pinhole, its size uncertain."""
        clear = abs(self.distortion) >= max(WORTH_A_WORD, CERTAIN_SIGMAS * self.sd)
        if self.certain or not clear or self.sigmas < GAIN_SIGMAS:
            return ""
        return (
            "; its lens seems to displace the picture's corners by about "
            f"{abs(self.distortion):.0%}, too uncertain to be corrected: give `distortion` and "
            "`focal_px`"
        )

    def lens(self, K: Float[np.ndarray, "3 3"], size: tuple[int, int]) -> tuple[Lens, float]:
        """The lens of pictures of a size whose focal length is K's, and the standard deviation of
        its k1."""
        return lens_of_corner(self.distortion, self.sd, K, size)

    @property
    def certain(self) -> bool:
        """Whether the evidence is clear enough to correct the pictures."""
        size = abs(self.distortion)
        return bool(
            size >= max(LEAST, CERTAIN_SIGMAS * self.sd, self.apart / HALVES_APART)
            and self.gain >= LEAST_GAIN
            and self.sigmas >= GAIN_SIGMAS
        )


def turning_lens(
    tracks: FeatureTracks,
    pairs_of: Callable[[FeatureTracks], Sequence[TrackedPair]],
    size: tuple[int, int],
    focal_px: float | None,
    tripod: TripodCamera,
) -> TurningLens | None:
    """The lens by two halves of the tracks, each against what the other half was fitted to.

    Args:
        pairs_of: pairs of its key frames from tracks. tripod: fitted to all of them.

    None where a half has too few tracks.
    """
    halves = [tracks.some(tracks.track % 2 == part) for part in (0, 1)]
    pairs = [list(pairs_of(half)) for half in halves]
    if min(len(pair.xy_a) for half in pairs for pair in half) < FEWEST_OF_A_PAIR:
        return None
    gains, before, fitted = [], [], []
    for fit_to, other in (pairs, pairs[::-1]):
        bent = refit_tripod(fit_to, size, focal_px, tripod)
        straight = refit_tripod(fit_to, size, focal_px, tripod, straight=True)
        points = PairPoints.of(other, size)
        costs = [_cost(camera, points) for camera in (straight, bent)]
        gains.append(costs[0] - costs[1])
        before.append(costs[0])
        fitted.append(bent.distortion)
    gain, cost = np.concatenate(gains), np.concatenate(before)
    together = np.sqrt(np.mean([len(half) for half in pairs]))  # a track is in several pairs
    error = together * float(gain.std()) / np.sqrt(len(gain))
    return TurningLens(
        distortion=tripod.distortion,
        sd=float(
            np.linalg.norm(
                [
                    MODEL_SD,
                    distortion_sd([*pairs[0], *pairs[1]], size, focal_px, tripod),
                    _systematic_sd([*pairs[0], *pairs[1]], size, tripod),
                ]
            )
        ),
        gain=float(gain.sum() / max(cost.sum(), 1e-12)),
        sigmas=float(gain.mean() / max(error, 1e-12)),
        apart=abs(fitted[0] - fitted[1]),
    )


def _systematic_sd(
    pairs: Sequence[TrackedPair], size: tuple[int, int], tripod: TripodCamera
) -> float:
    """Of the distortion, where all tracks err alike, as by a step aside: their error over how far
    the widest pair moves the picture."""
    error = np.linalg.norm(tripod.errors_px(PairPoints.of(pairs, size)), axis=1)
    moved = (np.linalg.norm(pair.xy_a - pair.xy_b, axis=1) for pair in pairs)
    return float(np.median(error) / max(max(float(np.median(m)) for m in moved), 1e-9))


def _cost(camera: TripodCamera, points: PairPoints) -> Float[np.ndarray, " P"]:
    """Robust cost of every point."""
    squared = (camera.errors_px(points) ** 2).sum(axis=1)
    return np.asarray(geman_mcclure(squared, LOSS_PX)[0])
