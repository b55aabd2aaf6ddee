"""The README's animation: python tools/readme_animation.py yoga docs/images/yoga.webp

All videos of an action that has been run, in lock-step, with the recovered bodies: the film of
`imocap video --kind side-by-side`, smaller and at fewer frames, as an animated WebP (or GIF) that
begins again when it ends.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import cv2
import numpy as np
from PIL import Image

from imocap_core.adapters.lenses import lenses_of
from imocap_core.artifacts.schemas import CameraMotion, Keypoints, RefineSync
from imocap_core.body import load_free_body
from imocap_core.film import Painter, overlay_bodies
from imocap_core.library.outputs import result_of
from imocap_core.lock_step import lock_step

ROOT = Path(__file__).resolve().parents[1]


def main() -> None:
    """Write the animation and print its size."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("action")
    parser.add_argument("out", type=Path)
    parser.add_argument("--width", type=int, default=840, help="pixels")
    parser.add_argument("--every", type=int, default=3, help="use every n-th moment")
    parser.add_argument("--quality", type=int, default=45, help="of WebP, 0 to 100")
    parser.add_argument("--opacity", type=float, default=0.75)
    given = parser.parse_args()
    result, model = result_of(given.action, ROOT), load_free_body()
    keypoints, refined = result.artifacts.get(Keypoints), result.artifacts.get(RefineSync)
    files = {video.id: video.video for video in result}
    cameras = result.artifacts.get(CameraMotion)
    bodies = overlay_bodies(
        keypoints,
        cameras,
        refined.motion.videos,
        refined.motion.cameras,
        files,
        model,
        lenses_of(cameras, refined),
    )
    paints = {body.keypoints.id: Painter(body, model, alpha=given.opacity) for body in bodies}
    film = lock_step(
        keypoints, refined.sync, files, result.action, paints, slice(None, None, given.every)
    )
    frames = [Image.fromarray(smaller(frame, given.width)) for frame in film]
    fps = next(v.fps for v in keypoints.videos if v.id == refined.sync.reference) / given.every
    options = {"quality": given.quality, "method": 6} if given.out.suffix == ".webp" else {}
    frames[0].save(
        given.out,
        save_all=True,
        append_images=frames[1:],
        duration=round(1000 / fps),
        loop=0,
        **options,
    )
    size = given.out.stat().st_size / 1e6
    print(f"{given.out}: {len(frames)} frames at {fps:.1f} a second, {size:.2f} MB")


def smaller(frame: np.ndarray, width: int) -> np.ndarray:
    """The frame resized to a width in pixels."""
    height = round(frame.shape[0] * width / frame.shape[1])
    return cv2.resize(frame, (width, height), interpolation=cv2.INTER_AREA)


if __name__ == "__main__":
    main()
