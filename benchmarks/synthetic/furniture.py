"""Boxes that stand about in a room: their parallax shows that a camera moves."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from imocap_core.synthetic import rooms
from imocap_core.synthetic.rooms import PX_PER_M, Surface

CLEAR_M = 1.3  # about the performer
OUT_OF_VIEW = 0.35  # cosine to the camera's direction: nothing stands in front of the performer


def furniture(
    azimuth_deg: float, count: int, rng: np.random.Generator, reach_m: float = 3.2
) -> list[Surface]:
    """Textured boxes on the floor, behind and beside the performer as the camera sees them.

    Args:
        azimuth_deg: of the camera, as in cameras.CameraPlacement.
        reach_m: furthest box from the performer.
    """
    towards = np.deg2rad(azimuth_deg)
    camera = np.array([np.sin(towards), -np.cos(towards)])
    surfaces: list[Surface] = []
    for _ in range(count):
        while True:
            angle, radius = rng.uniform(0, 2 * np.pi), rng.uniform(CLEAR_M, reach_m)
            spot = radius * np.array([np.cos(angle), np.sin(angle)])
            if spot @ camera < OUT_OF_VIEW * radius:
                break
        size = rng.uniform((0.3, 0.3, 0.4), (0.7, 0.7, 1.3))
        surfaces += box(np.append(spot, 0.0), size, float(rng.uniform(0, np.pi)), rng)
    return surfaces


def box(
    foot: Float[np.ndarray, "3"],
    size_m: Float[np.ndarray, "3"],
    turn_rad: float,
    rng: np.random.Generator,
) -> list[Surface]:
    """The four sides and the top of an upright box; foot: middle of its base."""
    wide, deep, high = size_m
    cos, sin = np.cos(turn_rad), np.sin(turn_rad)
    along, across = np.array([cos, sin, 0.0]), np.array([-sin, cos, 0.0])
    up = np.array([0.0, 0.0, 1.0])
    color = tuple(int(c) for c in rng.integers(60, 220, 3))
    corners = [
        foot + a * wide / 2 * along + b * deep / 2 * across
        for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))
    ]
    surfaces = []
    sides = ((along, wide), (across, deep), (-along, wide), (-across, deep))
    for corner, (direction, length) in zip(corners, sides, strict=True):
        texture = _texture(high, length, color, rng)
        surfaces.append(Surface(texture, corner + high * up, direction, -up))
    top = _texture(deep, wide, color, rng)
    surfaces.append(Surface(top, corners[0] + high * up, along, across))
    return surfaces


def _texture(
    height_m: float, width_m: float, color: tuple[int, ...], rng: np.random.Generator
) -> np.ndarray:
    shape = (max(8, int(height_m * PX_PER_M)), max(8, int(width_m * PX_PER_M)))
    base = rooms.tinted(rooms.noise(shape, 24, 4, rng), (color[0], color[1], color[2]), 0.7)
    return rooms.hang_pictures(base, 1, rng) if min(shape) > PX_PER_M // 2 else base
