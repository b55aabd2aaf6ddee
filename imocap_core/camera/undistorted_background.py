"""Matches of the background as a pinhole camera would show them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np

from imocap_core.camera.background import Matches
from imocap_core.camera.lens import Lens

FEWEST = 4  # points of a homography


def undistorted_matches(
    matches: Sequence[Matches], lens: Lens, threshold_px: float
) -> list[Matches]:
    """The matches without the lens's distortion, homographies fitted anew.

    A frame without points keeps its homography, which comes from the frame before.

    Args:
        threshold_px: largest error of an inlier.
    """
    return [_undistorted(match, frame, lens, threshold_px) for frame, match in enumerate(matches)]


def _undistorted(match: Matches, frame: int, lens: Lens, threshold_px: float) -> Matches:
    if not len(match.xy_key):
        return match
    xy_key, xy_frame = lens.undistorted(match.xy_key), lens.undistorted(match.xy_frame)
    moved = replace(match, xy_key=xy_key, xy_frame=xy_frame)
    if match.key == frame or len(xy_key) < FEWEST:
        return moved
    H, chosen = cv2.findHomography(xy_frame, xy_key, cv2.USAC_MAGSAC, threshold_px, maxIters=500)
    if H is None or abs(np.linalg.det(H)) < 1e-6:
        return moved
    return replace(moved, H_key_from_frame=H / H[2, 2], inlier=chosen[:, 0] == 1)
