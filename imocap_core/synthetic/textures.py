"""Procedural textures with many features: floors, walls, pictures. RGB uint8, seeded."""

from __future__ import annotations

import cv2
import numpy as np
from jaxtyping import Float, UInt8

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
