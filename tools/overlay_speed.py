"""Speed of writing videos with the body over each frame: python tools/overlay_speed.py

A synthetic video (moving noise, 1280 x 720) with a body of 0.9 of the picture's height; decoding,
posing, painting and encoding together. Prints frames per second of wall-clock time, and CPU time
per frame, in total and by step.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from jaxtyping import UInt8

from imocap_core.artifacts.schemas import VideoKeypoints, VideoMotion
from imocap_core.body import load_free_body
from imocap_core.film import OverlayBody, overlay_film
from imocap_core.io.frame_access import prefetch
from imocap_core.io.video import read_rgb, write_h264

FPS = 30.0
SHARE_OF_HEIGHT = 0.9
BODY_M = 1.75


def performer(size: tuple[int, int], frames: int, file: Path) -> OverlayBody:
    """A body that moves its limbs in front of the camera."""
    model = load_free_body()
    width, height = size
    depth_m = 3.0
    focal_px = SHARE_OF_HEIGHT * height * depth_m / BODY_M
    K = np.array([[focal_px, 0, width / 2], [0, focal_px, height / 2], [0, 0, 1.0]])
    t = np.arange(frames)
    theta = np.zeros((frames, 24, 3))
    theta[:, 0, 0] = np.pi
    theta[:, [16, 17, 1, 4], 2] = 0.7 * np.sin(t / 8)[:, None]
    trans = np.tile([0.0, 0.25, depth_m], (frames, 1))
    layout = "body25"
    count = len(model.points(layout).names)
    nothing = np.full((frames, count), 0.0)
    keypoints = VideoKeypoints(
        id="made",
        fps=FPS,
        size=size,
        layout=layout,
        video=str(file),
        focal_px=None,
        initial=None,
        initial_format=None,
        frames=t,
        xy_px=np.zeros((frames, count, 2)),
        confidence=nothing,
        person_box_px=np.tile([0.0, 0, width, height], (frames, 1)),
        tracks_found=1,
        presence=1.0,
        note="",
    )
    motion = VideoMotion(
        id="made",
        frames=t,
        theta=theta.reshape(frames, 72),
        betas=np.zeros(10),
        trans=trans,
        joints=np.zeros((frames, 24, 3)),
        reprojection_px=np.zeros(frames),
    )
    names = tuple(model.points(layout).names)
    return OverlayBody(keypoints, motion, np.tile(K, (frames, 1, 1)), names, (49, 104, 155), file)


def noise(size: tuple[int, int], frames: int) -> Iterator[UInt8[np.ndarray, "H W 3"]]:
    """Coarse noise that moves: neither trivial nor incompressible for the codec."""
    rng = np.random.default_rng(7)
    width, height = size
    coarse = rng.integers(40, 200, (height // 16 + frames, width // 16, 3), dtype=np.uint8)
    for t in range(frames):
        yield np.kron(coarse[t : t + height // 16], np.ones((16, 16, 1), np.uint8))


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--size", default="1280x720")
    parser.add_argument("--frames", type=int, default=120)
    given = parser.parse_args()
    width, height = map(int, given.size.split("x"))
    size, model = (width, height), load_free_body()
    with tempfile.TemporaryDirectory() as folder:
        source = Path(folder) / "source.mp4"
        write_h264(source, noise(size, given.frames), FPS)
        one = performer(size, given.frames, source)
        parts = {
            "decode": lambda: sum(1 for _ in read_rgb(source)),
            "decode, pose, paint": lambda: sum(1 for _ in overlay_film(one, model, alpha=0.75)),
            "all, with encoding": lambda: write_h264(
                Path(folder) / "out.mp4",
                prefetch(overlay_film(one, model, alpha=0.75)),
                FPS,
                faststart=True,
            ),
        }
        for name, work in parts.items():
            wall, cpu = time.perf_counter(), time.process_time()
            frames = work()
            wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
            each_ms = 1000 * cpu / frames
            print(f"{name:<20} {frames / wall:6.1f} frames/s, {each_ms:5.1f} ms of CPU each")


if __name__ == "__main__":
    main()
