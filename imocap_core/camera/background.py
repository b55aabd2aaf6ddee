"""The background followed through a clip: key frames, features, one homography a frame.

Every frame is matched directly to a key frame instead of to the frame before it, so errors add up
once a key frame and not once a frame; the earliest key frame that still shows enough of the scene
is taken, so a camera that pans back meets its first frame again and the drift is gone.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from imocap_core.camera.projection import warp

Array = NDArray[np.float64]
Picture = NDArray[np.uint8]

MIN_OVERLAP = 0.6  # of the frame inside a key frame
MIN_SURVIVORS = 0.35  # of the features that should be visible
BOX_PADDING = 0.12  # of the person's box on each side: hair, hands and clothes leave it
_WINDOW = (21, 21)


@dataclass(frozen=True)
class Matches:
    """One frame against frame ``key``: points (N, 2) in pixels of both, and which are ``inlier``.

    ``H_key_from_frame`` is fitted to the inliers. A frame that could not be matched has no points
    and stays where the frame before it was.
    """

    key: int
    H_key_from_frame: Array
    xy_key: Array
    xy_frame: Array
    inlier: NDArray[np.bool_]


@dataclass(frozen=True)
class _Key:
    frame: int
    picture: Picture
    mask: Picture
    points: Array
    H_first_from_key: Array


def track_background(
    pictures: Iterable[Picture],
    box_px: Array,
    *,
    max_features: int,
    min_inliers: int,
    threshold_px: float,
) -> list[Matches]:
    """Matches of every grey picture (height, width) to a key frame; the first is its own.

    ``box_px`` (T, 4) is x0, y0, x1, y1 of the person, who is no background; NaN where unknown.
    All in pixels of these pictures. ``threshold_px`` separates inliers from outliers.
    """
    boxes = filled_boxes(box_px)
    keys: list[_Key] = []
    found: list[Matches] = []
    H_first: list[Array] = []
    before: Picture | None = None
    for t, picture in enumerate(pictures):
        mask = background_mask(picture.shape, boxes[t])
        if before is None:
            keys.append(_make_key(t, picture, mask, np.eye(3), max_features))
            points = keys[0].points
            found.append(Matches(0, np.eye(3), points, points, np.ones(len(points), bool)))
        else:
            predicted = H_first[-1] @ np.linalg.inv(H_first[max(0, t - 2)]) @ H_first[-1]
            match = None
            for key in _candidates(keys, predicted, picture.shape):
                match = _match(key, picture, mask, predicted, min_inliers, threshold_px)
                if match is not None:
                    break
            if match is None and keys[-1].frame != t - 1:
                mask_before = background_mask(before.shape, boxes[t - 1])
                keys.append(_make_key(t - 1, before, mask_before, H_first[-1], max_features))
                match = _match(keys[-1], picture, mask, predicted, min_inliers, threshold_px)
            if match is None:
                match = _match_far(keys[-1], picture, mask, min_inliers, threshold_px)
            found.append(match or _lost(keys[-1], H_first[-1]))
        home = next(key for key in keys if key.frame == found[-1].key)
        H = home.H_first_from_key @ found[-1].H_key_from_frame
        H_first.append(H / H[2, 2])
        before = picture
    return found


def chain(matches: list[Matches], key_from_frame: Array) -> Array:
    """Transforms (T, 3, 3) to the key frames chained to the first frame.

    ``key_from_frame`` (T, 3, 3) are homographies or rotations, one for each of ``matches``.
    """
    first = np.empty_like(key_from_frame)
    for t, match in enumerate(matches):
        first[t] = key_from_frame[t] if match.key == t else first[match.key] @ key_from_frame[t]
    return first


def rescaled(match: Matches, scale: float) -> Matches:
    """``match`` of pictures that were made smaller by ``scale``, in pixels of the full pictures."""
    offset = 0.5 / scale - 0.5  # pixel (0, 0) is the middle of the first pixel
    full = np.array([[1 / scale, 0.0, offset], [0.0, 1 / scale, offset], [0.0, 0.0, 1.0]])
    return Matches(
        match.key,
        full @ match.H_key_from_frame @ np.linalg.inv(full),
        warp(full, match.xy_key),
        warp(full, match.xy_frame),
        match.inlier,
    )


def filled_boxes(box_px: Array) -> Array:
    """Boxes (T, 4) with gaps filled in linearly; NaN everywhere when there is no box at all."""
    boxes = np.array(box_px, dtype=np.float64)
    seen = np.isfinite(boxes).all(axis=1)
    if seen.any():
        frames = np.arange(len(boxes))
        for side in range(4):
            boxes[:, side] = np.interp(frames, frames[seen], boxes[seen, side])
    return boxes


def background_mask(shape: tuple[int, ...], box_px: Array) -> Picture:
    """255 where a picture of this shape shows background, 0 inside the padded box."""
    mask = np.full(shape[:2], 255, np.uint8)
    if np.isfinite(box_px).all():
        pad = BOX_PADDING * np.hypot(box_px[2] - box_px[0], box_px[3] - box_px[1])
        x0, y0, x1, y1 = np.clip(box_px + pad * np.array([-1, -1, 1, 1]), 0, 1e6).astype(int)
        mask[y0 : y1 + 1, x0 : x1 + 1] = 0
    return mask


def overlap(H_b_from_a: Array, shape: tuple[int, ...]) -> float:
    """Share of picture a (height, width) that lies inside picture b of the same shape."""
    height, width = shape[:2]
    x, y = np.meshgrid(np.linspace(0, width - 1, 12), np.linspace(0, height - 1, 12))
    return float(_inside(warp(H_b_from_a, np.stack([x, y], axis=-1)), shape).mean())


def _inside(xy: Array, shape: tuple[int, ...], margin: float = 0.0) -> NDArray[np.bool_]:
    upper = np.array([shape[1] - 1, shape[0] - 1]) - margin
    return np.asarray(((xy >= margin) & (xy <= upper)).all(axis=-1))


def _make_key(
    frame: int, picture: Picture, mask: Picture, H_first: Array, max_features: int
) -> _Key:
    """A key frame with corners spread over its background."""
    apart = max(4.0, 0.7 * np.sqrt(picture.size / max_features))
    corners = cv2.goodFeaturesToTrack(
        picture, max_features, qualityLevel=0.004, minDistance=apart, mask=mask, blockSize=5
    )
    points = np.zeros((0, 2)) if corners is None else corners.reshape(-1, 2).astype(np.float64)
    return _Key(frame, picture, mask, points, H_first)


def _candidates(keys: list[_Key], H_first_from_frame: Array, shape: tuple[int, ...]) -> list[_Key]:
    """The earliest key frame with enough overlap, then the one with the most."""
    shares = [overlap(np.linalg.inv(k.H_first_from_key) @ H_first_from_frame, shape) for k in keys]
    good = [i for i, share in enumerate(shares) if share >= MIN_OVERLAP]
    if not good:
        return []
    return [keys[i] for i in dict.fromkeys([good[0], int(np.argmax(shares))])]


def _match(
    key: _Key,
    picture: Picture,
    mask: Picture,
    H_first_from_frame: Array,
    min_inliers: int,
    threshold_px: float,
) -> Matches | None:
    """Corners of a key frame found in a picture by Lucas-Kanade, starting where they should be."""
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
    kept = (status[:, 0] == 1) & _inside(xy_frame, picture.shape) & _unmasked(mask, xy_frame)
    needed = max(min_inliers, int(MIN_SURVIVORS * visible.sum()))
    return _fit(key.frame, xy_key[kept], xy_frame[kept], needed, threshold_px)


def _match_far(
    key: _Key, picture: Picture, mask: Picture, min_inliers: int, threshold_px: float
) -> Matches | None:
    """A picture found again without knowing where it went: SIFT features and their ratio test."""
    sift = cv2.SIFT.create(nfeatures=1500)
    points_a, described_a = sift.detectAndCompute(key.picture, key.mask)
    points_b, described_b = sift.detectAndCompute(picture, mask)
    if described_a is None or described_b is None or min(len(points_a), len(points_b)) < 2:
        return None
    pairs = cv2.BFMatcher(cv2.NORM_L2).knnMatch(described_a, described_b, k=2)
    good = [a for a, b in pairs if a.distance < 0.75 * b.distance]
    xy_key = np.array([points_a[m.queryIdx].pt for m in good], dtype=np.float64).reshape(-1, 2)
    xy_frame = np.array([points_b[m.trainIdx].pt for m in good], dtype=np.float64).reshape(-1, 2)
    return _fit(key.frame, xy_key, xy_frame, min_inliers, threshold_px)


def _fit(
    key: int, xy_key: Array, xy_frame: Array, needed: int, threshold_px: float
) -> Matches | None:
    """Robust homography; None unless it has the inliers it needs."""
    if len(xy_key) < max(needed, 4):
        return None
    H, chosen = cv2.findHomography(xy_frame, xy_key, cv2.USAC_MAGSAC, threshold_px, maxIters=500)
    if H is None or chosen.sum() < needed or abs(np.linalg.det(H)) < 1e-6:
        return None
    return Matches(key, H / H[2, 2], xy_key, xy_frame, chosen[:, 0] == 1)


def _lost(key: _Key, H_first_from_frame: Array) -> Matches:
    """No match: the camera is held to be where it was."""
    nothing = np.zeros((0, 2))
    H = np.linalg.inv(key.H_first_from_key) @ H_first_from_frame
    return Matches(key.frame, H / H[2, 2], nothing, nothing, np.zeros(0, bool))


def _unmasked(mask: Picture, xy: Array) -> NDArray[np.bool_]:
    """Whether points (N, 2) fall on background; those outside the picture do not."""
    inside = _inside(xy, mask.shape)
    column, row = np.where(inside[:, None], xy, 0.0).round().astype(int).T
    return inside & (mask[row, column] > 0)
