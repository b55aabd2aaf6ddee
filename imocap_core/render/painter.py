"""Painter's algorithm: fast mesh rendering over video frames, far faces first.

It needs no depth per pixel, so its cost depends on the number of faces and hardly on the size of
the picture. Intersecting faces are drawn wrongly; those of a body are a few pixels large, so that
this is not visible. `draw_mesh` is exact, and several times slower.
"""

from __future__ import annotations

from collections import deque
from itertools import repeat

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

from imocap_core.render.rasterize import NEAR_M
from imocap_core.render.shading import Light, vertex_normals

_MARGIN_PX = 2
_TONES = 96  # shades of the colour, in invisibly small steps
_BRIGHTEST = 1.35
_FRACTION_BITS = 4  # of the corners' positions
_WIDEST_BLUR_PX = 11  # hides the steps between faces, which have one shade each


def paint_mesh(
    image: UInt8[np.ndarray, "H W 3"],
    vertices: Float[np.ndarray, "V 3"],
    faces: Int[np.ndarray, "F 3"],
    P_px: Float[np.ndarray, "3 3"],
    rgb: Float[np.ndarray, "3"],
    *,
    alpha: float = 1.0,
    light: Light | None = None,
    supersample: int = 2,
) -> UInt8[np.ndarray, "H W 3"]:
    """A shaded, antialiased mesh of one colour over a copy of `image`.

    Args:
        vertices: in camera axes, metres. faces: counter-clockwise from outside.
        P_px: K, or H @ K where the picture is warped by the homography H: P_px @ x =
            depth * (x_px, y_px, 1), with the centre of the first pixel at (0, 0).
        rgb: colour in 0..255. alpha: opacity, 1 hides the picture behind.
        light: in the axes of the vertices. supersample: samples per pixel and axis.

    Faces nearer than NEAR_M are left out. ValueError when alpha is not in 0..1.
    """
    if not 0.0 <= alpha <= 1.0:
        raise ValueError(f"alpha: expected a share from 0 to 1, got {alpha}")
    homogeneous = vertices @ P_px.T
    depth = homogeneous[:, 2]
    ahead = depth > NEAR_M
    xy_px = homogeneous[:, :2] / np.where(ahead, depth, 1.0)[:, None]
    box = _window(xy_px[ahead], image.shape[1], image.shape[0])
    if box is None:
        return image.copy()
    x0, y0, x1, y1 = box
    fine = (xy_px - (x0, y0) + 0.5) * supersample - 0.5
    shown = _far_to_near(fine, depth, faces, ahead)
    tone = _tones(vertices, faces[shown], light or Light())
    size = ((x1 - x0) * supersample, (y1 - y0) * supersample)
    paint = _fill(fine[faces[shown]], tone, rgb, size)
    coarse = cv2.resize(paint, (x1 - x0, y1 - y0), interpolation=cv2.INTER_AREA)
    front = _smoothed(np.asarray(coarse, np.uint8), xy_px[faces[shown]])
    drawn = image.copy()
    share = alpha / 255.0 * coarse[:, :, 3].astype(np.float32)
    behind = np.ascontiguousarray(drawn[y0:y1, x0:x1])
    drawn[y0:y1, x0:x1] = cv2.blendLinear(behind, front, 1.0 - share, share)
    return drawn


def _window(
    xy_px: Float[np.ndarray, "N 2"], width: int, height: int
) -> tuple[int, int, int, int] | None:
    """The part of the picture around the points: x0, y0, x1, y1 (ends excluded); None if
    outside."""
    if not len(xy_px):
        return None
    low = np.clip(np.floor(xy_px.min(axis=0)) - _MARGIN_PX, 0, (width, height)).astype(int)
    high = np.clip(np.ceil(xy_px.max(axis=0)) + _MARGIN_PX + 1, 0, (width, height)).astype(int)
    if (high <= low).any():
        return None
    return int(low[0]), int(low[1]), int(high[0]), int(high[1])


def _far_to_near(
    xy: Float[np.ndarray, "V 2"],
    depth: Float[np.ndarray, " V"],
    faces: Int[np.ndarray, "F 3"],
    ahead: Bool[np.ndarray, " V"],
) -> Int[np.ndarray, " N"]:
    """Indices of the front faces, the farthest first."""
    a, b, c = (xy[faces[:, k]] for k in range(3))
    area = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
    front = np.flatnonzero((area < 0) & ahead[faces].all(axis=1))  # y points down
    return front[np.argsort(-depth[faces[front]].sum(axis=1))]


def _tones(
    vertices: Float[np.ndarray, "V 3"], faces: Int[np.ndarray, "F 3"], light: Light
) -> Int[np.ndarray, " F"]:
    """Brightness of each face, the mean of its corners', as a step of 0 to _TONES - 1."""
    corners = light.intensity(vertex_normals(vertices, faces))
    share = np.clip(corners[faces].mean(axis=1) / _BRIGHTEST, 0.0, 1.0)
    return np.rint(share * (_TONES - 1)).astype(np.int64)


def _fill(
    triangles: Float[np.ndarray, "N 3 2"],
    tone: Int[np.ndarray, " N"],
    rgb: Float[np.ndarray, "3"],
    size: tuple[int, int],
) -> UInt8[np.ndarray, "H W 4"]:
    """Colour and coverage of triangles painted one after another."""
    shades = np.clip(np.linspace(0, _BRIGHTEST, _TONES)[:, None] * rgb, 0, 255)
    table = [(*shade, 255.0) for shade in shades.tolist()]
    corners = np.rint(triangles * 2**_FRACTION_BITS).astype(np.int32)
    colors = map(table.__getitem__, tone.tolist())
    paint = np.zeros((size[1], size[0], 4), np.uint8)
    fixed = repeat(cv2.LINE_8), repeat(_FRACTION_BITS)
    deque(map(cv2.fillConvexPoly, repeat(paint), corners, colors, *fixed), maxlen=0)
    return paint


def _smoothed(
    paint: UInt8[np.ndarray, "H W 4"], triangles_px: Float[np.ndarray, "N 3 2"]
) -> UInt8[np.ndarray, "H W 3"]:
    """The colours of premultiplied paint, averaged over about the size of a face."""
    side = 1
    if len(triangles_px):
        edges_px = np.abs(triangles_px[:, 1] - triangles_px[:, 0]).max(axis=1)
        side = int(min(2 * round(float(np.median(edges_px)) / 2) + 1, _WIDEST_BLUR_PX))
    blurred = cv2.blur(paint, (side, side), borderType=cv2.BORDER_CONSTANT) if side > 1 else paint
    *colors, coverage = cv2.split(blurred)
    return np.asarray(cv2.merge([cv2.divide(c, coverage, scale=255.0) for c in colors]), np.uint8)
