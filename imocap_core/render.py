"""Mesh rendering: rasterisation with a z-buffer, shading, blending over a frame; views of a body.

Every triangle proposes the pixel centres in its bounding box, one after another in a compiled loop.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int, UInt8

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


class Visible(NamedTuple):
    """What is visible at each of N pixels, row by row.

    face: index into the faces, -1 of none. closeness: 1 / depth, 1/m; 0 of none. planes: of each
    face, see `_planes`.
    """

    face: Int[np.ndarray, " N"]
    closeness: Float[np.ndarray, " N"]
    planes: Float[np.ndarray, "2 3 F"]


def rasterize(
    xy_px: Float[np.ndarray, "V 2"],
    depth: Float[np.ndarray, " V"],
    faces: Int[np.ndarray, "F 3"],
    size: tuple[int, int],
) -> Visible:
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
    planes = np.zeros((2, 3, len(faces)))
    planes[:, :, front] = _planes(corners)
    nearest, owner = np.zeros(width * height), np.full(width * height, -1)
    _fill_nearest(boxes, planes, closeness, front, width, nearest, owner)
    return Visible(owner, nearest, planes)


@compiled
def _fill_nearest(boxes, planes, closeness, front, width, nearest, owner):  # type: ignore[no-untyped-def]
    """The nearest triangle's 1/depth and index at the pixels, in place; of equally near ones the
    last."""
    for k in range(len(front)):
        left, right, top, bottom = boxes[:, k]
        (x1, y1, o1), (x2, y2, o2) = planes[0, :, front[k]], planes[1, :, front[k]]
        for y in range(top, bottom + 1):
            for x in range(left, right + 1):
                w1, w2 = (x1 * x + y1 * y) + o1, (x2 * x + y2 * y) + o2
                w0 = 1.0 - w1 - w2
                if w0 < _EDGE or w1 < _EDGE or w2 < _EDGE:
                    continue
                near = w0 * closeness[k, 0] + w1 * closeness[k, 1] + w2 * closeness[k, 2]
                pixel = y * width + x
                if near >= nearest[pixel]:
                    nearest[pixel], owner[pixel] = near, front[k]


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
        K, R_cam_from_world, t: the camera, x_cam = R_cam_from_world @ x_world + t; H @ K where the
            picture is warped by the homography H.
        alpha: opacity, 1 hides the picture behind.
        light: in the axes of the vertices. supersample: samples per pixel and axis.

    A mesh out of view changes nothing. ValueError when alpha is not in 0..1.
    """
    if not 0.0 <= alpha <= 1.0:
        raise ValueError(f"alpha: expected a share from 0 to 1, got {alpha}")
    homogeneous = (vertices @ R_cam_from_world.T + t) @ K.T
    depth = homogeneous[:, 2]
    ahead = depth > NEAR_M
    xy_px = homogeneous[:, :2] / np.where(ahead, depth, 1.0)[:, None]
    window = _window(xy_px[ahead], (image.shape[1], image.shape[0]))
    if window is None:
        return image.copy()
    x0, y0, x1, y1 = window
    size = ((x1 - x0) * supersample, (y1 - y0) * supersample)
    # the centre of fine pixel i is at (i + 0.5) / supersample - 0.5 in coarse pixels
    fine_px = (xy_px - (x0, y0) + 0.5) * supersample - 0.5
    surface, light = rasterize(fine_px, depth, faces, size), light or Light()
    colors = np.broadcast_to(np.asarray(face_colors, float), (len(faces), 3))
    shares = light.ambient, light.diffuse, light.sky
    lamps = np.array([light.towards_lamp, light.up, shares], float)
    normals = vertex_normals(vertices, faces).astype(float)
    paint = np.zeros((y1 - y0, x1 - x0, 4), np.float32)
    shading = normals, np.ascontiguousarray(colors), lamps
    on_faces = surface.face, surface.planes, faces.astype(np.int64)
    _shade(*on_faces, *shading, supersample, paint)
    drawn = image.copy()
    _blend(paint, np.float32(alpha), drawn, x0, y0)
    return drawn


@compiled
def _blend(paint, alpha, picture, x0, y0):  # type: ignore[no-untyped-def]
    """Premultiplied colours over a picture from its pixel (x0, y0) on, in place."""
    for y in range(paint.shape[0]):
        for x in range(paint.shape[1]):
            behind = np.float32(1.0) - alpha * paint[y, x, 3]
            for channel in range(3):
                under = picture[y0 + y, x0 + x, channel]
                mixed = under * behind + alpha * paint[y, x, channel]
                picture[y0 + y, x0 + x, channel] = np.uint8(min(max(np.rint(mixed), 0.0), 255.0))


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


@compiled
def _shade(  # type: ignore[no-untyped-def]
    visible, planes, faces, normals, colors, lamps, supersample, paint
):
    """Colours times the brightness of the interpolated normals in the `Light`, and coverage, means
    of `supersample`^2 samples, added to paint (height, width, 4)."""
    (ambient, diffuse, sky), part = lamps[2], 1.0 / supersample**2
    width = paint.shape[1] * supersample
    for pixel in range(len(visible)):
        face, row, column = visible[pixel], pixel // width, pixel % width
        if face < 0:
            continue
        plane = planes[:, :, face]
        w1 = (plane[0, 0] * column + plane[0, 1] * row) + plane[0, 2]
        w2 = (plane[1, 0] * column + plane[1, 1] * row) + plane[1, 2]
        x, y, z = 0.0, 0.0, 0.0
        for share, vertex in zip((1.0 - w1 - w2, w1, w2), faces[face]):  # noqa: B905
            x += share * normals[vertex, 0]
            y += share * normals[vertex, 1]
            z += share * normals[vertex, 2]
        length = max(np.sqrt(x * x + y * y + z * z), 1e-9)
        lamp = (lamps[0, 0] * x + lamps[0, 1] * y + lamps[0, 2] * z) / length
        above = (lamps[1, 0] * x + lamps[1, 1] * y + lamps[1, 2] * z) / length
        brightness = ambient + diffuse * max(lamp, 0.0) + sky * (0.5 + 0.5 * above)
        of_pixel = paint[row // supersample, column // supersample]
        for channel in range(3):
            of_pixel[channel] += part * min(max(colors[face, channel] * brightness, 0.0), 255.0)
        of_pixel[3] += part


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
