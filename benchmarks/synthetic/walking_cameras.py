"""Cameras that leave their place: carried by somebody who walks, or moved along a path."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d

from imocap_core.camera.projection import intrinsics
from imocap_core.synthetic.cameras import CameraPlacement, FilmCamera, look_at

FOLLOW_S = 0.35  # how slowly the operator follows
STEP_HZ = 1.8  # steps a second of somebody who walks
BOB_M = 0.02  # rise and fall of a carried camera
SHAKE_KNOT_S = 0.4


@dataclass(frozen=True)
class CameraWalk:
    """How far a camera moves from the place of a `CameraPlacement` over a video.

    Attributes:
        sideways_m: along the circle about the performer; ahead_m: towards the performer.
        shake_deg: unsteadiness of the hand (standard deviation of pan); bob: whether the camera
            rises and falls with the steps.
        bend: 0 walks at an even pace; 1 walks there and back.
    """

    sideways_m: float
    ahead_m: float = 0.0
    shake_deg: float = 0.5
    bob: bool = True
    bend: float = 0.0


def walk_camera(
    view: CameraPlacement,
    walk: CameraWalk,
    path: Float[np.ndarray, "T 3"],
    fps: float,
    size: tuple[int, int],
    rng: np.random.Generator,
) -> FilmCamera:
    """A camera that walks while it is aimed at a performer whose pelvis moves along a path."""
    frames = len(path)
    middle = np.append(np.median(path[:, :2], axis=0), view.aim_height_m)
    share = _progress(frames, walk.bend)
    azimuth = np.deg2rad(view.azimuth_deg) + walk.sideways_m * share / view.distance_m
    radius = view.distance_m - walk.ahead_m * share
    outward = np.stack([np.sin(azimuth), -np.cos(azimuth), np.zeros(frames)], axis=1)
    height = np.full(frames, view.height_m)
    if walk.bob:
        height += BOB_M * np.sin(2 * np.pi * STEP_HZ * np.arange(frames) / fps + rng.uniform(0, 6))
    centre = middle * (1, 1, 0) + radius[:, None] * outward
    centre[:, 2] = height
    slow = gaussian_filter1d(path, FOLLOW_S * fps, axis=0, mode="nearest")
    target = middle + view.follow * (slow - middle)
    shake = _shake(frames, fps, walk.shake_deg, rng)
    R = np.stack(
        [
            look_at(c, aim, view.roll_deg + s[2], s[:2])
            for c, aim, s in zip(centre, target, shake, strict=True)
        ]
    )
    t = -np.einsum("tij,tj->ti", R, centre)
    return FilmCamera(intrinsics(view.focal_per_width * size[0], size), R, t)


def _progress(frames: int, bend: float) -> Float[np.ndarray, " T"]:
    """From 0 to 1, or to 1 and back, with a soft start and end."""
    even = np.linspace(0.0, 1.0, frames)
    there = even**2 * (3 - 2 * even)
    return (1 - bend) * there + bend * np.sin(np.pi * even) ** 2


def _shake(
    frames: int, fps: float, sigma_deg: float, rng: np.random.Generator
) -> Float[np.ndarray, "T 3"]:
    """Smooth random pan, tilt and roll, degrees."""
    knots = max(4, round(frames / fps / SHAKE_KNOT_S) + 2)
    values = sigma_deg * np.clip(rng.normal(size=(knots, 3)), -2, 2) * (1.0, 0.7, 0.4)
    return CubicSpline(np.linspace(0, frames - 1, knots), values)(np.arange(frames))
