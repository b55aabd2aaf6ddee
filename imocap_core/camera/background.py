"""Background tracking: key frames, features, and one homography per frame.

Every frame is matched directly to a key frame instead of to the frame before it, so errors add up
per key frame and not per frame. The earliest key frame that overlaps enough is used, so a camera
that pans back is matched to its first frame again and the drift disappears.

Feature tracks: background corners followed through a video, from the picture they were found in. A
corner is compared with the picture of its first frame in every later one, so a track does not
drift; it ends where it leaves the picture, is covered, or no longer looks the same.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int64, UInt8

from imocap_core.camera.projection import Lens, warp

MIN_OVERLAP = 0.6  # of the frame inside a key frame
MIN_TRACKED = 0.35  # of the features that should be visible
BOX_PADDING = 0.12  # of the person's box on each side: hair, hands and clothes reach out of it
_FEWEST = 4  # points of a homography
_WINDOW = (21, 21)

_BAR_LEVEL = 24  # of 255: darker are black bars, compression's noise included
_BAR_SHARE = 0.01  # of a column or row: so few pixels are noise
_LEAST_BAR = 0.03  # of the side: a narrower margin is the picture's own dark edge
_BAR_BRIGHT = 0.6  # of a bar's pixels at most: captions
_EDGE_CHANGES = 0.3  # of the film's pixels along a bar: its camera moves


@dataclass(frozen=True)
class FilmedPart:
    """Rows and columns of a picture of ``shape`` (height, width) that lie between black bars."""

    shape: tuple[int, ...]
    rows: slice
    columns: slice

    @property
    def share(self) -> float:
        """Its larger side, as a share of the picture's larger side."""
        return max(s.stop - s.start for s in (self.rows, self.columns)) / max(self.shape)

    def alone(self, picture: UInt8[np.ndarray, "H W"]) -> UInt8[np.ndarray, "H W"]:
        """The picture, black around what is filmed: captions stand still when the camera turns."""
        if picture[self.rows, self.columns].size == picture.size:
            return picture
        alone = np.zeros_like(picture)
        alone[self.rows, self.columns] = picture[self.rows, self.columns]
        return alone


def filmed_part(pictures: Iterator[UInt8[np.ndarray, "H W"]]) -> FilmedPart:
    """What is filmed of some grey pictures of a video, of which only the first is looked at where
    it has no black edges. Bars are equally wide on both sides, and black in all pictures. Captions
    in them, which never change, are told from the film where its camera moves."""
    first = next(pictures, np.full((1, 1), 255, np.uint8))
    dark = first <= _BAR_LEVEL
    if max(dark[[0, -1]].mean(), dark[:, [0, -1]].mean()) < 1 - _BAR_SHARE:
        return FilmedPart(dark.shape, *(slice(0, side) for side in dark.shape))
    shown = np.stack([first, *pictures])
    highest = shown.max(axis=0)
    bright = highest > _BAR_LEVEL
    changes = bright & (highest - shown.min(axis=0) > _BAR_LEVEL)
    sides = (_between_bars(bright.mean(axis), changes.mean(axis)) for axis in (1, 0))
    return FilmedPart(bright.shape, *sides)


def _between_bars(bright: Float[np.ndarray, " n"], changes: Float[np.ndarray, " n"]) -> slice:
    """Rows (or columns) between two equal bars; shares of each one's pixels that are ever bright,
    and that change."""
    count = len(bright)
    plain, captioned = (_bar(share) for share in (bright, changes))
    edge = max(1, int(_LEAST_BAR * count))
    filmed = changes[captioned : count - captioned]
    if (
        plain
        and filmed[:edge].mean() > _EDGE_CHANGES < filmed[-edge:].mean()
        and np.r_[bright[:captioned], bright[count - captioned :]].mean() < _BAR_BRIGHT
    ):
        plain = captioned
    return slice(plain, count - plain) if plain >= _LEAST_BAR * count else slice(0, count)


def _bar(share: Float[np.ndarray, " n"]) -> int:
    """Rows (or columns) from either side without such pixels."""
    filmed = np.flatnonzero(share > _BAR_SHARE)
    return min(int(filmed[0]), len(share) - 1 - int(filmed[-1])) if len(filmed) else 0


@dataclass(frozen=True)
class Matches:
    """Point correspondences of one frame with the key frame ``key``, in pixels of both.

    ``H_key_from_frame`` is fitted to those that are ``inlier``. A frame that could not be matched
    has no points and the homography of the frame before it.
    """

    key: int
    H_key_from_frame: Float[np.ndarray, "3 3"]
    xy_key: Float[np.ndarray, "N 2"]
    xy_frame: Float[np.ndarray, "N 2"]
    inlier: Bool[np.ndarray, " N"]

    def undistorted(self, lens: Lens, threshold_px: float) -> Matches:
        """Without the lens's distortion, the homography fitted anew where it is one of points."""
        xy_key, xy_frame = lens.undistorted(self.xy_key), lens.undistorted(self.xy_frame)
        moved = replace(self, xy_key=xy_key, xy_frame=xy_frame)
        if np.array_equal(xy_key, xy_frame):  # a key frame itself, or a frame without points
            return moved
        return _fit(self.key, xy_key, xy_frame, _FEWEST, threshold_px) or moved


