"""Boxes that stand about in a room: their parallax shows that a camera moves."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, UInt8

from benchmarks.synthetic.captured import place_camera
from benchmarks.synthetic.retargeting import RetargetedMotion
from imocap_core.body import Shaped
from imocap_core.camera.projection import camera_from_world, project_camera
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.render import draw_mesh
from imocap_core.synthetic import rooms
from imocap_core.synthetic.cameras import CameraPlacement, FilmCamera
from imocap_core.synthetic.choreography import outfit
from imocap_core.synthetic.rooms import PX_PER_M, Surface, backdrop, cast_shadow, render_plate

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


# A room large enough for a performer who moves about: floor and three walls.

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


# A body's motion rendered as a video: room, camera, clothes, and the ground truth.

SENSOR_NOISE = 2.0  # grey levels
SKIN_CHUNK = 16  # frames skinned together
SIDEWAYS = 0.5  # cosine of the angle between facing direction and camera: 60 degrees
FLOOR_QUANTILE = 0.1  # the soles are on the floor in at least this share of the frames


@dataclass(frozen=True)
class FilmedMotion:
    """A motion and a static camera (R, t: camera from world).

    joints: metres, z up, floor at 0. floor_m: height of the floor in the axes of the given motion.
    """

    motion: RetargetedMotion
    joints: Float[np.ndarray, "T 24 3"]
    K: Float[np.ndarray, "3 3"]
    R: Float[np.ndarray, "3 3"]
    t: Float[np.ndarray, "3"]
    size: tuple[int, int]
    azimuth_deg: float
    floor_m: float


def film_motion(
    motion: RetargetedMotion, shaped: Shaped, view: CameraPlacement, size: tuple[int, int]
) -> FilmedMotion:
    """A motion moved onto the floor, and a camera that has all of it in view."""
    vertices = np.stack(list(_skinned(motion, shaped)))
    floor = float(np.quantile(vertices[..., 2].min(axis=1), FLOOR_QUANTILE))
    down = np.array([0.0, 0.0, floor])
    on_floor = RetargetedMotion(motion.R_local, motion.transl - down)
    K, R, t = place_camera(view, vertices[:, ::50] - down, size)
    posed = shaped.pose(torch.as_tensor(on_floor.R_local), torch.as_tensor(on_floor.transl))
    joints = posed.joints.numpy()
    return FilmedMotion(on_floor, joints, K, R, t, size, view.azimuth_deg, floor)


def true_points_px(
    filmed: FilmedMotion, shaped: Shaped, layout: str
) -> tuple[Float[np.ndarray, "T K 2"], Float[np.ndarray, "T K"]]:
    """True pixels of a layout's keypoints on this body, and their depths in metres."""
    motion = filmed.motion
    posed = shaped.pose(torch.as_tensor(motion.R_local), torch.as_tensor(motion.transl))
    points = posed.keypoints(shaped.model.points(layout)).numpy()
    in_camera = camera_from_world(points, filmed.R, filmed.t)
    return project_camera(in_camera, filmed.K), in_camera[..., 2]


def viewed_side(
    joints: Float[np.ndarray, "T 24 3"], R: Float[np.ndarray, "3 3"], t: Float[np.ndarray, "3"]
) -> str:
    """The side of a body (z up) that faces the camera in most frames: front, side or back."""
    left, right = (SMPL_JOINTS.index(f"{side}_hip") for side in ("left", "right"))
    across = joints[:, left, :2] - joints[:, right, :2]
    ahead = np.stack([across[:, 1], -across[:, 0]], axis=1)  # across x up
    towards = (-R.T @ t)[:2] - joints[:, 0, :2]
    cosine = (ahead * towards).sum(axis=1) / (
        np.linalg.norm(ahead, axis=1) * np.linalg.norm(towards, axis=1)
    )
    middle = float(np.median(cosine))
    return "front" if middle > SIDEWAYS else "back" if middle < -SIDEWAYS else "side"


def render_frames(
    filmed: FilmedMotion, shaped: Shaped, kind: int, seed: int
) -> Iterator[UInt8[np.ndarray, "H W 3"]]:
    """The RGB frames in order: a room (kind 0 to 3), shadow, performer, sensor noise."""
    model = shaped.model
    if model.face_parts is None:
        raise ValueError(f"body model {model.name} has no face_parts: nothing to dress")
    clothes, grain = (np.random.default_rng([seed, kind, part]) for part in range(2))
    colors = outfit(model.face_parts.numpy(), model.part_names, clothes)
    faces = model.faces.numpy().astype(np.int64)
    K, R, t, (width, height) = filmed.K, filmed.R, filmed.t, filmed.size
    frames = len(filmed.joints)
    camera = FilmCamera(K, np.broadcast_to(R, (frames, 3, 3)), np.broadcast_to(t, (frames, 3)))
    path = filmed.joints.reshape(-1, 3)
    surfaces = large_room(kind, filmed.azimuth_deg, path, camera.centre, seed)
    room = backdrop(render_plate(surfaces, camera, filmed.size), K, R, filmed.size)
    noise = grain.normal(0.0, SENSOR_NOISE, (2 * height, 2 * width, 1)).astype(np.float32)
    for vertices in _skinned(filmed.motion, shaped):
        image = cast_shadow(room, vertices, K, R, t)
        image = draw_mesh(image, vertices, faces, colors, K, R, t)
        y, x = grain.integers(height), grain.integers(width)
        noisy = image + noise[y : y + height, x : x + width]
        yield np.clip(np.rint(noisy), 0, 255).astype(np.uint8)


def _skinned(motion: RetargetedMotion, shaped: Shaped) -> Iterator[Float[np.ndarray, "V 3"]]:
    """World vertices of each frame."""
    rotations, transl = torch.as_tensor(motion.R_local), torch.as_tensor(motion.transl)
    for start in range(0, len(transl), SKIN_CHUNK):
        part = slice(start, start + SKIN_CHUNK)
        yield from shaped.pose(rotations[part], transl[part]).mesh().vertices.numpy()
