"""A room large enough for a performer who moves about: floor and three walls."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, UInt8

from imocap_core.synthetic import rooms
from imocap_core.synthetic.rooms import PX_PER_M, Surface

HEIGHT_M = 4.2
BEHIND_M = 1.5  # from the performer's furthest point to the back wall
BESIDE_M = 2.0  # from the performer and the camera to the side walls
KINDS = 4  # wooden floor and bricks, tiles and plaster, carpet and planks, lawn and stone


def large_room(
    kind: int,
    azimuth_deg: float,
    path: Float[np.ndarray, "N D"],
    camera: Float[np.ndarray, "3"],
    seed: int,
) -> list[Surface]:
    """The surfaces of a room that contains a path and a camera.

    Args:
        kind: 0 to 3. azimuth_deg: of the camera, as in cameras.CameraPlacement.
        path: positions of the performer, 2D or 3D, metres. camera: centre of the camera.
        seed: of the textures and of the room's size.
    """
    rng = np.random.default_rng([seed, kind])
    azimuth = np.deg2rad(azimuth_deg)
    back = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])  # away from the camera
    right = np.array([back[1], -back[0], 0.0])
    up = np.array([0.0, 0.0, 1.0])
    along, across = path[:, :2] @ back[:2], path[:, :2] @ right[:2]
    depth = float(along.max()) + BEHIND_M + rng.uniform(0, 1)
    front = max(float(-(camera @ back)), -float(along.min())) + 1.0
    half = float(np.abs([*across, camera @ right]).max()) + BESIDE_M + rng.uniform(0, 1)
    floor_shape = _pixels(front + depth, 2 * half)
    wall_shape, side_shape = _pixels(HEIGHT_M, 2 * half), _pixels(HEIGHT_M, front + depth)
    walls = [_wall(kind, shape, rng) for shape in (wall_shape, side_shape, side_shape)]
    far_left, far_right = depth * back - half * right, depth * back + half * right
    near_left = far_left - (depth + front) * back
    return [
        Surface(_floor(kind, floor_shape, rng), far_left, right, -back),
        Surface(walls[0], far_left + HEIGHT_M * up, right, -up),
        Surface(walls[1], near_left + HEIGHT_M * up, back, -up),
        Surface(walls[2], far_right + HEIGHT_M * up, -back, -up),
    ]


def _pixels(height_m: float, width_m: float) -> tuple[int, int]:
    return int(height_m * PX_PER_M), int(width_m * PX_PER_M)


def _floor(
    kind: int, shape: tuple[int, int], rng: np.random.Generator
) -> UInt8[np.ndarray, "H W 3"]:
    if kind == 0:
        return rooms.planks(shape, 22, (150, 112, 78), rng)
    if kind == 1:
        return rooms.checks(shape, 60, ((208, 202, 190), (96, 104, 112)), rng)
    color, contrast = (((92, 108, 138), 0.5), ((88, 122, 62), 0.6))[kind - 2]
    return rooms.tinted(rooms.noise(shape, 15, 4, rng), color, contrast)


def _wall(
    kind: int, shape: tuple[int, int], rng: np.random.Generator
) -> UInt8[np.ndarray, "H W 3"]:
    if kind == 0:
        wall = rooms.bricks(shape, (16, 40), (158, 84, 66), (178, 170, 160), rng)
    elif kind == 1:
        wall = rooms.tinted(rooms.noise(shape, 30, 5, rng), (122, 148, 140), 0.3)
    elif kind == 2:
        wall = rooms.planks(shape, 30, (196, 168, 122), rng)
    else:
        wall = rooms.bricks(shape, (34, 62), (150, 146, 136), (96, 100, 92), rng, 0.3)
    return rooms.hang_pictures(wall, max(2, shape[1] // 260), rng)
