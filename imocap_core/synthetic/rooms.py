"""Textured rooms and their pictures from a rotating camera.

All frames of a camera that only rotates share one centre of projection: the room is ray-cast once
onto a plate wide enough for all frames, and every frame is a homography of that plate,
K R_t R_plate^T K_plate^-1.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from imocap_core.synthetic.cameras import FilmCamera

Color = tuple[int, int, int]

PX_PER_M = 150


def noise(
    shape: tuple[int, int], cell_px: float, octaves: int, rng: np.random.Generator
) -> Float[np.ndarray, "H W"]:
    """Value noise: a smooth random field of about zero mean and unit range, finer by octaves."""
    field = np.zeros(shape, np.float32)
    for octave in range(octaves):
        cell = max(cell_px / 2**octave, 1.0)
        grid = rng.random((int(shape[0] / cell) + 2, int(shape[1] / cell) + 2), dtype=np.float32)
        field += cv2.resize(grid, shape[::-1], interpolation=cv2.INTER_CUBIC) * 0.5**octave
    return (field - field.mean()) / (np.ptp(field) + 1e-6) * 2


def tinted(
    field: Float[np.ndarray, "H W"], color: Color, contrast: float
) -> UInt8[np.ndarray, "H W 3"]:
    """A field as brightness variations of one color."""
    return _to_image(np.asarray(color) * (1.0 + contrast * field[..., None]))


def bricks(
    shape: tuple[int, int],
    brick_px: tuple[int, int],
    color: Color,
    joint: Color,
    rng: np.random.Generator,
    variety: float = 0.22,
) -> UInt8[np.ndarray, "H W 3"]:
    """Courses of bricks (height, width), shifted by half a brick, of varying brightness."""
    high, wide = brick_px
    rows, columns = np.mgrid[0 : shape[0], 0 : shape[1]]
    course = rows // high
    shifted = columns + (course % 2) * (wide // 2)
    tone = rng.normal(1.0, variety, (shape[0] // high + 1, shape[1] // wide + 3))
    surface = np.asarray(color) * tone[course, shifted // wide][..., None]
    gap = max(2, high // 14)
    surface[(rows % high < gap) | (shifted % wide < gap)] = joint
    return _to_image(surface * (1.0 + 0.25 * noise(shape, 24, 4, rng)[..., None]))


def planks(
    shape: tuple[int, int], plank_px: int, color: Color, rng: np.random.Generator
) -> UInt8[np.ndarray, "H W 3"]:
    """Wooden boards along the second axis, with grain."""
    surface = bricks(shape, (plank_px, plank_px * 9), color, (40, 30, 22), rng, variety=0.13)
    grain = cv2.resize(noise((shape[0], max(2, shape[1] // 12)), 6, 3, rng), shape[::-1])
    return _to_image(surface * (1.0 + 0.22 * grain[..., None]))


def checks(
    shape: tuple[int, int], tile_px: int, colors: tuple[Color, Color], rng: np.random.Generator
) -> UInt8[np.ndarray, "H W 3"]:
    """Tiles of two colors with marbled faces and dark joints."""
    rows, columns = np.mgrid[0 : shape[0], 0 : shape[1]]
    odd = (rows // tile_px + columns // tile_px) % 2
    surface = np.asarray(colors, np.float32)[odd]
    surface *= rng.normal(1.0, 0.08, (shape[0] // tile_px + 1, shape[1] // tile_px + 1))[
        rows // tile_px, columns // tile_px
    ][..., None]
    surface[(rows % tile_px < 3) | (columns % tile_px < 3)] = 60
    return _to_image(surface * (1.0 + 0.25 * noise(shape, 60, 5, rng)[..., None]))


def picture(shape: tuple[int, int], rng: np.random.Generator) -> UInt8[np.ndarray, "H W 3"]:
    """A framed abstract painting: blobs and bars over a washed ground."""
    height, width = shape
    canvas = tinted(noise(shape, 40, 4, rng), _any_color(rng), 0.35)
    for _ in range(14):
        color = _any_color(rng)
        x, y = int(rng.integers(width)), int(rng.integers(height))
        if rng.random() < 0.5:
            cv2.circle(
                canvas, (x, y), int(rng.integers(4, max(5, height // 5))), color, -1, cv2.LINE_AA
            )
        else:
            end = (int(rng.integers(width)), int(rng.integers(height)))
            cv2.line(canvas, (x, y), end, color, int(rng.integers(2, 9)), cv2.LINE_AA)
    cv2.rectangle(canvas, (0, 0), (width - 1, height - 1), (32, 26, 22), 7)
    return canvas


def hang_pictures(
    wall: UInt8[np.ndarray, "H W 3"], count: int, rng: np.random.Generator
) -> UInt8[np.ndarray, "H W 3"]:
    """A copy of a wall with pictures side by side at eye level (first row is the top)."""
    hung = wall.copy()
    height, width = wall.shape[:2]
    slot = width // count
    for i in range(count):
        shape = (int(rng.uniform(0.5, 1.0) * PX_PER_M), int(rng.uniform(0.5, 1.0) * PX_PER_M))
        shape = (min(shape[0], height - 8), min(shape[1], slot - 8))
        x = i * slot + int(rng.integers(4, max(5, slot - shape[1])))
        y = int(np.clip(height - rng.uniform(1.7, 2.3) * PX_PER_M, 4, height - shape[0] - 4))
        hung[y : y + shape[0], x : x + shape[1]] = picture(shape, rng)
    return hung


def _any_color(rng: np.random.Generator) -> Color:
    r, g, b = (int(c) for c in rng.integers(25, 235, 3))
    return r, g, b


def _to_image(values: Float[np.ndarray, "H W 3"]) -> UInt8[np.ndarray, "H W 3"]:
    return np.clip(values, 0, 255).astype(np.uint8)


_PLATE_MARGIN_PX = 4
_SHADOW_CELL_M = 0.04
_SHADOW_HALF_M = 1.9
_SHADOW_SLANT = np.array([0.22, -0.18])  # metres on the floor per metre of height
_SUPERSAMPLE = 2


@dataclass(frozen=True)
class Surface:
    """A textured rectangle: world = corner + column / PX_PER_M * along + row / PX_PER_M * down."""

    texture: UInt8[np.ndarray, "H W 3"]
    corner: Float[np.ndarray, "3"]
    along: Float[np.ndarray, "3"]
    down: Float[np.ndarray, "3"]


@dataclass(frozen=True)
class Plate:
    """The picture of the room by one wide pinhole camera with the film camera's centre."""

    image: UInt8[np.ndarray, "H W 3"]
    K: Float[np.ndarray, "3 3"]
    R_plate_from_world: Float[np.ndarray, "3 3"]


