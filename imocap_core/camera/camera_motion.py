"""Motion of one camera from its background: static, rotating, zooming or translating; focal length.

For a camera that only rotates, pixels of two frames are related by ``H = K R K^-1`` whatever the
scene looks like. Fitting R to matched rays (three parameters) instead of H (eight) is better
conditioned, and its residuals tell a rotating camera from a translating one.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from jaxtyping import Float, Int64
from scipy.optimize import minimize_scalar

from imocap_core.camera.averaging import angle_deg
from imocap_core.camera.background import Matches, chain
from imocap_core.camera.parallax import ParallaxTest
from imocap_core.camera.projection import intrinsics, warp
from imocap_core.camera.zooming import homographies, rotations_and_zooms, rotations_key_from_frame
from imocap_core.robust import geman_mcclure

MotionKind = Literal["static", "rotating", "zooming", "translating", "unknown"]
FocalSource = Literal["given", "rotation", "structure", "assumed"]

STATIC_PX = 0.6  # movement below which a camera is static, for pictures 1000 pixels large
FOCAL_RANGE = (0.35, 5.0)  # of the larger side of the picture
MIN_MOVEMENT = 0.05  # of the larger side: less movement does not determine the focal length
FOCAL_FRAMES = 30  # that moved most
FOCAL_STEP = 1.15  # the focal length is determined if changing it by this factor raises the error
EXPLAINED_SHARE = 0.6  # of the background that a rotation must explain
_CHUNK = 256  # frames whose rotations are solved side by side


@dataclass(frozen=True)
class CameraMotionEstimate:
    """Motion of one camera over T frames, relative to the first one.

    ``K`` is the first frame's; ``zoom`` each frame's focal length divided by the first one's;
    ``inliers`` the number of matches that each frame's homography explains; ``residual_px`` their
    median error; ``note`` a sentence for the report. ``path``: places of a camera that moves, in
    the first frame's axes and a unit of its own, and ``path_sd`` their standard deviations; None on
    one spot, or unknown.
    """

    K: Float[np.ndarray, "3 3"]
    focal_source: FocalSource
    motion: MotionKind
    H_first_from_frame: Float[np.ndarray, "T 3 3"]
    R_first_from_frame: Float[np.ndarray, "T 3 3"]
    zoom: Float[np.ndarray, " T"]
    inliers: Int64[np.ndarray, " T"]
    residual_px: float
    note: str
    path: Float[np.ndarray, "T 3"] | None = None
    path_sd: Float[np.ndarray, " T"] | None = None


def static_camera(
    frames: int, size: tuple[int, int], focal_px: float | None, factor: float
) -> CameraMotionEstimate:
    """A camera of unknown motion, assumed to be static.

    Its focal length is ``focal_px`` or, where that is None, ``factor`` times the larger side of the
    picture of ``size`` (width, height).
    """
    still = np.tile(np.eye(3), (frames, 1, 1))
    return CameraMotionEstimate(
        K=intrinsics(focal_px or factor * max(size), size),
        focal_source="given" if focal_px else "assumed",
        motion="unknown",
        H_first_from_frame=still,
        R_first_from_frame=still.copy(),
        zoom=np.ones(frames),
        inliers=np.zeros(frames, np.int64),
        residual_px=0.0,
        note="no video file, so the camera is assumed to be static",
    )


def estimate_camera_motion(
    matches: Sequence[Matches],
    size: tuple[int, int],
    focal_px: float | None,
    *,
    assumed_focal_factor: float,
    threshold_px: float,
    parallax: Callable[[], ParallaxTest] | None = None,
) -> CameraMotionEstimate:
    """Motion, rotations and focal length of one camera from its matched background (section 3.2).

    Args:
        matches: one a frame, in pixels of the full picture of ``size`` (width, height).
        focal_px: the focal length where it is given; None solves it when the camera rotates enough,
            and otherwise assumes ``assumed_focal_factor`` times the larger side.
        threshold_px: largest error of a point that counts as explained.
        parallax: makes the test for parallax, which a static camera does not need; None: no test.
    """
    inliers = np.array([int(match.inlier.sum()) for match in matches], dtype=np.int64)
    still = replace(
        static_camera(len(matches), size, focal_px, assumed_focal_factor), inliers=inliers
    )
    lost = int((inliers == 0).sum())
    unmatched = f"; {lost} of {len(matches)} frames could not be matched" if lost else ""
    unmatched += " and are taken to be as the frame before them" if lost else ""
    if lost > len(matches) // 2:
        why = "the background has too few features to track, so the camera is assumed to be static"
        return replace(still, note=why)
    movement = [_movement(match) for match in matches]
    if np.quantile(movement, 0.95) < STATIC_PX * max(size) / 1000.0:
        residual = float(np.median(movement))
        static = replace(still, motion="static", residual_px=residual)
        return replace(static, note="stands still" + unmatched)
    test = None if parallax is None else parallax()
    if test is not None and test.moves:
        still = replace(still, residual_px=test.off_px)
        R = chain(matches, _all_rotations(matches, still.K))
        return _translating(still, R, test.words + unmatched)
    unmatched += "" if test is None else f"; {test.words}"
    solved = None if focal_px else _solve_focal(matches, size)
    if solved:
        solved_start = replace(still, K=intrinsics(solved, size), focal_source="rotation")
        rotating = _simplest_motion(matches, solved_start, threshold_px, unmatched)
        if rotating.motion == "rotating":  # else the focal length was fitted to what is no rotation
            return rotating
    return _simplest_motion(matches, still, threshold_px, unmatched)


def _simplest_motion(
    matches: Sequence[Matches], start: CameraMotionEstimate, threshold_px: float, unmatched: str
) -> CameraMotionEstimate:
    """``start`` with rotations, with zooms too where rotations alone do not explain the background,
    or as moving where neither does; ``unmatched`` ends the note."""
    K = start.K
    R_key_from_frame = _all_rotations(matches, K)
    R = chain(matches, R_key_from_frame)
    H_key_from_frame = K @ R_key_from_frame @ np.linalg.inv(K)
    residual, explained = _explained(matches, H_key_from_frame, threshold_px)
    if explained >= EXPLAINED_SHARE:
        widest = float(angle_deg(R[:1], R).max())
        return replace(
            start,
            motion="rotating",
            H_first_from_frame=K @ R @ np.linalg.inv(K),
            R_first_from_frame=R,
            residual_px=residual,
            note=f"turns by up to {widest:.1f} degrees" + unmatched,
        )
    zooming = _zooming(matches, start, threshold_px, unmatched)
    if zooming is not None:
        return zooming
    why = f"a rotation explains only {explained:.0%} of the background ({residual:.1f} px off)"
    return _translating(replace(start, residual_px=residual), R, why + unmatched)


def _translating(
    start: CameraMotionEstimate, R: Float[np.ndarray, "T 3 3"], why: str
) -> CameraMotionEstimate:
    """``start`` with the rotations that explain the background best: a camera that moves, its path
    unknown. A homography would take the performer for a part of the background's plane and shear
    him; a wrong rotation turns him as a whole."""
    return replace(
        start,
        motion="translating",
        H_first_from_frame=start.K @ R @ np.linalg.inv(start.K),
        R_first_from_frame=R,
        note=f"the camera moves from its place: {why}",
    )


def _all_rotations(
    matches: Sequence[Matches], K: Float[np.ndarray, "3 3"]
) -> Float[np.ndarray, "T 3 3"]:
    """R_key_from_frame of every frame that explains the background best."""
    parts = [matches[start : start + _CHUNK] for start in range(0, len(matches), _CHUNK)]
    return np.concatenate([rotations_key_from_frame(part, K, K)[0] for part in parts])


def _zooming(
    matches: Sequence[Matches], start: CameraMotionEstimate, threshold_px: float, unmatched: str
) -> CameraMotionEstimate | None:
    """``start`` with rotations and zooms; None where they do not explain the background either."""
    zooming = rotations_and_zooms(matches, start.K)
    H = homographies(start.K, zooming)
    keys = [match.key for match in matches]
    residual, explained = _explained(matches, np.linalg.inv(H[keys]) @ H, threshold_px)
    if explained < EXPLAINED_SHARE:
        return None
    widest = float(angle_deg(zooming.R[:1], zooming.R).max())
    return replace(
        start,
        motion="zooming",
        H_first_from_frame=H,
        R_first_from_frame=zooming.R,
        zoom=zooming.zoom,
        residual_px=residual,
        note=f"zooms from {zooming.zoom.min():.2f} to {zooming.zoom.max():.2f} times the first "
        f"frame's focal length and turns by up to {widest:.1f} degrees" + unmatched,
    )


def _solve_focal(matches: Sequence[Matches], size: tuple[int, int]) -> float | None:
    """Self-calibration of a rotating camera: the focal length (px) that makes the homographies
    rotations; None when the matches do not determine it.

    A pan moves all pixels by about focal length times angle, which does not determine the focal
    length; how the movement varies over the picture does. The frames that moved most relative to
    their key frame are used. The focal length counts as determined when changing it by the factor
    `FOCAL_STEP` either way raises the error.
    """
    moved = [_movement(match) for match in matches]
    least = MIN_MOVEMENT * max(size)
    chosen = [matches[i] for i in np.argsort(moved)[-FOCAL_FRAMES:] if moved[i] > least]
    if len(chosen) < 3:
        return None

    def error(log_focal: float) -> float:
        K = intrinsics(float(np.exp(log_focal)), size)
        fits = rotations_key_from_frame(chosen, K, K, rounds=2)[1]
        return float(np.mean([geman_mcclure(fit**2, 3.0)[0].mean() for fit in fits]))

    low, high = (np.log(factor * max(size)) for factor in FOCAL_RANGE)
    grid = np.linspace(low, high, 21)
    errors = [error(value) for value in grid]
    lowest = int(np.argmin(errors))
    if lowest in (0, len(grid) - 1):
        return None
    bounds = (grid[lowest - 1], grid[lowest + 1])
    best = minimize_scalar(error, bounds=bounds, method="bounded", options={"xatol": 2e-3})
    nearby = min(error(best.x - np.log(FOCAL_STEP)), error(best.x + np.log(FOCAL_STEP)))
    return float(np.exp(best.x)) if nearby > 1.2 * best.fun + 1e-4 else None


def _explained(
    matches: Sequence[Matches], H_key_from_frame: Float[np.ndarray, "T 3 3"], threshold_px: float
) -> tuple[float, float]:
    """Median error in pixels of the matches' inliers, and the median share of all matches that
    the homographies explain."""
    errors, shares = [], []
    for match, H in zip(matches[1:], H_key_from_frame[1:], strict=True):
        if match.inlier.any():
            error = np.linalg.norm(warp(H, match.xy_frame) - match.xy_key, axis=1)
            errors.append(float(np.median(error[match.inlier])))
            shares.append(float((error <= threshold_px).mean()))
    return (float(np.median(errors)), float(np.median(shares))) if errors else (0.0, 1.0)


def _movement(match: Matches) -> float:
    """Median movement of the inliers between the frame and its key frame, pixels."""
    if not match.inlier.any():
        return 0.0
    step = match.xy_frame[match.inlier] - match.xy_key[match.inlier]
    return float(np.median(np.linalg.norm(step, axis=1)))
