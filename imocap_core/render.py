"""Mesh rendering: a z-buffer and a painter's algorithm, shading, blending over a frame.

Triangle rasterisation: a z-buffer. Every triangle proposes the pixel centres in its bounding box,
one after another in a compiled loop.

Painter's algorithm: fast mesh rendering over video frames, far faces first. It needs no depth per
pixel, so its cost depends on the number of faces and hardly on the size of the picture.
Intersecting faces are drawn wrongly; those of a body are a few pixels large, so that this is not
visible. `draw_mesh` is exact, and several times slower.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from itertools import repeat
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32, Int, UInt8

from imocap_core.workers import compiled


@dataclass(frozen=True)
class Light:
    """A directional lamp and a sky. Directions are unit vectors in the mesh's world axes.

    towards_lamp: from the surface to the lamp; up: towards the sky; ambient, diffuse, sky: weights
    that should sum to about 1, so that a face turned to the light has its true colour.
    """

    towards_lamp: tuple[float, float, float] = (0.3, -0.5, 0.81)
    up: tuple[float, float, float] = (0.0, 0.0, 1.0)
    ambient: float = 0.35
    diffuse: float = 0.5
    sky: float = 0.25

    def intensity(self, normals: Float[np.ndarray, "... 3"]) -> Float[np.ndarray, "..."]:
        """Brightness factor of surfaces with unit normals."""
        lamp = np.clip(normals @ np.asarray(self.towards_lamp), 0.0, None)
        above = 0.5 + 0.5 * (normals @ np.asarray(self.up))
        return self.ambient + self.diffuse * lamp + self.sky * above


def vertex_normals(
    vertices: Float[np.ndarray, "V 3"], faces: Int[np.ndarray, "F 3"]
) -> Float[np.ndarray, "V 3"]:
    """Area-weighted unit normals, outward where faces are counter-clockwise."""
    axes = np.ascontiguousarray(vertices.T)
    first, second, third = (axes.take(side, axis=1) for side in np.ascontiguousarray(faces.T))
    (ax, ay, az), (bx, by, bz) = second - first, third - first
    cross = (ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx)
    flat = faces.ravel()
    summed = np.stack(
        [np.bincount(flat, np.repeat(c, 3), minlength=len(vertices)) for c in cross], axis=1
    )
    length = np.linalg.norm(summed, axis=1, keepdims=True)
    return summed / np.where(length > 0, length, 1.0)


NEAR_M = 0.05
_EDGE = -1e-9  # barycentric tolerance, so that a pixel centre on a shared edge is covered


class Fragments(NamedTuple):
    """The visible surface, one entry per covered pixel.

    pixel: flat index, row * width + column. face: index into the faces. weight: barycentric weights
    of that face's corners, in the image plane. depth: metres.
    """

    pixel: Int[np.ndarray, " N"]
    face: Int[np.ndarray, " N"]
    weight: Float[np.ndarray, "N 3"]
    depth: Float[np.ndarray, " N"]


def rasterize(
    xy_px: Float[np.ndarray, "V 2"],
    depth: Float[np.ndarray, " V"],
    faces: Int[np.ndarray, "F 3"],
    size: tuple[int, int],
) -> Fragments:
    """The nearest triangle at every pixel centre of an image.

    Args:
        xy_px: projected corners; pixel (0, 0) is the centre of the first pixel.
        depth: along the optical axis, metres.
        faces: counter-clockwise from outside. Back faces are skipped, and faces with a corner
            nearer than NEAR_M.
        size: (width, height).
    """
    width, height = size
    front, corners = _front_faces(xy_px, depth, faces)
    (left, right), (top, bottom) = map(_pixels_between, corners, size)
    boxes = np.stack([left, right, top, bottom])
    closeness = 1.0 / depth[faces[front]]  # 1/depth is what is linear in the image
    nearest, owner = np.zeros(width * height), np.full(width * height, -1)
    weights = np.empty((width * height, 3))
    _fill_nearest(boxes, np.array(_planes(corners)), closeness, width, nearest, owner, weights)
    covered = np.flatnonzero(owner >= 0)
    return Fragments(covered, front[owner[covered]], weights[covered], 1.0 / nearest[covered])


@compiled
def _fill_nearest(boxes, planes, closeness, width, nearest, owner, weights):  # type: ignore[no-untyped-def]
    """The nearest triangle's 1/depth, index and weights at the pixels, in place; of equally near
    ones the last."""
    for k in range(len(closeness)):
        left, right, top, bottom = boxes[:, k]
        for y in range(top, bottom + 1):
            for x in range(left, right + 1):
                w1 = (planes[0, 0, k] * x + planes[0, 1, k] * y) + planes[0, 2, k]
                w2 = (planes[1, 0, k] * x + planes[1, 1, k] * y) + planes[1, 2, k]
                w0 = 1.0 - w1 - w2
                if w0 < _EDGE or w1 < _EDGE or w2 < _EDGE:
                    continue
                near = w0 * closeness[k, 0] + w1 * closeness[k, 1] + w2 * closeness[k, 2]
                pixel = y * width + x
                if near >= nearest[pixel]:
                    nearest[pixel], owner[pixel] = near, k
                    weights[pixel, 0], weights[pixel, 1], weights[pixel, 2] = w0, w1, w2


def _front_faces(
    xy_px: Float[np.ndarray, "V 2"], depth: Float[np.ndarray, " V"], faces: Int[np.ndarray, "F 3"]
) -> tuple[Int[np.ndarray, " C"], Float[np.ndarray, "2 3 C"]]:
    """Front faces, and x and y of their three corners."""
    by_corner = np.ascontiguousarray(faces.T)
    xs, ys = (np.ascontiguousarray(axis)[by_corner] for axis in xy_px.T)
    nearest = np.minimum.reduce(depth[by_corner])
    front = np.flatnonzero((_doubled_areas(xs, ys) < 0) & (nearest > NEAR_M))
    return front, np.stack([xs.take(front, axis=1), ys.take(front, axis=1)])


def _doubled_areas(
    xs: Float[np.ndarray, "3 C"], ys: Float[np.ndarray, "3 C"]
) -> Float[np.ndarray, " C"]:
    """Twice the signed areas; y points down, so outward faces turn clockwise: negative."""
    return np.asarray((xs[1] - xs[0]) * (ys[2] - ys[0]) - (ys[1] - ys[0]) * (xs[2] - xs[0]))


def _planes(
    corners: Float[np.ndarray, "2 3 C"],
) -> list[tuple[Float[np.ndarray, " C"], Float[np.ndarray, " C"], Float[np.ndarray, " C"]]]:
    """The affine maps from pixel to 2nd and to 3rd barycentric weight: along x, along y, offset."""
    xs, ys = corners
    area = _doubled_areas(xs, ys)
    slopes = [
        ((ys[2] - ys[0]) / area, -(xs[2] - xs[0]) / area),
        (-(ys[1] - ys[0]) / area, (xs[1] - xs[0]) / area),
    ]
    return [(along_x, along_y, -(along_x * xs[0] + along_y * ys[0])) for along_x, along_y in slopes]


def _pixels_between(
    corners: Float[np.ndarray, "3 C"], count: int
) -> tuple[Int[np.ndarray, " C"], Int[np.ndarray, " C"]]:
    """First and last pixel (inclusive) of each triangle along one axis of the image."""
    low, high = np.minimum.reduce(corners), np.maximum.reduce(corners)
    first = np.clip(np.ceil(low), 0, count).astype(np.int64)
    return first, np.clip(np.floor(high), -1, count - 1).astype(np.int64)


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
    if not len(xy_px):
        return None
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
    box = _window(xy_px[ahead], (image.shape[1], image.shape[0]))
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


def _far_to_near(
    xy: Float[np.ndarray, "V 2"],
    depth: Float[np.ndarray, " V"],
    faces: Int[np.ndarray, "F 3"],
    ahead: Bool[np.ndarray, " V"],
) -> Int[np.ndarray, " N"]:
    """Indices of the front faces, the farthest first."""
    area = _doubled_areas(*(axis[faces].T for axis in xy.T))
    front = np.flatnonzero((area < 0) & ahead[faces].all(axis=1))
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


VIEWS = ("front", "side", "back")

CAMERA_DISTANCE_M = 25.0  # nearly orthographic, so that lengths can be compared
FILLED = 0.94  # of the picture's smaller side, by the largest body
HEAD_DOWN = -0.9  # height of the pelvis' axis below which a body stands on its head
UP = np.array([0.0, 1.0, 0.0])
LIGHT = Light(towards_lamp=(-0.45, -0.6, -0.66), up=(0.0, -1.0, 0.0), ambient=0.25, diffuse=0.65)
"""Neutral lamp, obliquely from above the camera, in camera axes (y down, z away): folds of the
skin throw their shade."""
PAPER_RGB, GROUND_RGB = (247, 248, 249), (205, 210, 215)

SKIN_RGB = (206, 203, 198)
SEGMENT_RGB: dict[str, tuple[int, int, int]] = {
    "pelvis": (86, 112, 156),
    "spine1": (226, 190, 92),
    "spine2": (120, 168, 138),
    "spine3": (214, 138, 112),
    "left_collar": (160, 140, 184),
    "right_collar": (160, 140, 184),
    "neck": (232, 222, 196),
}
"""Colours of the torso's segments, RGB: a band that grows or vanishes shows a bulge or a crease."""