def room(kind: int, azimuth_deg: float, rng: np.random.Generator) -> list[Surface]:
    """Floor with a yoga mat, back wall and two side walls, open towards the camera's azimuth.

    kind 0 to 3: brick loft, tiled salon, wooden gym, garden. azimuth_deg: as in cameras.py.
    """
    azimuth = np.deg2rad(azimuth_deg)
    back = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])  # away from the camera
    right = np.array([back[1], -back[0], 0.0])
    up = np.array([0.0, 0.0, 1.0])
    depth, half, front, high = rng.uniform(2.3, 3.2), rng.uniform(3.6, 4.6), 7.5, 4.2
    floor_shape = (int((front + depth) * PX_PER_M), int(2 * half * PX_PER_M))
    wall_shape = (int(high * PX_PER_M), int(2 * half * PX_PER_M))
    side_shape = (int(high * PX_PER_M), int((front + depth) * PX_PER_M))
    floor, walls = _materials(kind, floor_shape, [wall_shape, side_shape, side_shape], rng)
    far_left = depth * back - half * right
    far_right = depth * back + half * right
    return [
        Surface(floor, far_left, right, -back),
        Surface(walls[0], far_left + high * up, right, -up),
        Surface(walls[1], far_left - (depth + front) * back + high * up, back, -up),
        Surface(walls[2], far_right + high * up, -back, -up),
        _mat(rng),
    ]


