"""Films: the bodies over every video, and all videos in lock-step (`lock_step`)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal

import numpy as np
from jaxtyping import Float

from imocap_core.adapters.lenses import lenses_of
from imocap_core.adapters.relative_motion import paths_of, paths_of_initial, relative_motions
from imocap_core.artifacts.schemas import (
    Camera,
    CameraMotion,
    InitialSmpl,
    Keypoints,
    RefineSync,
    VideoKeypoints,
    VideoMotion,
)
from imocap_core.body import Model, load_free_body
from imocap_core.camera.projection import Lens, frame_projections
from imocap_core.errors import WorkFailed
from imocap_core.figures.overlays import LIGHT, draw_keypoints
from imocap_core.figures.sheets import surfaces
from imocap_core.figures.style import rgb_of, write_strip
from imocap_core.figures.sync_summary import common_moments
from imocap_core.io.video import write_h264
from imocap_core.lock_step import RGB, Image, lock_step, source_frames
from imocap_core.render import draw_mesh
from imocap_core.result.read import read_monocular
from imocap_core.result.result import ActionResult

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
            P_px=frame_projections(camera.H_first_from_frame, intrinsics[video.id]),
            layout_names=tuple(model.points(video.layout).names),
            rgb=rgb_of(ids, video.id),
            file=files.get(video.id),
            lens=lenses.get(video.id),
        )
        for video, camera, motion in zip(
            keypoints.videos, camera_motion.videos, motions, strict=True
        )
    ]


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
        eye, zero = np.eye(3), np.zeros(3)
        drawn = draw_mesh(
            picture, body, self._faces, self._rgb, P_px, eye, zero, alpha=self._alpha, light=LIGHT
        )
        if overlay.file is not None:
            return drawn
        xy = overlay.keypoints.xy_px[t] @ move[:2, :2].T + move[:2, 2]
        confidence = overlay.keypoints.confidence[t]
        return draw_keypoints(drawn, xy, confidence, overlay.layout_names)


USUAL_HEIGHT_PX = 720  # letters grow with the picture
SMALLEST, LARGEST = 0.6, 2.5


def overlay_film(overlay: OverlayBody, model: Model, *, alpha: float) -> Iterator[Image]:
    """Each used frame (height, width, 3) of a video with the body over it, named at the top."""
    video = overlay.keypoints
    painter = Painter(overlay, model, alpha=alpha)
    size = float(np.clip(video.size[1] / USUAL_HEIGHT_PX, SMALLEST, LARGEST))
    pictures = source_frames(overlay.file, video.frames, video.size)
    for t, (frame, picture) in enumerate(zip(video.frames, pictures, strict=True)):
        drawn = painter(t, picture)
        write_strip(drawn, video.id, f"frame {frame}", overlay.rgb, size)
        yield drawn


FilmKind = Literal["overlay", "side-by-side", "both"]
MotionKind = Literal["final", "monocular"]

SIDE_BY_SIDE = "side_by_side.mp4"


@dataclass(frozen=True)
class Film:
    """A film to be written: its file's name, its length, and its frames (RGB) one by one."""

    name: str
    count: int
    fps: float
    frames: Callable[[], Iterator[Any]]


def films_of(
    result: ActionResult,
    kind: FilmKind,
    *,
    mesh: bool,
    motion: MotionKind,
    opacity: float,
    span_s: tuple[float, float] | None = None,
) -> list[Film]:
    """The films of an action: the body over each video, and all videos in lock-step.

    Args:
        mesh: draw the body in the side-by-side film too.
        motion: the final one, or what each video alone says.
        opacity: of the body, 0 to 1.
        span_s: of the common time, from and to; only the film of all videos is of a part.

    ValueError where the span is none.
    """
    artifacts = result.artifacts
    keypoints, sync = artifacts.get(Keypoints), result.sync.summary
    model = load_free_body()
    if motion == "final":
        solved = artifacts.get(RefineSync).motion
        motions, cameras = solved.videos, solved.cameras
        paths = paths_of(solved.cameras)
    else:
        motions, cameras = read_monocular(artifacts), None
        paths = paths_of_initial(artifacts.get(InitialSmpl), artifacts.get(CameraMotion))
    motions = relative_motions(motions, paths)
    files = {video.id: video.video for video in result}
    camera_motion = artifacts.get(CameraMotion)
    lenses = lenses_of(camera_motion, artifacts.get(RefineSync) if motion == "final" else None)
    bodies = overlay_bodies(keypoints, camera_motion, motions, cameras, files, model, lenses)

    def overlay(number: int) -> Callable[[], Iterator[Any]]:
        return lambda: overlay_film(bodies[number], model, alpha=opacity)

    films = []
    if kind != "side-by-side" and span_s is None:
        films += [
            Film(f"overlay_{v.id}.mp4", len(v.frames), v.fps, overlay(n))
            for n, v in enumerate(keypoints.videos)
        ]
    if span_s is not None or (kind != "overlay" and len(bodies) > 1):
        paints = {
            body.keypoints.id: Painter(body, model, alpha=opacity if mesh else 0.0)
            for body in bodies
            if mesh or body.file is None  # where there is no video, keypoints are shown
        }

        fps = result[result.reference].fps
        moments_s = common_moments(keypoints, sync) / fps
        name, part = SIDE_BY_SIDE, slice(None)
        if span_s is not None:
            name, part = f"loop_{span_s[0]:.2f}-{span_s[1]:.2f}s.mp4", _within(moments_s, *span_s)

        def together() -> Iterator[Any]:
            return lock_step(keypoints, sync, files, result.action, paints, part)

        films.append(Film(name, len(moments_s[part]), fps, together))
    return films


def _within(moments_s: Float[np.ndarray, " N"], first: float, last: float) -> slice:
    """The moments from the one to the other. ValueError where there are none."""
    inside = np.flatnonzero((moments_s >= first - 1e-6) & (moments_s <= last + 1e-6))
    if not len(inside):
        raise ValueError(
            f"--from and --to: expected a span within {moments_s[0]:.2f} to {moments_s[-1]:.2f} s, "
            f"got {first:.2f} to {last:.2f}"
        )
    return slice(int(inside[0]), int(inside[-1]) + 1)


def write_films(
    films: Sequence[Film], folder: Path, advance: Callable[[Film, int], None]
) -> list[Path]:
    """Write the films to a folder; `advance(film, frames done)` is called after each frame."""
    from imocap_core.io.frame_access import prefetch

    def counted(film: Film) -> Iterator[Any]:
        for done, frame in enumerate(prefetch(film.frames()), start=1):
            yield frame
            advance(film, done)

    try:
        folder.mkdir(parents=True, exist_ok=True)
        for film in films:
            write_h264(folder / film.name, counted(film), film.fps, faststart=True)
    except OSError as error:
        raise WorkFailed(f"cannot write to {folder}: {error.strerror or error}") from None
    except ValueError as error:
        raise WorkFailed(str(error)) from None
    return [folder / film.name for film in films]
