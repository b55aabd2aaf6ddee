"""Cameras that film a performance: static, rotating about a fixed centre, or carried."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d

from imocap_core.body import Shaped
from imocap_core.camera.projection import camera_from_world, intrinsics, project_camera

_FOLLOW_S = 0.35  # how slowly the operator follows
_WANDER_KNOT_S = 1.2


@dataclass(frozen=True)
class CameraPlacement:
    """Position and operation of a camera. World: z up; the performer faces -y at the origin.

    azimuth_deg: 0 in front of the performer, 90 at the performer's left. focal_per_width: focal
    length divided by image width. aim_height_m: height of the point that a static camera is aimed
    at. follow: 0 for a tripod, else the share of the performer's movement that the operator
    follows. wander_deg: unsteadiness of a rotating camera (standard deviation of its pan).
    roll_deg: rotation about the optical axis.
    """

    azimuth_deg: float
    distance_m: float
    height_m: float
    focal_per_width: float
    aim_height_m: float = 0.95
    follow: float = 0.0
    wander_deg: float = 0.0
    roll_deg: float = 0.0


def stature_px(
    shaped: Shaped, focal_px: float, depth_m: Float[np.ndarray, "T K"]
) -> Float[np.ndarray, " T"]:
    """Standing height of a body in the picture, pixels, at the mean depth of its K points."""
    stature_m = float(np.ptp(shaped.vertices_rest[:, 1].numpy()))
    return focal_px * stature_m / depth_m.mean(axis=1)


@dataclass(frozen=True)
class FilmCamera:
    """One camera over a clip of T frames: x_cam = R_cam_from_world x_world + t."""

    K: Float[np.ndarray, "3 3"]
    R_cam_from_world: Float[np.ndarray, "T 3 3"]
    t: Float[np.ndarray, "T 3"]

    @property
    def centre(self) -> Float[np.ndarray, "3"]:
        """The camera centre in the world in the first frame: in every frame, unless it walks."""
        return self.centres[0]

    @property
    def centres(self) -> Float[np.ndarray, "T 3"]:
        """The camera centre in the world in every frame."""
        return -np.einsum("tji,tj->ti", self.R_cam_from_world, self.t)

    def pixels(
        self, points: Float[np.ndarray, "T *points 3"]
    ) -> tuple[Float[np.ndarray, "T *points 2"], Float[np.ndarray, "T *points"]]:
        """Pixels and depths of world points."""
        flat = points.reshape(len(points), -1, 3)
        in_camera = camera_from_world(flat, self.R_cam_from_world, self.t[:, None])
        pixels = project_camera(in_camera, self.K)
        return pixels.reshape(*points.shape[:-1], 2), in_camera[..., 2].reshape(points.shape[:-1])


# Four sides, near and wide to far and narrow, from the knee's height to above the head.
YOGA_CAMERAS: tuple[CameraPlacement, ...] = (
    CameraPlacement(38.0, 4.3, 1.25, 1.02, roll_deg=0.6),
    CameraPlacement(118.0, 3.6, 0.85, 0.76, follow=0.75, wander_deg=2.8, roll_deg=-1.2),
    CameraPlacement(214.0, 6.2, 2.1, 1.4, roll_deg=0.3),
    CameraPlacement(303.0, 4.9, 1.6, 1.06, follow=0.75, wander_deg=2.6, roll_deg=1.0),
)


def aim_camera(
    view: CameraPlacement,
    path: Float[np.ndarray, "T 3"],
    fps: float,
    size: tuple[int, int],
    rng: np.random.Generator,
) -> FilmCamera:
    """A camera aimed at a performer whose pelvis moves along a path, world metres."""
    frames = len(path)
    middle = np.append(np.median(path[:, :2], axis=0), view.aim_height_m)
    azimuth = np.deg2rad(view.azimuth_deg)
    outward = np.array([np.sin(azimuth), -np.cos(azimuth), 0.0])
    centre = middle * (1, 1, 0) + view.distance_m * outward + (0, 0, view.height_m)
    slow = gaussian_filter1d(path, _FOLLOW_S * fps, axis=0, mode="nearest")
    target = middle + view.follow * (slow - middle)
    shake = _wander(frames, fps, view.wander_deg, rng)
    R = np.stack(
        [
            look_at(centre, aim, view.roll_deg + s[2], s[:2])
            for aim, s in zip(target, shake, strict=True)
        ]
    )
    return FilmCamera(intrinsics(view.focal_per_width * size[0], size), R, -(R @ centre))


def look_at(
    centre: Float[np.ndarray, "3"],
    target: Float[np.ndarray, "3"],
    roll_deg: float,
    turn_deg: Float[np.ndarray, "2"],
) -> Float[np.ndarray, "3 3"]:
    """R_cam_from_world of a camera that looks at a target, the world's z upright in the picture.

    roll_deg about the optical axis, then turn_deg = (pan, tilt) away from the target.
    """
    forward = (target - centre) / np.linalg.norm(target - centre)
    right = np.cross(forward, (0.0, 0.0, 1.0))
    right /= np.linalg.norm(right)
    upright = np.stack([right, np.cross(forward, right), forward])
    pan, tilt, roll = np.deg2rad([*turn_deg, roll_deg])
    about_y = np.array([[np.cos(pan), 0, -np.sin(pan)], [0, 1, 0], [np.sin(pan), 0, np.cos(pan)]])
    about_x = np.array(
        [[1, 0, 0], [0, np.cos(tilt), np.sin(tilt)], [0, -np.sin(tilt), np.cos(tilt)]]
    )
    about_z = np.array(
        [[np.cos(roll), np.sin(roll), 0], [-np.sin(roll), np.cos(roll), 0], [0, 0, 1]]
    )
    return about_z @ about_x @ about_y @ upright


def _wander(
    frames: int, fps: float, sigma_deg: float, rng: np.random.Generator
) -> Float[np.ndarray, "T 3"]:
    """Smooth random pan, less tilt and little roll, degrees."""
    knots = max(4, round(frames / fps / _WANDER_KNOT_S) + 2)
    values = sigma_deg * np.clip(rng.normal(size=(knots, 3)), -2, 2) * (1.0, 0.4, 0.2)
    return CubicSpline(np.linspace(0, frames - 1, knots), values)(np.arange(frames))