def _materials(
    kind: int, floor: tuple[int, int], walls: list[tuple[int, int]], rng: np.random.Generator
) -> tuple[UInt8[np.ndarray, "H W 3"], list[UInt8[np.ndarray, "_ _ 3"]]]:
    if kind == 0:
        ground = planks(floor, 22, (150, 112, 78), rng)
        sides = [bricks(w, (16, 40), (158, 84, 66), (178, 170, 160), rng) for w in walls]
        return ground, [hang_pictures(side, 6, rng) for side in sides]
    if kind == 1:
        ground = checks(floor, 60, ((208, 202, 190), (96, 104, 112)), rng)
        sides = [tinted(noise(w, 30, 5, rng), (122, 148, 140), 0.3) for w in walls]
        return ground, [hang_pictures(side, 9, rng) for side in sides]
    if kind == 2:
        ground = tinted(noise(floor, 12, 4, rng), (92, 108, 138), 0.5)
        sides = [planks(w, 30, (196, 168, 122), rng) for w in walls]
        return ground, [hang_pictures(side, 5, rng) for side in sides]
    ground = tinted(noise(floor, 18, 5, rng), (88, 122, 62), 0.6)
    sides = [bricks(w, (34, 62), (150, 146, 136), (96, 100, 92), rng, 0.3) for w in walls]
    return ground, [hang_pictures(side, 4, rng) for side in sides]


def _mat(rng: np.random.Generator) -> Surface:
    """A yoga mat under the performer, 4 mm above the floor."""
    length, width = 2.2, 0.75
    shape = (int(length * PX_PER_M), int(width * PX_PER_M))
    color = (int(rng.integers(60, 120)), int(rng.integers(60, 110)), int(rng.integers(110, 170)))
    weave = tinted(noise(shape, 5, 2, rng), color, 0.25)
    cv2.rectangle(weave, (6, 6), (shape[1] - 7, shape[0] - 7), (210, 205, 195), 2)
    corner = np.array([-width / 2, 1.3, 0.004])
    return Surface(weave, corner, np.array([1.0, 0.0, 0.0]), np.array([0.0, -1.0, 0.0]))


def render_plate(surfaces: list[Surface], camera: FilmCamera, size: tuple[int, int]) -> Plate:
    """Ray-cast the room once, wide enough for every frame of the camera."""
    middle = camera.R_cam_from_world[len(camera.R_cam_from_world) // 2]
    width, height = size
    corners = np.array([[0, 0, 1], [width, 0, 1], [0, height, 1], [width, height, 1.0]])
    to_plate = (
        camera.K @ middle @ np.swapaxes(camera.R_cam_from_world, 1, 2) @ np.linalg.inv(camera.K)
    )
    on_plate = np.einsum("tij,cj->tci", to_plate, corners)
    on_plate = on_plate[..., :2] / on_plate[..., 2:]
    low = np.floor(on_plate.min(axis=(0, 1))) - _PLATE_MARGIN_PX
    high = np.ceil(on_plate.max(axis=(0, 1))) + _PLATE_MARGIN_PX
    shift = np.array([[1.0, 0.0, -low[0]], [0.0, 1.0, -low[1]], [0.0, 0.0, 1.0]])
    K = shift @ camera.K
    plate_size = (int(high[0] - low[0]), int(high[1] - low[1]))
    return Plate(raycast(surfaces, K, middle, camera.centre, plate_size), K, middle)


def raycast(
    surfaces: Sequence[Surface],
    K: Float[np.ndarray, "3 3"],
    R: Float[np.ndarray, "3 3"],
    centre: Float[np.ndarray, "3"],
    size: tuple[int, int],
    supersample: int = _SUPERSAMPLE,
) -> UInt8[np.ndarray, "H W 3"]:
    """RGB picture of textured rectangles by a pinhole camera at `centre`, of so many rays a pixel
    in each direction."""
    fine = (size[0] * supersample, size[1] * supersample)
    x = (np.arange(fine[0]) + 0.5) / supersample - 0.5
    y = (np.arange(fine[1]) + 0.5) / supersample - 0.5
    pixels = np.stack([*np.meshgrid(x, y), np.ones(fine[::-1])], axis=-1)
    directions = pixels @ (np.linalg.inv(K).T @ R)
    image = np.full((fine[1], fine[0], 3), (188, 196, 204), np.uint8)
    nearest = np.full(fine[::-1], np.inf)
    K_fine = np.diag([supersample, supersample, 1.0]) @ K
    for surface in surfaces:
        rows, columns = _region(surface, K_fine, R, centre, fine)
        normal = np.cross(surface.along, surface.down)
        slope = directions[rows, columns] @ normal
        slope[np.abs(slope) < 1e-9] = 1e-9
        distance = ((surface.corner - centre) @ normal) / slope
        hit = centre - surface.corner + distance[..., None] * directions[rows, columns]
        column = hit @ surface.along * PX_PER_M
        row = hit @ surface.down * PX_PER_M
        high, wide = surface.texture.shape[:2]
        on = (distance > 0) & (distance < nearest[rows, columns])
        on &= (column >= 0) & (column < wide - 1) & (row >= 0) & (row < high - 1)
        if not on.any():
            continue
        sampled = cv2.remap(
            surface.texture, column.astype(np.float32), row.astype(np.float32), cv2.INTER_LINEAR
        )
        image[rows, columns][on] = sampled[on]
        nearest[rows, columns][on] = distance[on]
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8)


