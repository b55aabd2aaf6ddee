"""Exact mesh rendering over a picture: the demo's performer, and results over real frames."""

from __future__ import annotations

import cv2
import numpy as np
from jaxtyping import Float, Float32, Int, UInt8

from imocap_core.render.rasterize import NEAR_M, Fragments, rasterize
from imocap_core.render.shading import Light, vertex_normals

_MARGIN_PX = 2


def draw_mesh(
    image: UInt8[np.ndarray, "H W 3"],
    vertices: Float[np.ndarray, "V 3"],
    faces: Int[np.ndarray, "F 3"],
    face_colors: Float[np.ndarray, "... 3"],
    K: Float[np.ndarray, "3 3"],
    R_cam_from_world: Float[np.ndarray, "3 3"],
    t: Float[np.ndarray, "3"],
    *,
    alpha: float = 1.0,
    light: Light | None = None,
    supersample: int = 2,
) -> UInt8[np.ndarray, "H W 3"]:
    """A shaded, antialiased mesh over a copy of `image`.

    Args:
        vertices: in the world, metres. faces: counter-clockwise from outside.
        face_colors: (F, 3) or (3,) in 0..255, in the image's channel order.
        K, R_cam_from_world, t: the camera, x_cam = R_cam_from_world @ x_world + t.
        alpha: opacity, 1 hides the picture behind.
        supersample: samples per pixel and axis.

    A mesh out of view changes nothing.
    """
    in_camera = vertices @ R_cam_from_world.T + t
    depth = in_camera[:, 2]
    ahead = depth > NEAR_M
    if not ahead.any():
        return image.copy()
    homogeneous = in_camera @ K.T
    xy_px = homogeneous[:, :2] / np.where(ahead, depth, 1.0)[:, None]
    window = _window(xy_px[ahead], (image.shape[1], image.shape[0]))
    if window is None:
        return image.copy()
    x0, y0, x1, y1 = window
    size = ((x1 - x0) * supersample, (y1 - y0) * supersample)
    # the centre of fine pixel i is at (i + 0.5) / supersample - 0.5 in coarse pixels
    fine_px = (xy_px - (x0, y0) + 0.5) * supersample - 0.5
    fragments = rasterize(fine_px, depth, faces, size)
    normals = vertex_normals(vertices, faces)
    paint = _paint(fragments, normals, faces, face_colors, light or Light(), size)
    coarse = cv2.resize(paint, (x1 - x0, y1 - y0), interpolation=cv2.INTER_AREA)
    drawn = image.copy()
    behind = drawn[y0:y1, x0:x1].astype(np.float32)
    front, coverage = coarse[:, :, :3], alpha * coarse[:, :, 3:]
    blended = behind * (1.0 - coverage) + alpha * front
    drawn[y0:y1, x0:x1] = np.clip(np.rint(blended), 0, 255).astype(np.uint8)
    return drawn


def _window(
    xy_px: Float[np.ndarray, "N 2"], size: tuple[int, int]
) -> tuple[int, int, int, int] | None:
    """The part of the image around the points: x0, y0, x1, y1 (ends excluded); None if outside."""
    low = np.clip(np.floor(xy_px.min(axis=0)) - _MARGIN_PX, 0, size).astype(int)
    high = np.clip(np.ceil(xy_px.max(axis=0)) + _MARGIN_PX + 1, 0, size).astype(int)
    if (high <= low).any():
        return None
    return int(low[0]), int(low[1]), int(high[0]), int(high[1])


def _paint(
    fragments: Fragments,
    normals: Float[np.ndarray, "V 3"],
    faces: Int[np.ndarray, "F 3"],
    face_colors: Float[np.ndarray, "... 3"],
    light: Light,
    size: tuple[int, int],
) -> Float32[np.ndarray, "H W 4"]:
    """Colours premultiplied by coverage, and coverage."""
    first, second, third = np.ascontiguousarray(faces.T).take(fragments.face, axis=1)
    w0, w1, w2 = np.ascontiguousarray(fragments.weight.T)
    axes = np.ascontiguousarray(normals.T)
    normal = np.stack([w0 * n[first] + w1 * n[second] + w2 * n[third] for n in axes], axis=1)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-9)
    colors = face_colors if face_colors.ndim == 1 else face_colors[fragments.face]
    paint = np.zeros((size[0] * size[1], 4), np.float32)
    paint[fragments.pixel, :3] = np.clip(colors * light.intensity(normal)[:, None], 0, 255)
    paint[fragments.pixel, 3] = 1.0
    return paint.reshape(size[1], size[0], 4)
