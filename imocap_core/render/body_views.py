"""A body from its front, its right side and its back, with a level camera and to scale."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int, UInt8

from imocap_core.render.draw import draw_mesh
from imocap_core.render.shading import Light

VIEWS = ("front", "side", "back")

CAMERA_DISTANCE_M = 25.0  # nearly orthographic, so that lengths can be compared
FILLED = 0.94  # of the picture's smaller side, by the largest body
LEAST_FORWARD = (
    0.5  # horizontal share of the pelvis' forward axis below which the left axis decides
)
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
    """The horizontal unit vector in which a body faces: the pelvis' forward axis on the ground.

    Of a body that lies on its back or its front, the horizontal axis perpendicular to its left.
    """
    left, forward = R_upright_from_pelvis[:, 0], R_upright_from_pelvis[:, 2]
    flat = forward - (forward @ UP) * UP
    if np.linalg.norm(flat) < LEAST_FORWARD:
        flat = np.cross(left, UP)
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
) -> UInt8[np.ndarray, "height width 3"]:
    """A shaded body in the middle of a plain picture, over the line of the ground.

    Args:
        body_m: vertices in an upright world (y up, the ground at y = 0), metres.
        face_colors: RGB, 0..255. heading, view: see `view_rotation`.
        size_px: (width, height). px_per_m: the scale, see `common_scale`.

    The line is drawn where the ground is within the picture.
    """
    width, height = size_px
    R_cam_from_upright = view_rotation(heading, view)
    turned = body_m @ R_cam_from_upright.T
    middle = (turned.min(axis=0) + turned.max(axis=0)) / 2
    picture = np.full((height, width, 3), PAPER_RGB, dtype=np.uint8)
    ground_row = round((height - 1) / 2 - px_per_m * float(middle[1]))  # the camera's y is -height
    if 0 <= ground_row < height:
        picture[ground_row] = GROUND_RGB
    focal_px = px_per_m * CAMERA_DISTANCE_M
    K = np.array([[focal_px, 0, (width - 1) / 2], [0, focal_px, (height - 1) / 2], [0, 0, 1]])
    centred = turned - middle + [0.0, 0.0, CAMERA_DISTANCE_M]
    return draw_mesh(picture, centred, faces, face_colors, K, np.eye(3), np.zeros(3), light=LIGHT)