def _region(
    surface: Surface,
    K: Float[np.ndarray, "3 3"],
    R: Float[np.ndarray, "3 3"],
    centre: Float[np.ndarray, "3"],
    size: tuple[int, int],
) -> tuple[slice, slice]:
    """Rows and columns of a picture that a rectangle lies in: all where it reaches behind the
    camera."""
    high, wide = (n / PX_PER_M for n in surface.texture.shape[:2])
    corners = surface.corner + np.array(
        [a * wide * surface.along + b * high * surface.down for a in (0, 1) for b in (0, 1)]
    )
    in_view = (corners - centre) @ R.T @ K.T
    if (in_view[:, 2] < 1e-2).any():
        return slice(None), slice(None)
    pixels = in_view[:, :2] / in_view[:, 2:]
    low = np.clip(np.floor(pixels.min(axis=0)) - 2, 0, size).astype(int)
    end = np.clip(np.ceil(pixels.max(axis=0)) + 3, 0, size).astype(int)
    return slice(low[1], end[1]), slice(low[0], end[0])


def backdrop(
    plate: Plate,
    K: Float[np.ndarray, "3 3"],
    R_cam_from_world: Float[np.ndarray, "3 3"],
    size: tuple[int, int],
) -> UInt8[np.ndarray, "H W 3"]:
    """The room in one frame of the video."""
    H = K @ R_cam_from_world @ plate.R_plate_from_world.T @ np.linalg.inv(plate.K)
    return np.asarray(cv2.warpPerspective(plate.image, H, size, flags=cv2.INTER_LINEAR), np.uint8)


def cast_shadow(
    image: UInt8[np.ndarray, "H W 3"],
    vertices: Float[np.ndarray, "V 3"],
    K: Float[np.ndarray, "3 3"],
    R_cam_from_world: Float[np.ndarray, "3 3"],
    t: Float[np.ndarray, "3"],
) -> UInt8[np.ndarray, "H W 3"]:
    """Darken the floor below a body (vertices in the world), more softly below its higher parts."""
    cells = int(2 * _SHADOW_HALF_M / _SHADOW_CELL_M)
    middle = np.median(vertices[:, :2], axis=0)
    fallen = vertices[:, :2] + vertices[:, 2:] * _SHADOW_SLANT
    place = ((fallen - middle + _SHADOW_HALF_M) / _SHADOW_CELL_M).astype(int)
    inside = ((place >= 0) & (place < cells)).all(axis=1)
    low = vertices[:, 2] < 0.25
    light = np.ones((cells, cells), np.float32)
    for part, sigma, depth in ((inside & low, 1.2, 0.5), (inside & ~low, 3.0, 0.4)):
        covered = np.zeros((cells, cells), np.float32)
        covered[place[part, 1], place[part, 0]] = 1.0
        light *= 1.0 - depth * cv2.GaussianBlur(covered, (0, 0), sigma)
    floor_from_cell = np.eye(3)
    floor_from_cell[:2, :2] *= _SHADOW_CELL_M
    floor_from_cell[:2, 2] = middle - _SHADOW_HALF_M + 0.5 * _SHADOW_CELL_M
    H = K @ np.column_stack([R_cam_from_world[:, 0], R_cam_from_world[:, 1], t]) @ floor_from_cell
    size = (image.shape[1], image.shape[0])
    factor = cv2.warpPerspective(light, H, size, borderMode=cv2.BORDER_CONSTANT, borderValue=1.0)
    rows, columns = (np.flatnonzero((factor < 1.0).any(axis)) for axis in (1, 0))
    shown = image.copy()
    if len(rows):
        dark = slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
        shown[dark] = np.rint(image[dark] * factor[dark][..., None])
    return shown
