"""Plots of results: camera poses and root paths, errors of joints."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

from imocap_core.artifacts.schemas import Camera, VideoMotion
from imocap_core.figures.style import GRID, RESULT_COLORS, color_of, grid, headline, new_figure

_FRUSTUM_M = 0.45
_SHOWN_FROM_WORLD = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
"""Camera axes (right, down, forward) to plot axes (right, forward, up)."""


def scene_figure(
    motions: Sequence[VideoMotion], cameras: Sequence[Camera], reference: str
) -> Figure:
    """Cameras and root paths from above, pale at the start and dark at the end."""
    figure = new_figure(11.4, 4.6)
    above, path = figure.subplots(1, 2)
    ids = [camera.id for camera in cameras]
    for motion, camera in zip(motions, cameras, strict=True):
        color = color_of(ids, camera.id)
        root = (motion.joints[:, 0] - camera.t) @ camera.R  # world = R^T (x_cam - t)
        root = root[np.isfinite(root).all(axis=1)] @ _SHOWN_FROM_WORLD.T
        walk = (camera.path_m - camera.t) @ camera.R @ _SHOWN_FROM_WORLD.T
        _draw_camera(above, _frustum(camera), color, camera.id)
        for ax in (above, path):
            _draw_path(ax, root, color)
        if len(walk):
            _draw_path(above, walk, color)
    for ax, title in ((above, "from above"), (path, "the root's path, from above")):
        ax.set_aspect("equal", adjustable="datalim")
        ax.set_xlabel("right (m)")
        ax.set_ylabel("forward (m)")
        ax.set_title(title)
        ax.grid(True, color=GRID)
        ax.margins(0.14)
    headline(
        figure,
        "Cameras and the path of the root",
        f"axes of the camera of {reference}; paths, also of cameras, run from pale to dark",
    )
    return figure


def _frustum(camera: Camera) -> Float[np.ndarray, "5 3"]:
    """Centre and four image corners of a camera, in plot axes."""
    half = np.array([camera.K[0, 2] / camera.K[0, 0], camera.K[1, 2] / camera.K[1, 1]])
    corners = [[sx * half[0], sy * half[1], 1.0] for sx, sy in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    in_camera = _FRUSTUM_M * np.array([[0.0, 0, 0], *corners])
    return np.asarray((in_camera - camera.t) @ camera.R @ _SHOWN_FROM_WORLD.T)


def _draw_camera(ax: Axes, corners: Float[np.ndarray, "5 3"], color: str, name: str) -> None:
    """A wedge that opens in the viewing direction, with the name behind it."""
    centre, far = corners[0, :2], corners[1:, :2]
    ahead, spread = far.mean(axis=0) - centre, far - centre
    side = ahead[0] * spread[:, 1] - ahead[1] * spread[:, 0]
    wedge = np.array([far[side.argmin()], centre, far[side.argmax()]])
    ax.fill(wedge[:, 0], wedge[:, 1], color=color, alpha=0.18, lw=0)
    ax.plot(wedge[:, 0], wedge[:, 1], color=color, lw=1.0)
    behind = -11 * ahead / max(float(np.linalg.norm(ahead)), 1e-9)
    ax.annotate(
        name,
        (float(centre[0]), float(centre[1])),
        (float(behind[0]), float(behind[1])),
        textcoords="offset points",
        color=color,
        fontsize=8,
        ha="center",
        va="center",
    )


def _draw_path(ax: Axes, root: Float[np.ndarray, "T _"], color: str) -> None:
    if len(root) < 2:
        return
    flat = root[:, :2]
    segments = np.stack([flat[:-1], flat[1:]], axis=1)
    ax.add_collection(
        LineCollection(list(segments), colors=_shades(color, len(segments)), linewidths=1.6)
    )
    ax.plot(*flat[-1], "o", color=color, ms=3.5)
    ax.update_datalim(flat)
    ax.autoscale_view()


def _shades(color: str, count: int) -> Float[np.ndarray, "count 3"]:
    """One shade per segment, from nearly white to the colour."""
    full = np.array(to_rgb(color))
    share = np.linspace(0.25, 1.0, count)[:, None]
    return np.asarray((1 - share) + share * full)


def joint_error_figure(
    names: Sequence[str], errors_mm: Mapping[str, Float[np.ndarray, " J"]]
) -> Figure:
    """Bars of the mean error of each joint, one colour per result.

    Args:
        names: the joints. errors_mm: result -> mean error over frames and videos, in mm.
    """
    figure = new_figure(8.6, 3.1)
    ax = figure.subplots()
    last = next(reversed(list(errors_mm)))
    order = np.argsort(errors_mm[last])
    width = 0.8 / len(errors_mm)
    for i, (result, errors) in enumerate(errors_mm.items()):
        centres = np.arange(len(names)) + (i - (len(errors_mm) - 1) / 2) * width
        label = f"{result}, mean {np.nanmean(errors):.0f} mm"
        ax.bar(centres, errors[order], 0.92 * width, color=RESULT_COLORS[result], label=label)
    ax.set_xticks(np.arange(len(names)), [names[j].replace("_", "\n") for j in order])
    ax.tick_params(axis="x", length=0)
    ax.set_ylabel("mean error (mm)")
    ax.margins(x=0.01)
    ax.legend(loc="upper left")
    grid(ax, "y")
    headline(figure, "Error of each joint", "root-relative, not scaled, mean over the videos")
    return figure
