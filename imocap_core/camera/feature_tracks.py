"""Feature tracks: background corners followed through a video, from the picture they were found in.

A corner is compared with the picture of its first frame in every later one, so a track does not
drift; it ends where it leaves the picture, is covered, or no longer looks the same.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int64, UInt8

from imocap_core.camera.background import background_mask, filled_boxes
from imocap_core.camera.lens import Lens

REFILL = 0.75  # of the corners wanted: with fewer, new ones are looked for
LONGEST_S = 4.0  # of a track
MAX_DIFFERENCE = 18.0  # mean grey levels between a corner's two pictures
FEWEST = 6  # corners of one first picture that are still worth following
WINDOW = (15, 15)
_LEVELS = 3


@dataclass(frozen=True)
class FeatureTracks:
    """Observations of background points: point ``track[n]`` is at ``xy_px[n]`` in ``frame[n]``."""

    track: Int64[np.ndarray, " N"]
    frame: Int64[np.ndarray, " N"]
    xy_px: Float[np.ndarray, "N 2"]

    def at(self, frame: int) -> tuple[Int64[np.ndarray, " P"], Float[np.ndarray, "P 2"]]:
        """The tracks that are visible in a frame, ascending, and their places."""
        rows = slice(*np.searchsorted(self.frame, [frame, frame + 1]))
        return self.track[rows], self.xy_px[rows]

    def common(
        self, a: int, b: int
    ) -> tuple[Int64[np.ndarray, " P"], Float[np.ndarray, "P 2"], Float[np.ndarray, "P 2"]]:
        """The tracks that are visible in both frames, and their places there."""
        (in_a, xy_a), (in_b, xy_b) = self.at(a), self.at(b)
        both, rows_a, rows_b = np.intersect1d(in_a, in_b, assume_unique=True, return_indices=True)
        return both, xy_a[rows_a], xy_b[rows_b]

    def some(self, chosen: Bool[np.ndarray, " N"]) -> FeatureTracks:
        """A part of the observations."""
        return FeatureTracks(self.track[chosen], self.frame[chosen], self.xy_px[chosen])

    def undistorted(self, lens: Lens) -> FeatureTracks:
        """As a pinhole camera would show them."""
        return replace(self, xy_px=lens.undistorted(self.xy_px))

    def rescaled(self, scale: float) -> FeatureTracks:
        """Tracks in pictures made smaller by ``scale``, in pixels of the full pictures."""
        return FeatureTracks(self.track, self.frame, (self.xy_px + 0.5) / scale - 0.5)


@dataclass
class _Brood:
    """Corners of one first picture that are still followed."""

    born: int
    picture: UInt8[np.ndarray, "H W"]
    first: Float[np.ndarray, "P 2"]
    now: Float[np.ndarray, "P 2"]
    track: Int64[np.ndarray, " P"]


def track_features(
    pictures: Iterable[UInt8[np.ndarray, "H W"]],
    box_px: Float[np.ndarray, "T 4"],
    fps: float,
    *,
    max_features: int,
) -> FeatureTracks:
    """Corners of the background, followed through all grey pictures.

    Args:
        box_px: x0, y0, x1, y1 of the person, who is not background; NaN where unknown.
        max_features: corners followed at one time.
    """
    boxes = filled_boxes(box_px)
    broods: list[_Brood] = []
    rows: list[tuple[np.ndarray, int, np.ndarray]] = []
    count = 0
    for t, picture in enumerate(pictures):
        mask = background_mask(picture.shape, boxes[t])
        moved = [_followed(brood, picture, mask) for brood in broods]
        broods = [b for b in moved if len(b.track) >= FEWEST and t - b.born < LONGEST_S * fps]
        followed = sum(len(b.track) for b in broods)
        if followed < REFILL * max_features:
            corners = _new_corners(picture, mask, broods, max_features, max_features - followed)
            if len(corners) >= FEWEST:
                ids = np.arange(count, count + len(corners))
                broods.append(_Brood(t, picture.copy(), corners, corners, ids))
                count += len(corners)
        rows += [(b.track, t, b.now) for b in broods]
    return _collected(rows)


def _collected(rows: list[tuple[np.ndarray, int, np.ndarray]]) -> FeatureTracks:
    """Sorted by frame, then by track: broods are in the order of their first frames."""
    if not rows:
        nothing = np.zeros(0, np.int64)
        return FeatureTracks(nothing, nothing, np.zeros((0, 2)))
    return FeatureTracks(
        np.concatenate([track for track, _, _ in rows]).astype(np.int64),
        np.repeat([t for _, t, _ in rows], [len(track) for track, _, _ in rows]).astype(np.int64),
        np.concatenate([xy for _, _, xy in rows]),
    )


def _followed(brood: _Brood, picture: np.ndarray, mask: np.ndarray) -> _Brood:
    """Optical flow (Lucas-Kanade) from the first picture, started at the last places."""
    guess = brood.now.astype(np.float32).reshape(-1, 1, 2).copy()
    moved, status, difference = cv2.calcOpticalFlowPyrLK(
        brood.picture,
        picture,
        brood.first.astype(np.float32).reshape(-1, 1, 2),
        guess,
        winSize=WINDOW,
        maxLevel=_LEVELS,
        criteria=(cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 20, 0.01),
        flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
    )
    xy = moved.reshape(-1, 2).astype(np.float64)
    upper = np.array([picture.shape[1] - 1, picture.shape[0] - 1])
    inside = np.asarray(((xy >= 2) & (xy <= upper - 2)).all(axis=1))
    column, row = np.where(inside[:, None], xy, 0.0).round().astype(int).T
    background = np.take(mask, row * mask.shape[1] + column) > 0
    good = np.asarray(status)[:, 0].astype(bool) & inside & background
    good &= np.asarray(difference)[:, 0] < MAX_DIFFERENCE
    return _Brood(brood.born, brood.picture, brood.first[good], xy[good], brood.track[good])


def _new_corners(
    picture: np.ndarray, mask: np.ndarray, broods: list[_Brood], wanted: int, most: int
) -> Float[np.ndarray, "P 2"]:
    """The best corners away from those that are followed already."""
    spacing = max(4.0, 0.7 * np.sqrt(picture.size / wanted))
    free = mask.copy()
    for brood in broods:
        for x, y in brood.now.round().astype(int):
            cv2.circle(free, (int(x), int(y)), int(spacing), 0, -1)
    corners = cv2.goodFeaturesToTrack(
        picture, most, qualityLevel=0.004, minDistance=spacing, mask=free, blockSize=5
    )
    return np.zeros((0, 2)) if corners is None else corners.reshape(-1, 2).astype(np.float64)