def segment_colors(
    weights: Float[np.ndarray, "V J"], joint_names: tuple[str, ...], faces: Int[np.ndarray, "F 3"]
) -> Float[np.ndarray, "F 3"]:
    """RGB of each face, 0..255: that of the joint that moves it most, from its skinning weights."""
    palette = np.array([SEGMENT_RGB.get(name, SKIN_RGB) for name in joint_names], dtype=np.float64)
    return palette[weights[faces].sum(axis=1).argmax(axis=1)]


def heading_of(R_upright_from_pelvis: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "3"]:
    """The horizontal unit vector in which a body faces once it is set upright by the shortest turn.

    Who stands on the head has no such turn: the pelvis' forward axis on the ground.
    """
    R = R_upright_from_pelvis
    flat = np.array([R[0, 2] - R[2, 0], 0.0, R[0, 0] + R[2, 2]])
    if R[1, 1] < HEAD_DOWN:
        flat = R[:, 2] * (1 - UP)
    return flat / np.linalg.norm(flat)


def view_rotation(heading: Float[np.ndarray, "3"], view: str) -> Float[np.ndarray, "3 3"]:
    """R_cam_from_upright of a level camera: in front of the body, at its right side, or behind it.

    heading: see `heading_of`. Camera axes: x right, y down, z away. In the side view the body faces
    the picture's right. ValueError for another view than those of VIEWS.
    """
    if view not in VIEWS:
        raise ValueError(f"view: expected one of {', '.join(VIEWS)}, got {view!r}")
    left = np.cross(UP, heading)
    away = {"front": -heading, "side": left, "back": heading}[view]
    return np.stack([np.cross(-UP, away), -UP, away])


