"""Lenses of standing cameras estimated from straight lines: the figures of docs/moving_cameras.md.

``python -m tools.measure_line_lens --rooms 32 --real VIDEO...``: pictures of made rooms, and the
backgrounds of real videos whose lenses are straight, each through a straight lens and through
lenses that displace the corners of the picture, with noise and JPEG's blocks, 640 pixels large.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np

from benchmarks.synthetic.films import furniture, large_room
from imocap_core.camera.line_lens import (
    KeptPictures,
    StillBackground,
    centred_lens,
    lens_from_lines,
    still_background,
)
from imocap_core.camera.projection import intrinsics
from imocap_core.io.video import probe, read_gray
from imocap_core.synthetic.cameras import look_at
from imocap_core.synthetic.rooms import raycast, room

SIZE, LARGER, WORKING = (900, 506), 1280, 640
DISTORTIONS = (0.0, -0.045, -0.06, -0.08, -0.1, -0.128)  # 0, 5, 7, 10, 14 and 25 % of the corner
PICTURES, NOISE, QUALITY = 7, 3.0, 60
SEED = 500


def room_picture(number: int) -> np.ndarray:
    """A grey picture of a random room from a random place."""
    rng = np.random.default_rng(SEED + number)
    azimuth_deg, kind = rng.uniform(0, 360), number % 4
    angle, distance = np.deg2rad(azimuth_deg), rng.uniform(3.5, 6)
    centre = np.array([np.sin(angle) * distance, -np.cos(angle) * distance, rng.uniform(0.8, 2.2)])
    if number % 8 < 4:
        surfaces = room(kind, azimuth_deg, rng)
    else:
        path = rng.uniform(-1, 1, (9, 3))
        surfaces = large_room(kind, azimuth_deg, path, centre, SEED + number)
    surfaces = surfaces + furniture(azimuth_deg, int(rng.integers(0, 5)), rng)
    target = rng.uniform((-0.5, -0.5, 0.6), (0.5, 0.5, 1.2))
    R = look_at(centre, target, float(rng.uniform(-4, 4)), np.zeros(2))
    K = intrinsics(float(rng.uniform(0.7, 1.2) * SIZE[0]), SIZE)
    return cv2.cvtColor(raycast(surfaces, K, R, centre, SIZE), cv2.COLOR_RGB2GRAY)


def real_picture(file: Path) -> np.ndarray:
    """The grey background of a video."""
    info = probe(file)
    sampled = KeptPictures(info.frame_count, {})
    for _ in sampled.passing(
        p for _, p in read_gray(file, scale=min(1.0, LARGER / max(info.size)))
    ):
        pass
    return still_background(sampled, np.full((info.frame_count, 4), np.nan)).picture


def through_lens(picture: np.ndarray, distortion: float) -> np.ndarray:
    """The picture as a lens shows it, enlarged until no border shows."""
    size = (picture.shape[1], picture.shape[0])
    middle = (np.array(size) - 1) / 2
    grid = np.stack(np.meshgrid(np.arange(size[0]), np.arange(size[1])), axis=-1).astype(float)
    off = centred_lens(distortion, size).undistorted(grid) - middle
    source = (off / max(1.0, np.abs(off / middle).max()) + middle).astype(np.float32)
    return cv2.remap(picture, source[..., 0], source[..., 1], cv2.INTER_CUBIC)


def filmed(picture: np.ndarray, seed: int) -> StillBackground:
    """The median of noisy, compressed pictures of the working size."""
    rng = np.random.default_rng(seed)
    scale = WORKING / max(picture.shape)
    small = cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    shown = []
    for _ in range(PICTURES):
        noisy = np.clip(small + rng.normal(0, NOISE, small.shape), 0, 255).astype(np.uint8)
        shown.append(cv2.imdecode(cv2.imencode(".jpg", noisy, [1, QUALITY])[1], 0))
    return StillBackground(np.median(shown, axis=0).astype(np.uint8), np.ones(small.shape, bool))


def pictures(rooms: int, real: list[Path]) -> Iterator[np.ndarray]:
    """Everything that is looked at."""
    yield from map(room_picture, range(rooms))
    yield from map(real_picture, real)


def main() -> None:
    """Print a row for each lens."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rooms", type=int, default=32)
    parser.add_argument("--real", type=Path, nargs="*", default=[])
    given = parser.parse_args()
    rows: dict[float, list[tuple[float, float] | None]] = {d: [] for d in DISTORTIONS}
    for number, picture in enumerate(pictures(given.rooms, given.real)):
        for distortion in DISTORTIONS:
            estimate = lens_from_lines(filmed(through_lens(picture, distortion), number))
            certain = estimate is not None and estimate.certain
            rows[distortion].append(
                (estimate.distortion - distortion, estimate.sd) if certain and estimate else None
            )
            print(number, distortion, estimate, certain, flush=True)
    print("| displacement | rooms | real | median error | largest error | error / claimed sd |")
    for distortion, every in rows.items():
        errors = np.array([e for e in every if e is not None]).reshape(-1, 2)
        off = np.abs(errors[:, 0])
        counts = [
            f"{sum(e is not None for e in part)} of {len(part)}"
            for part in (every[: given.rooms], every[given.rooms :])
        ]
        shown = ["–"] * 3
        if len(off):
            ratio = np.sqrt(np.mean((off / errors[:, 1]) ** 2))
            shown = [f"{e:.3f}" for e in (np.median(off), off.max(), ratio)]
        print("|", " | ".join([f"{distortion:.3f}", *counts, *shown]), "|")


if __name__ == "__main__":
    main()