@dataclass(frozen=True)
class _View:
    """A picture and where it shows background."""

    picture: UInt8[np.ndarray, "H W"]
    mask: UInt8[np.ndarray, "H W"]

    @cached_property
    def sift(self) -> Any:
        """SIFT features and their descriptors; None where there is none."""
        return cv2.SIFT.create(nfeatures=1500).detectAndCompute(self.picture, self.mask)


@dataclass(frozen=True)
class _Key:
    frame: int
    picture: UInt8[np.ndarray, "H W"]
    points: Float[np.ndarray, "N 2"]
    H_first_from_key: Float[np.ndarray, "3 3"]


def track_background(
    pictures: Iterable[UInt8[np.ndarray, "H W"]],
    box_px: Float[np.ndarray, "T 4"],
    *,
    max_features: int,
    min_inliers: int,
    threshold_px: float,
) -> list[Matches]:
    """Matches of every grey picture with a key frame; the first picture is a key frame itself.

    Args:
        pictures: T grey pictures of one size.
        box_px: x0, y0, x1, y1 of the person, who is not background; NaN where unknown.
        max_features: corners of a key frame.
        min_inliers: matches that a homography needs.
        threshold_px: largest error of an inlier.

    All in pixels of these pictures. Pictures with fewer corners than a homography needs become no
    key frames, and once more than half of the frames are lost (`estimate_camera_motion` then uses
    none) the others count as lost too: a plain wall costs little.
    """
    boxes = filled_boxes(box_px)
    keys: list[_Key] = []
    matches: list[Matches] = []
    H_first: list[np.ndarray] = []
    before: _View | None = None
    lost = 0
    for t, picture in enumerate(pictures):
        view = _View(picture, background_mask(picture.shape, boxes[t]))
        if before is None:
            keys.append(_make_key(t, view, np.eye(3), max_features))
            points = keys[0].points
            matches.append(Matches(0, np.eye(3), points, points, np.ones(len(points), bool)))
        elif lost > len(boxes) // 2:
            matches.append(_unmatched(keys[-1], H_first[-1]))
        else:
            predicted = H_first[-1] @ np.linalg.inv(H_first[max(0, t - 2)]) @ H_first[-1]
            match = None
            for key in _candidates(keys, predicted, picture.shape):
                match = _match(key, view, predicted, min_inliers, threshold_px)
                if match is not None:
                    break
            if match is None and keys[-1].frame != t - 1:
                key = _make_key(t - 1, before, H_first[-1], max_features)
                if len(key.points) >= min_inliers:
                    keys.append(key)
                    match = _match(key, view, predicted, min_inliers, threshold_px)
            if match is None and keys[-1].frame == t - 1 and len(keys[-1].points) >= min_inliers:
                match = _match_far(t - 1, before, view, min_inliers, threshold_px)
            lost += match is None
            matches.append(match or _unmatched(keys[-1], H_first[-1]))
        key = next(key for key in reversed(keys) if key.frame == matches[-1].key)
        H = key.H_first_from_key @ matches[-1].H_key_from_frame
        H_first.append(H / H[2, 2])
        before = view
    return matches


def chain(
    matches: Sequence[Matches], key_from_frame: Float[np.ndarray, "T 3 3"]
) -> Float[np.ndarray, "T 3 3"]:
    """Homographies or rotations to the key frames, chained to the first frame."""
    first = np.empty_like(key_from_frame)
    for t, match in enumerate(matches):
        first[t] = key_from_frame[t] if match.key == t else first[match.key] @ key_from_frame[t]
    return first


def rescaled(match: Matches, scale: float) -> Matches:
    """Matches in pictures made smaller by ``scale``, in pixels of the full pictures."""
    offset = 0.5 / scale - 0.5  # pixel (0, 0) is the middle of the first pixel
    full = np.array([[1 / scale, 0.0, offset], [0.0, 1 / scale, offset], [0.0, 0.0, 1.0]])
    return Matches(
        match.key,
        full @ match.H_key_from_frame @ np.linalg.inv(full),
        warp(full, match.xy_key),
        warp(full, match.xy_frame),
        match.inlier,
    )


