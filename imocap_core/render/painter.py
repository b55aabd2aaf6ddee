"""A mesh over a picture, fast enough for film: far faces first, nearer ones over them.

The painter's algorithm needs no depth per pixel, so its cost is that of the faces and hardly that
of the picture. Faces that pierce each other come out wrong; those of a body, a few pixels large,
do so nowhere that can be seen. `draw_mesh` is exact, and several times slower.
"""

from collections import deque
from itertools import repeat

import cv2
import numpy as np

from imocap_core.render.arrays import Floats, Image, Ints
from imocap_core.render.rasterize import NEAR_M
from imocap_core.render.shading import Light, vertex_normals

_MARGIN_PX = 2
_TONES = 96  # shades of the colour; their steps can't be told apart
_BRIGHTEST = 1.35
_FRACTION_BITS = 4  # of the corners' positions
_WIDEST_BLUR_PX = 11  # a face has one shade; the steps between faces must not show


def paint_mesh(
    image: Image,
    vertices: Floats,
    faces: Ints,
    P_px: Floats,
    rgb: Floats,
    *,
    alpha: float = 1.0,
    light: Light | None = None,
    supersample: int = 2,
) -> Image:
    """Paint a shaded, antialiased mesh of one colour over a copy of `image`.

    image (H, W, 3) uint8; vertices (V, 3) metres in the axes of a camera; faces (F, 3)
    counter-clockwise seen from outside; P_px (3, 3): K, or H @ K where the picture is moved by the
    homography H, P_px @ x = depth * (x_px, y_px, 1) with the centre of the first pixel at (0, 0);
    rgb (3,) in 0..255; alpha 1 hides the picture behind. The light's axes are the vertices'.
    supersample: samples per pixel and axis. Faces nearer than NEAR_M are left out.
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


def _window(xy_px: Floats, width: int, height: int) -> tuple[int, int, int, int] | None:
    """The part of the picture that the points can touch: x0, y0, x1, y1 (ends excluded)."""
    if not len(xy_px):
        return None
    low = np.clip(np.floor(xy_px.min(axis=0)) - _MARGIN_PX, 0, (width, height)).astype(int)
    high = np.clip(np.ceil(xy_px.max(axis=0)) + _MARGIN_PX + 1, 0, (width, height)).astype(int)
    if (high <= low).any():
        return None
    return int(low[0]), int(low[1]), int(high[0]), int(high[1])


def _far_to_near(xy: Floats, depth: Floats, faces: Ints, ahead: np.ndarray) -> Ints:
    """Indices of the faces turned to the camera, the farthest first."""
    a, b, c = (xy[faces[:, k]] for k in range(3))
    area = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
    front = np.flatnonzero((area < 0) & ahead[faces].all(axis=1))  # y points down
    order: Ints = front[np.argsort(-depth[faces[front]].sum(axis=1))]
    return order


def _tones(vertices: Floats, faces: Ints, light: Light) -> Ints:
    """Brightness of each face, the mean of its corners', as a step of 0 to _TONES - 1."""
    corners = light.intensity(vertex_normals(vertices, faces))
    share = np.clip(corners[faces].mean(axis=1) / _BRIGHTEST, 0.0, 1.0)
    steps: Ints = np.rint(share * (_TONES - 1)).astype(np.int64)
    return steps


def _fill(triangles: Floats, tone: Ints, rgb: Floats, size: tuple[int, int]) -> Image:
    """Colour and coverage (height, width, 4) of triangles (n, 3, 2) painted one after another."""
    shades = np.clip(np.linspace(0, _BRIGHTEST, _TONES)[:, None] * rgb, 0, 255)
    table = [(*shade, 255.0) for shade in shades.tolist()]
    corners = np.rint(triangles * 2**_FRACTION_BITS).astype(np.int32)
    colors = map(table.__getitem__, tone.tolist())
    paint = np.zeros((size[1], size[0], 4), np.uint8)
    fixed = repeat(cv2.LINE_8), repeat(_FRACTION_BITS)
    deque(map(cv2.fillConvexPoly, repeat(paint), corners, colors, *fixed), maxlen=0)
    return paint


def _smoothed(paint: Image, triangles_px: Floats) -> Image:
    """The colours (h, w, 3) of premultiplied paint (h, w, 4), averaged over about a face."""
    side = 1
    if len(triangles_px):
        edges_px = np.abs(triangles_px[:, 1] - triangles_px[:, 0]).max(axis=1)
        side = int(min(2 * round(float(np.median(edges_px)) / 2) + 1, _WIDEST_BLUR_PX))
    blurred = cv2.blur(paint, (side, side), borderType=cv2.BORDER_CONSTANT) if side > 1 else paint
    *colors, coverage = cv2.split(blurred)
    return np.asarray(cv2.merge([cv2.divide(c, coverage, scale=255.0) for c in colors]), np.uint8)
