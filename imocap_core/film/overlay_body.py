"""One video with all that a film needs: frames, camera, body, colour."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int, UInt8
from matplotlib.colors import to_rgb

from imocap_core.artifacts.schemas import (
    Camera,
    CameraMotion,
    Keypoints,
    VideoCameraMotion,
    VideoKeypoints,
    VideoMotion,
)
from imocap_core.body import Model
from imocap_core.camera.lens import Lens
from imocap_core.figures.bodies import surfaces
from imocap_core.figures.overlays import LIGHT, draw_keypoints
from imocap_core.figures.style import color_of
from imocap_core.io.video import read_rgb
from imocap_core.render.painter import paint_mesh

Image = UInt8[np.ndarray, "_ _ 3"]
RGB = tuple[int, int, int]

NEUTRAL_RGB = (52, 56, 61)
"""The ground where there is no video."""
PALE = 0.6  # share of the body's colour that is the video's own, the rest is light grey
LIGHT_GREY = 214.0
CHUNK = 16  # bodies posed at once


@dataclass(frozen=True)
class OverlayBody:
    """A video, and the body recovered from it.

    P_px (T, 3, 3): for each used frame, from metres in the axes of the first frame's camera to
    homogeneous pixels of that frame, before its lens. layout_names (K,): the keypoints' names.
    """

    keypoints: VideoKeypoints
    motion: VideoMotion
    P_px: Float[np.ndarray, "T 3 3"]
    layout_names: tuple[str, ...]
    rgb: RGB
    file: Path | None
    lens: Lens | None = None


def overlay_bodies(
    keypoints: Keypoints,
    camera_motion: CameraMotion,
    motions: Sequence[VideoMotion],
    cameras: Sequence[Camera] | None,
    files: Mapping[str, Path | None],
    model: Model,
    lenses: Mapping[str, Lens],
) -> list[OverlayBody]:
    """One per video, in the order of the keypoints; without `cameras` each has the intrinsics that
    its video alone gives. lenses: of the videos that have one."""
    ids = [v.id for v in keypoints.videos]
    intrinsics = {c.id: c.K for c in cameras or camera_motion.videos}
    return [
        OverlayBody(
            keypoints=video,
            motion=motion,
            P_px=projections(camera, intrinsics[video.id]),
            layout_names=tuple(model.points(video.layout).names),
            rgb=rgb_of(ids, video.id),
            file=files.get(video.id),
            lens=lenses.get(video.id),
        )
        for video, camera, motion in zip(
            keypoints.videos, camera_motion.videos, motions, strict=True
        )
    ]


def rgb_of(ids: Sequence[str], video: str) -> RGB:
    """The colour of a video in every figure, 0 to 255."""
    r, g, b = (round(255 * c) for c in to_rgb(color_of(ids, video)))
    return r, g, b


def projections(
    camera: VideoCameraMotion, K: Float[np.ndarray, "3 3"]
) -> Float[np.ndarray, "T 3 3"]:
    """P_px (T, 3, 3) = H_frame_from_first K, scaled so that a turning camera keeps true depths."""
    H_frame_from_first = np.linalg.inv(camera.H_first_from_frame)
    scale = np.cbrt(np.linalg.det(H_frame_from_first))[:, None, None]
    return np.asarray(H_frame_from_first / scale @ K)


def source_frames(
    file: Path | None, frames: Int[np.ndarray, " T"], size: tuple[int, int]
) -> Iterator[Image]:
    """The pictures of source frames that never go back, decoded once; without a file, a neutral
    picture of `size` (width, height). A video that ends early stands still."""
    blank: Image = np.full((size[1], size[0], 3), NEUTRAL_RGB, dtype=np.uint8)
    if file is None:
        yield from (blank for _ in frames)
        return
    reader = read_rgb(file, int(frames[0]), int(frames[-1]) + 1)
    number, picture = -1, blank
    for wanted in frames:
        while number < wanted:
            try:
                number, picture = next(reader)
            except StopIteration:
                break
        yield picture


class Painter:
    """Paints the body over pictures of its video, or over parts of these.

    Bodies are posed in small batches; the last two batches are cached.
    """

    def __init__(self, overlay: OverlayBody, model: Model, *, alpha: float) -> None:
        self._filmed, self._alpha = overlay, alpha
        self._faces = model.faces.numpy()
        self._count = len(overlay.keypoints.frames)
        self._rgb = PALE * np.array(overlay.rgb) + (1 - PALE) * LIGHT_GREY

        @lru_cache(maxsize=2)
        def batch(number: int) -> Float[np.ndarray, "F V 3"]:
            first = number * CHUNK
            last = min(first + CHUNK, self._count)
            return surfaces(model, overlay.motion, range(first, last))

        self._batch = batch

    def __call__(
        self, t: int, picture: Image, move: Float[np.ndarray, "3 3"] | None = None
    ) -> Image:
        """The body of used frame `t` over a picture; `move` (3, 3) from the frame's pixels to the
        picture's. Where there is no video, the keypoints too."""
        overlay = self._filmed
        move = np.eye(3) if move is None else move
        body = self._batch(t // CHUNK)[t % CHUNK]
        P_px = move @ overlay.P_px[t]
        if overlay.lens is not None:
            body = overlay.lens.bent(body, overlay.P_px[t])
        drawn = paint_mesh(
            picture, body, self._faces, P_px, self._rgb, alpha=self._alpha, light=LIGHT
        )
        if overlay.file is not None:
            return drawn
        xy = overlay.keypoints.xy_px[t] @ move[:2, :2].T + move[:2, 2]
        confidence = overlay.keypoints.confidence[t]
        return draw_keypoints(drawn, xy, confidence, overlay.layout_names)
