"""Keypoints, skeletons and bodies over crops of the videos' frames, and grids of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from jaxtyping import Float, Int, UInt8
from matplotlib.figure import Figure
from matplotlib.image import FigureImage
from matplotlib.transforms import Affine2D

from imocap_core.conventions import SMPL_JOINTS, SMPL_PARENTS
from imocap_core.figures.style import DPI, new_figure
from imocap_core.render import Light, draw_mesh

_RADIUS_PX = 3  # of a keypoint's dot
Image = UInt8[np.ndarray, "_ _ 3"]  # height, width, RGB

CELL_PX = (216, 270)
"""Width and height of one picture of a contact sheet."""
_GAP_PX = 5
_NAME_BOX = {"boxstyle": "round,pad=0.35", "facecolor": "#3b444d", "linewidth": 0}

LEFT_RGB, RIGHT_RGB, MIDDLE_RGB = (232, 151, 61), (62, 137, 201), (240, 240, 240)
_BODY_RGB = (178, 196, 214)
PAPER_RGB = (247, 248, 249)
LIGHT = Light(towards_lamp=(-0.35, -0.55, -0.76), up=(0.0, -1.0, 0.0))
"""Lamp over the camera's shoulder, in camera axes (y down, z away)."""


@dataclass(frozen=True)
class Window:
    """A part of a picture, resized to a cell; all windows of a video share one scale."""

    left_px: float
    top_px: float
    scale: float  # cell pixels per picture pixel

    def cut(self, picture: Image) -> Image:
        """The part of the picture, resized; blank beyond its border."""
        move = self.camera(np.eye(3))[:2]
        smooth = cv2.INTER_AREA if self.scale < 1 else cv2.INTER_CUBIC
        blur = picture if self.scale > 0.6 else cv2.GaussianBlur(picture, (0, 0), 0.35 / self.scale)
        cell = cv2.warpAffine(blur, move, CELL_PX, flags=smooth, borderValue=PAPER_RGB)
        return np.asarray(cell, dtype=np.uint8)

    def points(self, xy_px: Float[np.ndarray, "*any 2"]) -> Float[np.ndarray, "*any 2"]:
        """Picture pixels to cell pixels."""
        return (xy_px - [self.left_px, self.top_px]) * self.scale

    def camera(self, K: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "3 3"]:
        """The intrinsics of the cell, from those of the picture."""
        move = np.array(
            [
                [self.scale, 0, -self.left_px * self.scale],
                [0, self.scale, -self.top_px * self.scale],
                [0, 0, 1],
            ]
        )
        return np.asarray(move @ K)


def windows(
    boxes_px: Float[np.ndarray, "n 4"], size: tuple[int, int], margin: float = 1.22
) -> list[Window]:
    """One window per box x0 y0 x1 y1, all at one scale that shows the largest.

    A missing box is replaced by the nearest present one, and by the whole picture when there is
    none. A window stays inside the picture of ``size`` (width, height) where it fits.
    """
    present = np.flatnonzero(np.isfinite(boxes_px).all(axis=1))
    if not len(present):
        return windows(np.tile([0.0, 0.0, *size], (len(boxes_px), 1)), size, margin=1.0)
    nearest = present[np.abs(np.arange(len(boxes_px))[:, None] - present[None]).argmin(axis=1)]
    boxes = boxes_px[nearest]
    sides = np.quantile(boxes[:, 2:] - boxes[:, :2], 0.95, axis=0) * margin
    scale = float(min(CELL_PX[0] / sides[0], CELL_PX[1] / sides[1]))
    shown = np.array(CELL_PX) / scale
    corners = (boxes[:, :2] + boxes[:, 2:] - shown) / 2
    room = np.array(size) - shown
    corners = np.where(room >= 0, np.clip(corners, 0, np.maximum(room, 0)), corners)
    return [Window(float(x), float(y), scale) for x, y in corners]


def blank_cell() -> Image:
    """A cell without a picture."""
    return np.full((CELL_PX[1], CELL_PX[0], 3), PAPER_RGB, dtype=np.uint8)


def draw_keypoints(
    cell: Image,
    xy_px: Float[np.ndarray, "K 2"],
    confidence: Float[np.ndarray, " K"],
    names: Sequence[str],
) -> Image:
    """Dots in cell pixels: orange left, blue right, fainter with lower confidence."""
    drawn = cell.copy()
    reach = _RADIUS_PX + 3  # pixels from a dot's centre that it can touch
    for point, trust, name in zip(xy_px, confidence, names, strict=True):
        if trust > 0 and np.isfinite(point).all():
            x, y = round(float(point[0])), round(float(point[1]))
            left, top = max(x - reach, 0), max(y - reach, 0)
            part = drawn[top : max(y + reach, 0), left : max(x + reach, 0)]
            if not part.size:
                continue
            mark = part.copy()
            centre = (x - left, y - top)
            cv2.circle(mark, centre, _RADIUS_PX + 1, (25, 28, 32), -1, cv2.LINE_AA)
            cv2.circle(mark, centre, _RADIUS_PX, _side_rgb(name), -1, cv2.LINE_AA)
            share = 0.3 + 0.7 * min(float(trust), 1.0)
            part[:] = cv2.addWeighted(mark, share, part, 1 - share, 0)
    return drawn