def filled_boxes(box_px: Float[np.ndarray, "T 4"]) -> Float[np.ndarray, "T 4"]:
    """Boxes with gaps interpolated linearly; NaN everywhere when there is no box at all."""
    boxes = np.array(box_px, dtype=np.float64)
    present = np.isfinite(boxes).all(axis=1)
    if present.any():
        frames = np.arange(len(boxes))
        for side in range(4):
            boxes[:, side] = np.interp(frames, frames[present], boxes[present, side])
    return boxes


def background_mask(
    shape: tuple[int, ...], box_px: Float[np.ndarray, "4"]
) -> UInt8[np.ndarray, "H W"]:
    """255 where a picture of this shape shows background, 0 inside the padded box."""
    mask = np.full(shape[:2], 255, np.uint8)
    if np.isfinite(box_px).all():
        pad = BOX_PADDING * np.hypot(box_px[2] - box_px[0], box_px[3] - box_px[1])
        x0, y0, x1, y1 = np.clip(box_px + pad * np.array([-1, -1, 1, 1]), 0, 1e6).astype(int)
        mask[y0 : y1 + 1, x0 : x1 + 1] = 0
    return mask


def overlap(
    H_b_from_a: Float[np.ndarray, "*n 3 3"], shape: tuple[int, ...]
) -> Float[np.ndarray, "*n"]:
    """Shares of pictures a (height, width) that lie inside pictures b of the same shape."""
    height, width = shape[:2]
    x, y = np.meshgrid(np.linspace(0, width - 1, 12), np.linspace(0, height - 1, 12))
    moved = warp(np.asarray(H_b_from_a)[..., None, None, :, :], np.stack([x, y], axis=-1))
    return np.asarray(_inside(moved, shape).mean(axis=(-2, -1)))


def _inside(
    xy: Float[np.ndarray, "*N 2"], shape: tuple[int, ...], margin: float = 0.0
) -> Bool[np.ndarray, "*N"]:
    upper = np.array([shape[1] - 1, shape[0] - 1]) - margin
    return np.asarray(((xy >= margin) & (xy <= upper)).all(axis=-1))


def _make_key(frame: int, view: _View, H_first: np.ndarray, max_features: int) -> _Key:
    """A key frame with corners spread over its background."""
    spacing = _spacing_px(view.picture, max_features)
    points = _corners(view.picture, view.mask, max_features, spacing)
    return _Key(frame, view.picture, points, H_first)


def _spacing_px(picture: np.ndarray, corners: int) -> float:
    """Distance of so many corners that are spread over a picture."""
    return max(4.0, 0.7 * float(np.sqrt(picture.size / corners)))


def _corners(
    picture: np.ndarray, mask: np.ndarray, most: int, spacing_px: float
) -> Float[np.ndarray, "N 2"]:
    """The best corners of the background, this far from one another."""
    corners = cv2.goodFeaturesToTrack(
        picture, most, qualityLevel=0.004, minDistance=spacing_px, mask=mask, blockSize=5
    )
    return np.zeros((0, 2)) if corners is None else corners.reshape(-1, 2).astype(np.float64)


def _candidates(
    keys: list[_Key], H_first_from_frame: np.ndarray, shape: tuple[int, ...]
) -> list[_Key]:
    """The earliest key frame with enough overlap, then the one with the most."""
    H_key_from_first = np.linalg.inv(np.stack([key.H_first_from_key for key in keys]))
    shares = overlap(H_key_from_first @ H_first_from_frame, shape)
    good = np.flatnonzero(shares >= MIN_OVERLAP)
    if not len(good):
        return []
    return [keys[i] for i in dict.fromkeys([int(good[0]), int(np.argmax(shares))])]


def _match(
    key: _Key, view: _View, H_first_from_frame: np.ndarray, min_inliers: int, threshold_px: float
) -> Matches | None:
    """Corners of a key frame tracked by optical flow (Lucas-Kanade) from their predicted places."""
    picture, mask = view.picture, view.mask
    H_frame_from_key = np.linalg.inv(H_first_from_frame) @ key.H_first_from_key
    guess = warp(H_frame_from_key, key.points)
    visible = _inside(guess, picture.shape, margin=2.0) & _unmasked(mask, guess)
    if visible.sum() < min_inliers:
        return None
    xy_key = key.points[visible]
    moved, status, _ = cv2.calcOpticalFlowPyrLK(
        key.picture,
        picture,
        xy_key.astype(np.float32),
        guess[visible].astype(np.float32),
        winSize=_WINDOW,
        maxLevel=3,
        criteria=(cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 20, 0.01),
        flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
    )
    xy_frame = moved.astype(np.float64)
    tracked = (status[:, 0] == 1) & _inside(xy_frame, picture.shape) & _unmasked(mask, xy_frame)
    needed = max(min_inliers, int(MIN_TRACKED * visible.sum()))
    return _fit(key.frame, xy_key[tracked], xy_frame[tracked], needed, threshold_px)


