"""Small films of cameras that walk, turn, zoom or shake: is each told, and is its path followed?"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
import torch
from jaxtyping import Float, UInt8

from benchmarks.synthetic.moving_yoga import every_frame, make_moving_clip, moving_pictures
from benchmarks.synthetic.walking_cameras import CameraWalk
from imocap_core.adapters.camera_motion import background_of
from imocap_core.alignment import similarity
from imocap_core.camera.camera_path import CameraPath
from imocap_core.params import CameraMotionParams
from imocap_core.pipeline.make_demo import demo_body
from imocap_core.synthetic.yoga_clip import YOGA_SPANS, DemoClip

SIZE = (480, 270)
STRIDE = 2  # of yoga's frames
KINDS = ("walks", "turns", "shakes", "zooms")
FIRST_SEED = 300  # of the films; defaults were chosen on others


@dataclass(frozen=True)
class FilmRow:
    """One film: what the test says, and how well a walk is followed.

    off_px: of a camera on one spot. extent_m: of the true path. path_mm: root mean square error
    after a similarity; focal_pct: error of the focal length. NaN where there is no path.
    """

    film: str
    kind: str
    verdict: str
    off_px: float
    extent_m: float
    path_mm: float
    focal_pct: float


def film_row(number: int) -> FilmRow:
    """Film `number`: of each kind in turn, in each of yoga's rooms in turn."""
    torch.set_num_threads(1)
    cv2.setNumThreads(1)
    kind, index, seed = KINDS[number % 4], (number // 4) % 4, FIRST_SEED + number
    rng = np.random.default_rng([seed, 9])
    shaped = demo_body(seed)
    clip = every_frame(make_moving_clip(seed, index, shaped, _walk(kind, rng), SIZE), STRIDE)
    frames = len(clip.xy_px)
    zoom = np.linspace(1.0, rng.uniform(1.3, 2.0), frames) if kind == "zooms" else None
    pictures = _gray(moving_pictures(clip, seed, index, shaped, zoom))
    background = background_of(
        pictures, _boxes(clip, zoom), clip.fps, SIZE, 1.0, CameraMotionParams()
    )
    test = background.parallax(None)
    path = None
    if test.moves:
        path = background.path(float(max(SIZE)), refine_focal=True)
    extent = float(np.ptp(clip.camera.centres, axis=0).max())
    error, focal = _errors(path, clip)
    return FilmRow(f"{seed} v{index + 1}", kind, test.verdict, test.off_px, extent, error, focal)


def film_count(videos: int) -> int:
    """Films of all kinds in all rooms, `videos` of each."""
    return len(KINDS) * len(YOGA_SPANS) * videos


def _walk(kind: str, rng: np.random.Generator) -> CameraWalk:
    if kind == "walks":
        sideways = float(rng.choice([-1, 1]) * rng.uniform(0.5, 2.0))
        return CameraWalk(sideways, float(rng.uniform(0.0, 0.4)), bend=float(rng.integers(2)))
    shake = {"turns": 1.5, "shakes": 3.0, "zooms": 0.7}[kind]
    return CameraWalk(0.0, shake_deg=shake, bob=False)


def _gray(pictures: Iterator[UInt8[np.ndarray, "H W 3"]]) -> Iterator[UInt8[np.ndarray, "H W"]]:
    for picture in pictures:
        yield np.asarray(cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY), np.uint8)


def _boxes(clip: DemoClip, zoom: Float[np.ndarray, " T"] | None) -> Float[np.ndarray, "T 4"]:
    """Boxes around the true keypoints."""
    middle = clip.camera.K[:2, 2]
    grown = 1.0 if zoom is None else zoom[:, None, None]
    xy = middle + grown * (clip.xy_px - middle)
    return np.concatenate([xy.min(axis=1), xy.max(axis=1)], axis=1)


def _errors(path: CameraPath | None, clip: DemoClip) -> tuple[float, float]:
    if path is None:
        return float("nan"), float("nan")
    true = clip.camera.centres
    fit = similarity(path.centre, true)
    placed = fit.scale * path.centre @ fit.R_target_from_source.T + fit.t_target
    error = 1000 * float(np.sqrt(((placed - true) ** 2).sum(axis=1).mean()))
    return error, 100 * (path.focal_px / clip.camera.K[0, 0] - 1)