def common_scale(
    bodies_m: Float[np.ndarray, "N V 3"],
    headings: Float[np.ndarray, "N 3"],
    size_px: tuple[int, int],
) -> float:
    """Pixels a metre at which every body fits into a picture of size (width, height), in any
    view."""
    scales = []
    for body, heading in zip(bodies_m, headings, strict=True):
        for view in VIEWS:
            extent_m = np.ptp(body @ view_rotation(heading, view)[:2].T, axis=0)
            scales.append(float((FILLED * np.array(size_px) / extent_m).min()))
    return min(scales)


def draw_view(
    body_m: Float[np.ndarray, "V 3"],
    faces: Int[np.ndarray, "F 3"],
    face_colors: Float[np.ndarray, "F 3"],
    heading: Float[np.ndarray, "3"],
    view: str,
    size_px: tuple[int, int],
    px_per_m: float,
    middle_m: Float[np.ndarray, "3"] | None = None,
) -> UInt8[np.ndarray, "height width 3"]:
    """A shaded body in the middle of a plain picture, over the line of the ground.

    Args:
        body_m: vertices in an upright world (y up, the ground at y = 0), metres.
        face_colors: RGB, 0..255. heading, view: see `view_rotation`.
        size_px: (width, height). px_per_m: the scale, see `common_scale`. middle_m: the point in
            the middle of the picture; the body's own middle where it is None.

    The line is drawn where the ground is within the picture.
    """
    width, height = size_px
    R_cam_from_upright = view_rotation(heading, view)
    turned = body_m @ R_cam_from_upright.T
    middle = (turned.min(axis=0) + turned.max(axis=0)) / 2
    if middle_m is not None:
        middle = R_cam_from_upright @ middle_m
    picture = np.full((height, width, 3), PAPER_RGB, dtype=np.uint8)
    ground_row = round((height - 1) / 2 - px_per_m * float(middle[1]))  # the camera's y is -height
    if 0 <= ground_row < height:
        picture[ground_row] = GROUND_RGB
    focal_px = px_per_m * CAMERA_DISTANCE_M
    K = np.array([[focal_px, 0, (width - 1) / 2], [0, focal_px, (height - 1) / 2], [0, 0, 1]])
    centred = turned - middle + [0.0, 0.0, CAMERA_DISTANCE_M]
    return draw_mesh(picture, centred, faces, face_colors, K, np.eye(3), np.zeros(3), light=LIGHT)