def _match_far(
    key: int, of_key: _View, of_frame: _View, min_inliers: int, threshold_px: float
) -> Matches | None:
    """Matches without a predicted place: SIFT features and Lowe's ratio test."""
    (points_a, described_a), (points_b, described_b) = of_key.sift, of_frame.sift
    if described_a is None or described_b is None or min(len(points_a), len(points_b)) < 2:
        return None
    pairs = cv2.BFMatcher(cv2.NORM_L2).knnMatch(described_a, described_b, k=2)
    good = [a for a, b in pairs if a.distance < 0.75 * b.distance]
    xy_key = np.array([points_a[m.queryIdx].pt for m in good], dtype=np.float64).reshape(-1, 2)
    xy_frame = np.array([points_b[m.trainIdx].pt for m in good], dtype=np.float64).reshape(-1, 2)
    return _fit(key, xy_key, xy_frame, min_inliers, threshold_px)


def _fit(
    key: int, xy_key: np.ndarray, xy_frame: np.ndarray, needed: int, threshold_px: float
) -> Matches | None:
    """Robust homography; None unless it has the inliers it needs."""
    if len(xy_key) < max(needed, _FEWEST):
        return None
    H, chosen = cv2.findHomography(xy_frame, xy_key, cv2.USAC_MAGSAC, threshold_px, maxIters=500)
    if H is None or chosen.sum() < needed or abs(np.linalg.det(H)) < 1e-6:
        return None
    return Matches(key, H / H[2, 2], xy_key, xy_frame, chosen[:, 0] == 1)


def _unmatched(key: _Key, H_first_from_frame: np.ndarray) -> Matches:
    """No match: the camera is taken to be as in the frame before."""
    nothing = np.zeros((0, 2))
    H = np.linalg.inv(key.H_first_from_key) @ H_first_from_frame
    return Matches(key.frame, H / H[2, 2], nothing, nothing, np.zeros(0, bool))


def _unmasked(
    mask: UInt8[np.ndarray, "H W"], xy: Float[np.ndarray, "N 2"]
) -> Bool[np.ndarray, " N"]:
    """Whether points lie on background; those outside the picture do not."""
    inside = _inside(xy, mask.shape)
    column, row = np.where(inside[:, None], xy, 0.0).round().astype(int).T
    return inside & (mask[row, column] > 0)


_REFILL = 0.75  # of the corners wanted: with fewer, new ones are looked for
LONGEST_S = 4.0  # of a track
_MAX_DIFFERENCE = 18.0  # mean grey levels between a corner's two pictures
FEWEST_TRACKED = 6  # corners of one first picture that are still worth following
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

    def without_graphics(self) -> FeatureTracks:
        """Without points that stay on one pixel while others go far: burnt-in scores and logos."""
        _, place, frames = np.unique(self.track, return_inverse=True, return_counts=True)
        low, high = np.full((2, len(frames), 2), [[[np.inf]], [[-np.inf]]])
        np.minimum.at(low, place, self.xy_px)
        np.maximum.at(high, place, self.xy_px)
        extent_px, lasting = (high - low).max(axis=1), frames >= 5
        usual_px = frames * np.median((extent_px / frames)[lasting]) if lasting.any() else extent_px
        return self.some(((extent_px > 1.0) | (usual_px < 5.0))[place])

    def undistorted(self, lens: Lens) -> FeatureTracks:
        """As a pinhole camera would show them."""
        return replace(self, xy_px=lens.undistorted(self.xy_px))


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
        broods = [
            b for b in moved if len(b.track) >= FEWEST_TRACKED and t - b.born < LONGEST_S * fps
        ]
        followed = sum(len(b.track) for b in broods)
        if followed < _REFILL * max_features:
            corners = _new_corners(picture, mask, broods, max_features, max_features - followed)
            if len(corners) >= FEWEST_TRACKED:
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
    good = np.asarray(status)[:, 0].astype(bool) & _inside(xy, picture.shape, margin=2.0)
    good &= _unmasked(mask, xy) & (np.asarray(difference)[:, 0] < _MAX_DIFFERENCE)
    return _Brood(brood.born, brood.picture, brood.first[good], xy[good], brood.track[good])


def _new_corners(
    picture: np.ndarray, mask: np.ndarray, broods: list[_Brood], wanted: int, most: int
) -> Float[np.ndarray, "P 2"]:
    """The best corners away from those that are followed already."""
    spacing = _spacing_px(picture, wanted)
    free = mask.copy()
    for brood in broods:
        for x, y in brood.now.round().astype(int):
            cv2.circle(free, (int(x), int(y)), int(spacing), 0, -1)
    return _corners(picture, free, most, spacing)
