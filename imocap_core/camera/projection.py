"""The pinhole camera, and the distortion of a lens: points to pixels, pixels to rays.

Camera axes are OpenCV's (x right, y down, z forward): ``x_cam = R_cam_from_world @ x_world + t``,
``K`` is 3x3 in pixels, there is no lens distortion.

Distortion of a lens: OpenCV's radial and tangential polynomial, and its inverse. A ray at ``(x,
y)`` of the normalised picture, r^2 = x^2 + y^2, is seen at ``x (1 + k1 r^2 + k2 r^4 + k3 r^6) + 2
p1 x y + p2 (r^2 + 2 x^2)``, and likewise y (Brown 1966). A polynomial turns back on itself at some
radius; beyond it the displacement's factor is that of this radius, so that every ray has one pixel
and every pixel one ray.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float


def intrinsics(focal_px: float, size: tuple[int, int]) -> Float[np.ndarray, "3 3"]:
    """Intrinsic matrix K of square pixels, principal point in the middle of the picture.

    Args:
        focal_px: focal length in pixels. size: (width, height) of the picture.

    Raises:
        ValueError: the focal length is not positive.
    """
    if not focal_px > 0:
        raise ValueError(f"focal_px: expected a positive number of pixels, got {focal_px}")
    width, height = size
    return np.array(
        [[focal_px, 0.0, (width - 1) / 2], [0.0, focal_px, (height - 1) / 2], [0.0, 0.0, 1.0]]
    )


def camera_from_world(
    x_world: Float[np.ndarray, "... 3"],
    R_cam_from_world: Float[np.ndarray, "... 3 3"],
    t: Float[np.ndarray, "... 3"],
) -> Float[np.ndarray, "... 3"]:
    """World points in camera axes, in the unit of ``t``."""
    return x_world @ np.swapaxes(R_cam_from_world, -1, -2) + t


def project_camera(
    x_cam: Float[np.ndarray, "... 3"], K: Float[np.ndarray, "3 3"]
) -> Float[np.ndarray, "... 2"]:
    """Perspective projection of points in camera axes to pixels; NaN behind the camera."""
    depth = np.where(x_cam[..., 2:] > 0, x_cam[..., 2:], np.nan)
    return (x_cam / depth) @ K[:2].T


def project(
    x_world: Float[np.ndarray, "... 3"],
    K: Float[np.ndarray, "3 3"],
    R_cam_from_world: Float[np.ndarray, "... 3 3"],
    t: Float[np.ndarray, "... 3"],
) -> Float[np.ndarray, "... 2"]:
    """Perspective projection of world points to pixels; NaN behind the camera."""
    return project_camera(camera_from_world(x_world, R_cam_from_world, t), K)


def normalised(
    xy_px: Float[np.ndarray, "... 2"], K: Float[np.ndarray, "3 3"]
) -> Float[np.ndarray, "... 2"]:
    """Normalised image coordinates ``(x/z, y/z)`` of pixels."""
    K_inverse = np.asarray(np.linalg.inv(K), dtype=np.float64)
    return warp(K_inverse, xy_px)


def rays(
    xy_px: Float[np.ndarray, "... 2"], K: Float[np.ndarray, "3 3"]
) -> Float[np.ndarray, "... 3"]:
    """Unit direction vectors through pixels, in camera axes."""
    plane = normalised(xy_px, K)
    direction = np.concatenate([plane, np.ones_like(plane[..., :1])], axis=-1)
    return direction / np.linalg.norm(direction, axis=-1, keepdims=True)


def warp(
    H_b_from_a: Float[np.ndarray, "... 3 3"], xy_a: Float[np.ndarray, "... 2"]
) -> Float[np.ndarray, "... 2"]:
    """Homographies applied to points; both broadcast, NaN stays NaN."""
    homogeneous = np.concatenate([xy_a, np.ones_like(xy_a[..., :1])], axis=-1)
    moved = np.einsum("...ij,...j->...i", H_b_from_a, homogeneous)
    return moved[..., :2] / moved[..., 2:]


ORDERS = (2, 4, 1, 1, 6)  # of k1, k2, p1, p2, k3 in the focal length
FARTHEST = 1e3  # radius of the straight continuation, in focal lengths
NEWTON_STEPS, TANGENTIAL_STEPS = 3, 10
GRID = 256


def frame_projections(
    H_first_from_frame: Float[np.ndarray, "T 3 3"], K: Float[np.ndarray, "3 3"]
) -> Float[np.ndarray, "T 3 3"]:
    """From metres in the first frame's camera axes to homogeneous pixels of every frame:
    H_first_from_frame^-1 K, scaled so that the third coordinate is the depth for a camera that
    turns on the spot."""
    H_frame_from_first = np.linalg.inv(H_first_from_frame)
    scale = np.cbrt(np.linalg.det(H_frame_from_first))[:, None, None]
    return np.asarray(H_frame_from_first / scale @ K)


@dataclass(frozen=True, eq=False)
class Lens:
    """A lens with distortion.

    Attributes:
        coefficients: (5,) OpenCV's k1, k2, p1, p2, k3, relative to the focal length.
        K: (3, 3) intrinsics that they belong to, pixels.
    """

    coefficients: Float[np.ndarray, " 5"]
    K: Float[np.ndarray, "3 3"]

    @classmethod
    def of(cls, coefficients: Sequence[float], K: Float[np.ndarray, "3 3"]) -> Lens:
        """From the first of OpenCV's coefficients; those left out are 0."""
        filled = np.zeros(5)
        filled[: len(coefficients)] = coefficients
        return cls(filled, K)

    def relative_to(self, K: Float[np.ndarray, "3 3"]) -> Lens:
        """The same displacement of pixels, as coefficients of another focal length."""
        scale = (K[0, 0] / self.K[0, 0]) ** np.array(ORDERS)
        return Lens(self.coefficients * scale, K)

    def rescaled(self, scale: float) -> Lens:
        """The lens of pictures made smaller by ``scale``."""
        K = self.K.copy()
        K[:2] *= scale
        K[:2, 2] += 0.5 * scale - 0.5  # pixel (0, 0) is the middle of the first pixel
        return Lens(self.coefficients, K)

    @cached_property
    def reach(self) -> float:
        """Radius of the farthest ray that the polynomial shows, in focal lengths; infinite where it
        never turns back."""
        k1, k2, _, _, k3 = self.coefficients
        roots = np.roots(np.array([7 * k3, 5 * k2, 3 * k1, 1.0]))  # r^2 where the slope is 0
        turning = roots[(np.abs(roots.imag) < 1e-9) & (roots.real > 0)].real
        return float(np.sqrt(turning.min())) if len(turning) else np.inf

    @property
    def reach_px(self) -> float:
        """How far from the middle the farthest of these rays is seen."""
        if not np.isfinite(self.reach):
            return np.inf
        return float(self.K[0, 0] * self.reach * self._factor(np.array(self.reach)))

    def distorted(self, xy_px: Float[np.ndarray, "*N 2"]) -> Float[np.ndarray, "*N 2"]:
        """Where the lens shows pixels of an ideal pinhole camera; NaN stays."""
        flat = normalised(xy_px, self.K)
        radius = np.linalg.norm(flat, axis=-1, keepdims=True)
        return self._pixels(flat * self._factor(radius) + self._tangential(flat))

    def undistorted(self, xy_px: Float[np.ndarray, "*N 2"]) -> Float[np.ndarray, "*N 2"]:
        """Pixels as an ideal pinhole camera would show them; NaN stays."""
        shown = normalised(xy_px, self.K)
        flat = self._without_radial(shown)
        if self.coefficients[2:4].any():
            for _ in range(TANGENTIAL_STEPS):
                flat = self._without_radial(shown - self._tangential(flat))
        return self._pixels(flat)

    def bent(
        self, points: Float[np.ndarray, "*N 3"], P: Float[np.ndarray, "3 3"]
    ) -> Float[np.ndarray, "*N 3"]:
        """Points moved across their depth, so that ``P`` shows them where the lens does.

        Args:
            P: from the points' axes to homogeneous pixels of an ideal picture, ``K`` for points in
                the camera's axes. Points that are not ahead of it stay.
        """
        homogeneous = points @ P.T
        depth = homogeneous[..., 2:]
        shown = self.distorted(homogeneous[..., :2] / np.where(depth > 0, depth, np.nan))
        moved = np.concatenate([shown * depth, depth], axis=-1) @ np.linalg.inv(P).T
        return np.where(np.isfinite(moved).all(axis=-1, keepdims=True), moved, points)

    def _pixels(self, flat: Float[np.ndarray, "*N 2"]) -> Float[np.ndarray, "*N 2"]:
        return np.asarray(flat * self.K[[0, 1], [0, 1]] + self.K[:2, 2])

    def _factor(self, radius: Float[np.ndarray, "*N"]) -> Float[np.ndarray, "*N"]:
        """Displacement by the radial terms, over the radius."""
        k1, k2, _, _, k3 = self.coefficients
        r2 = np.minimum(radius, min(self.reach, FARTHEST)) ** 2
        return np.asarray(1 + r2 * (k1 + r2 * (k2 + r2 * k3)))

    def _tangential(self, flat: Float[np.ndarray, "*N 2"]) -> Float[np.ndarray, "*N 2"]:
        p = self.coefficients[[3, 2]]  # p2 goes with x, p1 with y
        if not p.any():
            return np.zeros_like(flat)
        inside = np.clip(flat, -min(self.reach, FARTHEST), min(self.reach, FARTHEST))
        r2 = (inside**2).sum(axis=-1, keepdims=True)
        cross = 2 * inside[..., :1] * inside[..., 1:]
        return np.asarray(p * (r2 + 2 * inside**2) + p[::-1] * cross)

    def _without_radial(self, shown: Float[np.ndarray, "*N 2"]) -> Float[np.ndarray, "*N 2"]:
        """The inverse of the radial terms: a table, then Newton's method on the radius."""
        radius = np.linalg.norm(shown, axis=-1, keepdims=True)
        widest = float(np.nanmax(radius, initial=0.0)) if np.isfinite(radius).any() else 0.0
        last = self._farthest_seen_by(widest)
        table = np.linspace(0.0, last, GRID)
        straight = np.interp(radius, table * self._factor(table), table)
        for _ in range(NEWTON_STEPS):
            step = (straight * self._factor(straight) - radius) / self._slope(straight)
            straight = np.clip(straight - step, 0.0, last)
        beyond = radius / self._factor(np.array(last))
        straight = np.where(radius >= last * self._factor(np.array(last)), beyond, straight)
        return shown * np.where(radius > 0, straight / np.where(radius > 0, radius, 1.0), 1.0)

    def _farthest_seen_by(self, radius: float) -> float:
        """A radius of rays that is seen at `radius` or further out, or the reach."""
        far = max(radius, 1e-6)
        while far < min(self.reach, FARTHEST) and far * self._factor(np.array(far)) < radius:
            far *= 1.5
        return min(far, self.reach, FARTHEST)

    def _slope(self, radius: Float[np.ndarray, "*N"]) -> Float[np.ndarray, "*N"]:
        """Derivative of the seen radius by the ray's."""
        k1, k2, _, _, k3 = self.coefficients
        r2 = radius**2
        return np.maximum(1 + r2 * (3 * k1 + r2 * (5 * k2 + r2 * 7 * k3)), 1e-3)


def lens_of_corner(
    distortion: float, sd: float, K: Float[np.ndarray, "3 3"], size: tuple[int, int]
) -> tuple[Lens, float]:
    """The lens of one coefficient that is given for a focal length of half the picture's diagonal,
    relative to K's, and the standard deviation of its k1."""
    scale = (K[0, 0] / np.linalg.norm((np.array(size) - 1) / 2)) ** 2
    return Lens.of([distortion * scale], K), float(sd * scale)
