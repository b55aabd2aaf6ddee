"""A camera that turns on the spot: its rotations, its focal length, and whether it really does.

For a camera that only rotates, pixels of two frames are related by ``H = K R K^-1`` whatever the
scene looks like. Fitting R to matched rays (three numbers) instead of H (eight) is stiffer, and
the pixels it leaves unexplained tell a turning camera from one that moves.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from imocap_core.camera.averaging import angle_deg, nearest_rotation
from imocap_core.camera.background import Matches, chain
from imocap_core.camera.projection import intrinsics, project_camera, rays, warp
from imocap_core.camera.zooming import homographies, zoom_and_turn
from imocap_core.robust import geman_mcclure, geman_mcclure_weight

Array = NDArray[np.float64]
Motion = Literal["static", "rotating", "zooming", "translating", "unknown"]
FocalSource = Literal["given", "rotation", "assumed"]

STATIC_PX = 0.6  # of a picture 1000 pixels large: less movement than this is none
FOCAL_RANGE = (0.35, 5.0)  # of the larger side of the picture
MIN_TURN = 0.05  # of the larger side: less movement says nothing reliable about the focal length
FOCAL_STEP = 1.15  # the data know the focal length if a change by this factor shows
EXPLAINED_SHARE = 0.6  # of the background a turning camera must explain


@dataclass(frozen=True)
class Turning:
    """A camera's own motion. ``H`` and ``R`` (T, 3, 3) take each frame to the first one; ``K`` is
    the first frame's, and ``zoom`` (T,) each frame's focal length over that one."""

    K: Array
    focal_source: FocalSource
    motion: Motion
    H_first_from_frame: Array
    R_first_from_frame: Array
    zoom: Array
    inliers: NDArray[np.int64]
    residual_px: float
    note: str


def standing_still(
    frames: int, size: tuple[int, int], focal_px: float | None, factor: float
) -> Turning:
    """A camera about whose motion nothing is known: held to stand still, and said so.

    Its focal length is the given one, or ``factor`` times the larger side of the picture.
    """
    still = np.tile(np.eye(3), (frames, 1, 1))
    return Turning(
        K=intrinsics(focal_px or factor * max(size), size),
        focal_source="given" if focal_px else "assumed",
        motion="unknown",
        H_first_from_frame=still,
        R_first_from_frame=still.copy(),
        zoom=np.ones(frames),
        inliers=np.zeros(frames, np.int64),
        residual_px=0.0,
        note="there is no video to look at, so the camera is taken to stand still",
    )


def camera_turning(
    matches: list[Matches],
    size: tuple[int, int],
    focal_px: float | None,
    *,
    assumed_focal_factor: float,
    threshold_px: float,
) -> Turning:
    """Motion, rotations and focal length of one camera from its matched background.

    ``matches`` hold pixels of the full picture of ``size`` (width, height). A given ``focal_px`` is
    kept; otherwise it is solved when the camera turns enough, or assumed as
    ``assumed_focal_factor`` times the larger side. ``threshold_px`` is how far a point may be off
    and still count as explained.
    """
    inliers = np.array([int(match.inlier.sum()) for match in matches], dtype=np.int64)
    still = replace(
        standing_still(len(matches), size, focal_px, assumed_focal_factor), inliers=inliers
    )
    lost = int((inliers == 0).sum())
    said = f"; {lost} of {len(matches)} frames could not be matched and are held" if lost else ""
    if lost > len(matches) // 2:
        why = "the background shows too little to follow, so the camera is taken to stand still"
        return replace(still, note=why)
    movement = [_movement(match) for match in matches]
    if np.quantile(movement, 0.95) < STATIC_PX * max(size) / 1000.0:
        residual = float(np.median(movement))
        return replace(still, motion="static", residual_px=residual, note="stands still" + said)
    solved = None if focal_px else solve_focal(matches, size)
    if solved:
        solved_start = replace(still, K=intrinsics(solved, size), focal_source="rotation")
        turning = _turning(matches, solved_start, threshold_px, said)
        if turning.motion == "rotating":  # else the focal length explains what is no rotation
            return turning
    return _turning(matches, still, threshold_px, said)


def _turning(matches: list[Matches], start: Turning, threshold_px: float, said: str) -> Turning:
    """``start`` with its rotations, with zooms too where these alone do not explain the background,
    or with plain homographies where neither does."""
    K = start.K
    turned = np.stack([rotation_key_from_frame(match, K)[0] for match in matches])
    R = chain(matches, turned)
    residual, explained = _explained(matches, K @ turned @ np.linalg.inv(K), threshold_px)
    if explained >= EXPLAINED_SHARE:
        widest = float(angle_deg(R[:1], R).max())
        return replace(
            start,
            motion="rotating",
            H_first_from_frame=K @ R @ np.linalg.inv(K),
            R_first_from_frame=R,
            residual_px=residual,
            note=f"turns by up to {widest:.1f} degrees" + said,
        )
    zooming = _zooming(matches, start, threshold_px, said)
    if zooming is not None:
        return zooming
    H = chain(matches, np.stack([match.H_key_from_frame for match in matches]))
    return replace(
        start,
        motion="translating",
        H_first_from_frame=H / H[:, 2:, 2:],
        R_first_from_frame=R,
        residual_px=residual,
        note=f"turning explains only {explained:.0%} of the background ({residual:.1f} px off): "
        "the camera moves, and keypoints are warped by plain homographies" + said,
    )


def _zooming(
    matches: list[Matches], start: Turning, threshold_px: float, said: str
) -> Turning | None:
    """``start`` with rotations and zooms; None where they do not explain the background either."""
    found = zoom_and_turn(matches, start.K)
    H = homographies(start.K, found)
    keys = [match.key for match in matches]
    residual, explained = _explained(matches, np.linalg.inv(H[keys]) @ H, threshold_px)
    if explained < EXPLAINED_SHARE:
        return None
    widest = float(angle_deg(found.R[:1], found.R).max())
    return replace(
        start,
        motion="zooming",
        H_first_from_frame=H,
        R_first_from_frame=found.R,
        zoom=found.zoom,
        residual_px=residual,
        note=f"zooms from {found.zoom.min():.2f} to {found.zoom.max():.2f} times the first frame's "
        f"focal length and turns by up to {widest:.1f} degrees" + said,
    )


def rotation_key_from_frame(match: Matches, K: Array, *, rounds: int = 4) -> tuple[Array, Array]:
    """R_key_from_frame (3, 3) of one frame, and its error (N,) in pixels at every match.

    Robust Wahba problem: rays of the frame turned onto rays of the key frame.
    """
    if not match.inlier.any():
        H = np.linalg.inv(K) @ match.H_key_from_frame @ K
        return nearest_rotation(H / np.cbrt(np.linalg.det(H))), np.zeros(0)
    ray_key, ray_frame = rays(match.xy_key, K), rays(match.xy_frame, K)
    weight = match.inlier.astype(np.float64)
    R, error = np.eye(3), np.zeros(len(weight))
    for _ in range(rounds):
        R = nearest_rotation((ray_key * weight[:, None]).T @ ray_frame)
        error = np.linalg.norm(project_camera(ray_frame @ R.T, K) - match.xy_key, axis=1)
        error = np.where(np.isfinite(error), error, 1e3)
        scale = max(0.3, 2.0 * float(np.median(error[match.inlier])))
        weight = match.inlier * geman_mcclure_weight(error, scale)
    return R, error


def solve_focal(matches: list[Matches], size: tuple[int, int], *, frames: int = 30) -> float | None:
    """Focal length in pixels that makes the homographies rotations; None when it does not show.

    A pan moves all pixels by about focal times angle, which says nothing about the focal length;
    how the movement changes over the picture does. The frames that moved most against their key
    frame are used. It shows when a change by `FOCAL_STEP` either way raises the error visibly.
    """
    moved = [_movement(match) for match in matches]
    chosen = [matches[i] for i in np.argsort(moved)[-frames:] if moved[i] > MIN_TURN * max(size)]
    if len(chosen) < 3:
        return None

    def error(log_focal: float) -> float:
        K = intrinsics(float(np.exp(log_focal)), size)
        fits = [rotation_key_from_frame(m, K, rounds=2)[1][m.inlier] for m in chosen]
        return float(np.mean([geman_mcclure(fit**2, 3.0)[0].mean() for fit in fits]))

    low, high = (np.log(factor * max(size)) for factor in FOCAL_RANGE)
    grid = np.linspace(low, high, 21)
    errors = [error(value) for value in grid]
    at = int(np.argmin(errors))
    if at in (0, len(grid) - 1):
        return None
    best = minimize_scalar(
        error, bounds=(grid[at - 1], grid[at + 1]), method="bounded", options={"xatol": 2e-3}
    )
    nearby = min(error(best.x - np.log(FOCAL_STEP)), error(best.x + np.log(FOCAL_STEP)))
    return float(np.exp(best.x)) if nearby > 1.2 * best.fun + 1e-4 else None


def _explained(
    matches: list[Matches], H_key_from_frame: Array, threshold_px: float
) -> tuple[float, float]:
    """Median error in pixels at the matches' inliers, and the median share of all matches that
    the homographies (T, 3, 3) explain."""
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