def draw_skeleton(
    cell: Image, joints_m: Float[np.ndarray, "24 3"], K_cell: Float[np.ndarray, "3 3"]
) -> Image:
    """SMPL's bones, joints in the axes of the cell's camera: orange left, blue right."""
    drawn = cell.copy()
    if not np.isfinite(joints_m).all() or (joints_m[:, 2] <= 0).any():
        return drawn
    homogeneous = joints_m @ K_cell.T
    xy = np.rint(homogeneous[:, :2] / homogeneous[:, 2:]).astype(int)
    bones = [(j, p) for j, p in enumerate(SMPL_PARENTS) if p >= 0]
    for width, dark in ((4, True), (2, False)):
        for j, parent in bones:
            rgb = (25, 28, 32) if dark else _side_rgb(SMPL_JOINTS[j])
            ends = (tuple(map(int, xy[j])), tuple(map(int, xy[parent])))
            cv2.line(drawn, *ends, rgb, width, cv2.LINE_AA)
    return drawn


def draw_body(
    cell: Image,
    vertices_m: Float[np.ndarray, "V 3"],
    faces: Int[np.ndarray, "F 3"],
    K_cell: Float[np.ndarray, "3 3"],
    alpha: float = 0.85,
) -> Image:
    """The surface in the axes of the cell's camera, over the picture."""
    color = np.array(_BODY_RGB, dtype=np.float64)
    eye, zero = np.eye(3), np.zeros(3)
    return draw_mesh(cell, vertices_m, faces, color, K_cell, eye, zero, alpha=alpha, light=LIGHT)


def from_the_side(
    bodies_m: Float[np.ndarray, "n V 3"], faces: Int[np.ndarray, "F 3"]
) -> list[Image]:
    """Surfaces before a level camera (y up), from its right, depth to the right, at one scale."""
    R_side = np.array([[0.0, 0, -1], [0, -1, 0], [-1, 0, 0]])
    far_m = 25.0  # nearly orthographic, so that depth is to scale
    turned = bodies_m @ R_side.T
    low, high = turned.min(axis=1), turned.max(axis=1)
    extent = (high - low)[:, :2].max(axis=0)
    focal = far_m * 0.9 * float((np.array(CELL_PX) / extent).min())
    K = np.array([[focal, 0, CELL_PX[0] / 2], [0, focal, CELL_PX[1] / 2], [0, 0, 1]])
    centred = turned - ((low + high) / 2)[:, None] + [0, 0, far_m]
    return [draw_body(blank_cell(), body, faces, K, alpha=1.0) for body in centred]


def contact_sheet(
    rows: Sequence[Sequence[Image]], row_names: Sequence[str], column_names: Sequence[str]
) -> Figure:
    """Pictures in a grid at full resolution, with row names at the left and column names below.

    What is not a picture is transparent, and names are light on dark: for pages light and dark.
    """
    width, height = CELL_PX[0] + _GAP_PX, CELL_PX[1] + _GAP_PX
    mosaic = np.full((height * len(rows), width * len(column_names), 3), PAPER_RGB, dtype=np.uint8)
    for r, pictures in enumerate(rows):
        for c, picture in enumerate(pictures):
            mosaic[r * height : r * height + CELL_PX[1], c * width : c * width + CELL_PX[0]] = (
                picture
            )
    left, below = 150, 38  # pixels beside the mosaic
    size = (mosaic.shape[1] + left, mosaic.shape[0] + below)
    figure = new_figure(size[0] / DPI, size[1] / DPI, arranged=False)
    figure.add_artist(_Unscaled(figure, mosaic, left, below))
    style: dict[str, Any] = {"color": "white", "fontsize": 9.5, "bbox": _NAME_BOX}
    for r, name in enumerate(row_names):
        middle = 1 - (r * height + CELL_PX[1] / 2) / size[1]
        figure.text((left - 14) / size[0], middle, name, ha="right", va="center", **style)
    for c, name in enumerate(column_names):
        middle = (left + c * width + CELL_PX[0] / 2) / size[0]
        figure.text(middle, below / 2 / size[1], name, ha="center", va="center", **style)
    return figure


class _Unscaled(FigureImage):
    """A picture whose pixels are those of the figure, not resampled; its paper is transparent."""

    def __init__(self, figure: Figure, picture: Image, left_px: int, below_px: int) -> None:
        super().__init__(figure, offsetx=left_px, offsety=below_px)
        red, green, blue = (picture != np.array(PAPER_RGB, np.uint8)).transpose(2, 0, 1)
        alpha = np.where(red | green | blue, 255, 0).astype(np.uint8)
        self._rows_upwards = np.dstack([picture, alpha])[::-1].copy()
        self.set_data(picture)

    def make_image(
        self, renderer: Any, magnification: float = 1.0, unsampled: bool = False
    ) -> tuple[np.ndarray, float, float, Affine2D]:
        """RGBA, bottom row first, and where its corner is, not transformed."""
        return self._rows_upwards, self.ox, self.oy, Affine2D()


def _side_rgb(name: str) -> tuple[int, int, int]:
    if name.startswith("left_"):
        return LEFT_RGB
    return RIGHT_RGB if name.startswith("right_") else MIDDLE_RGB
